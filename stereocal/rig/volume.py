"""The volume that the bars of a calibration filled, as the primary camera sees it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.array_types import BoolArray, FloatArray

RANGES = ("x/z", "y/z", "z_m")
MINIMUM_BARS = 2.0


@dataclass(frozen=True)
class Volume:
    """Ranges of direction and depth in the primary's frame, each (low, high).

    A calibration is tested by its bars only where they were: elsewhere, wrong angles, lenses and
    distortion may cause errors that no residual shows.
    """

    x_over_z: tuple[float, float]
    y_over_z: tuple[float, float]
    z_m: tuple[float, float]
    """Depth in metres."""

    def __post_init__(self) -> None:
        ranges = self._ranges
        if not (np.isfinite(ranges).all() and (ranges[:, 0] <= ranges[:, 1]).all()):
            raise StereocalError(
                "The volume of the bars must have finite ranges [low, high] with low <= high."
            )

    @classmethod
    def of_bars(cls, points_m: npt.ArrayLike) -> "Volume":
        """The volume of bar ends, (n, 3) in metres in the primary's frame; NaN is ignored.

        The range of n values spread evenly over a range of width W has the width W (n - 1)/(n + 1)
        on average, so each end is moved outwards by 1/(n - 1) of the range found, which is W on
        average. The ends of one bar lie close together, so n is the number of bars, not of ends.
        Of the ends of further bars in the same place, 25 simulated bars left 14 % outside one or
        more of the three plain ranges, 9 % with the number of ends as n, and 6 % as here.
        """
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1) & (points[:, 2] > 0)]
        return cls.around(_directions_and_depths(points))

    @classmethod
    def around(cls, places: FloatArray) -> "Volume":
        """The volume of bar ends whose directions and depths are given, (n, 3).

        Of m numbers even between two limits, the least and the largest are a share 1 / (m + 1) of
        the interval within each limit on average, which is their range over m - 1: so far out are
        the limits put. m is the number of bars, whose two ends are not independent.
        """
        if not len(places):
            raise StereocalError("No bar is in front of the cameras, so there is no volume.")
        low, high = places.min(axis=0), places.max(axis=0)
        bars = max(len(places) / 2, MINIMUM_BARS)
        margin = (high - low) / (bars - 1)
        low, high = low - margin, high + margin
        low[2] = max(low[2], 0.0)
        return cls(*zip(low.tolist(), high.tolist(), strict=True))

    def contains(self, points_m: npt.ArrayLike) -> BoolArray:
        """(n,): which points (n, 3), in metres in the primary's frame, lie in the volume.

        Points with NaN, and those behind the camera, do not.
        """
        points = np.asarray(points_m, dtype=np.float64)
        with np.errstate(all="ignore"):
            return self.has(_directions_and_depths(points)) & (points[:, 2] > 0)

    def has(self, places: FloatArray) -> BoolArray:
        """(n,): which directions and depths (n, 3) are in the ranges."""
        low, high = self.limits
        return np.asarray(((places >= low) & (places <= high)).all(axis=1))

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """The low and the high ends of x/z, y/z and z, (3,) each."""
        low, high = self._ranges.T
        return low, high

    @property
    def depths(self) -> str:
        """The range of depths for people, such as `3.12 to 7.93 m`."""
        low, high = (np.format_float_positional(z, 3, fractional=False, trim="-") for z in self.z_m)
        return f"{low} to {high} m"

    def sentence(self) -> str:
        """The volume for people."""
        wide, high = (np.degrees(np.ptp(np.arctan(r))) for r in (self.x_over_z, self.y_over_z))
        return (
            f"The bars filled depths from {self.depths}, {wide:.0f}° wide and {high:.0f}° high as "
            "the primary camera sees it; outside, errors can be larger than stated."
        )

    def to_json(self) -> dict[str, list[float]]:
        return dict(zip(RANGES, self._ranges.tolist(), strict=True))

    @classmethod
    def from_json(cls, data: Any) -> "Volume":
        """The inverse of `to_json`."""
        try:
            x, y, z = ((float(low), float(high)) for low, high in (data[name] for name in RANGES))
            return cls(x, y, z)
        except DAMAGED as error:
            raise StereocalError(
                f"the volume of the bars must give {', '.join(RANGES[:2])} and {RANGES[2]} as "
                "[low, high], finite, with low <= high."
            ) from error

    @property
    def _ranges(self) -> FloatArray:
        """(3, 2)."""
        return np.array([self.x_over_z, self.y_over_z, self.z_m], dtype=np.float64)


def _directions_and_depths(points: FloatArray) -> FloatArray:
    """(n, 3): x/z, y/z and z of points (n, 3)."""
    return np.column_stack([points[:, :2] / points[:, 2:], points[:, 2]])
