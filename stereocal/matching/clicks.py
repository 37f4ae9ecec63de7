"""Points that a person clicks in both images, and what they measure: with the sets, the threshold
and the noise of `match` and `reconstruct`, as they will be in `pairs.csv` and `points.csv`.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.in_step import points_in_step
from stereocal.matching.pairs import PairMatching, Stated, sample_frames
from stereocal.matching.point_table import POINT
from stereocal.matching.reconstruction import Points3D, noise_of_file, reconstruct_points
from stereocal.matching.threshold import ThresholdChoice
from stereocal.matching.trajectories import TRACK
from stereocal.refined.distortion import lenses_of_cameras
from stereocal.refined.two_views import shared_unknowns
from stereocal.refined.uncertainty import length_variances
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.compiled import FloatArray
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.epipolar_curve import epipolar_curve
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded

CLICK_PX = 1.0
"""Noise of a click, one standard deviation of a coordinate, until the pairs show their own."""
Source = Literal["clicked", "snapped", "followed"]
Key = tuple[int, CameraName, str]
SUFFIXES = (f"_{CAMERAS[0]}", f"_{CAMERAS[1]}")


@dataclass(frozen=True)
class Click:
    """A point in one image, in raw pixels."""

    frame: int
    camera: CameraName
    track: str
    u: float
    v: float
    source: Source = "clicked"
    """`snapped` to what the image shows there; `followed` from another frame, and accepted."""

    @property
    def key(self) -> Key:
        """What a later click replaces."""
        return self.frame, self.camera, self.track


class Place(NamedTuple):
    """A point in space: of a track, in a frame."""

    track: str
    frame: int

    def __str__(self) -> str:
        return f"{self.track}, frame {self.frame}"


@dataclass(frozen=True)
class Clicks:
    """Points clicked in both images: each track has at most one in an image."""

    every: Mapping[Key, Click]

    @classmethod
    def of(cls, clicks: Iterable[Click]) -> "Clicks":
        """Of several at one place, the last is kept."""
        return cls({each.key: each for each in clicks})

    def placed(self, clicks: Iterable[Click]) -> "Clicks":
        """With further ones."""
        return Clicks.of([*self.every.values(), *clicks])

    @property
    def tracks(self) -> list[str]:
        """In the order of their first clicks."""
        return list(dict.fromkeys(each.track for each in self.every.values()))

    def at(self, frame: int, camera: CameraName) -> list[Click]:
        """Those in one image."""
        return [each for each in self.every.values() if each.key[:2] == (frame, camera)]

    def along(self, track: str, camera: CameraName) -> list[Click]:
        """Those of a track in one camera, by frame."""
        own = [e for e in self.every.values() if e.track == track and e.camera == camera]
        return sorted(own, key=lambda each: each.frame)

    @property
    def has_pairs(self) -> bool:
        """Whether any point is in both images."""
        return any((f, CAMERAS[1], t) in self.every for f, c, t in self.every if c == CAMERAS[0])

    def tables(self, to_match: bool = False) -> dict[str, pd.DataFrame]:
        """The points of each camera: `frame,u,v,track,source`.

        Args:
            to_match: only tracks that are in both, so that no other two are taken for one.
        """
        sides = [{e.track for e in self.every.values() if e.camera == c} for c in CAMERAS]
        kept = sides[0] & sides[1] if to_match else sides[0] | sides[1]
        columns = ["frame", "u", "v", TRACK, "source"]
        rows = {
            camera: [
                [getattr(each, name) for name in columns]
                for each in self.every.values()
                if each.camera == camera and each.track in kept
            ]
            for camera in CAMERAS
        }
        return {
            camera: pd.DataFrame(found, columns=columns).sort_values(["frame", TRACK])
            for camera, found in rows.items()
        }


class Length(NamedTuple):
    """A distance, or the mean of several."""

    metres: float
    sigma_m: float
    """Standard error, with that of the parameters."""
    frames: int = 1

    def __str__(self) -> str:
        decimals = int(np.clip(1 - np.floor(np.log10(max(self.sigma_m, 1e-9))), 0, 9))
        return f"{self.metres:.{decimals}f} ± {self.sigma_m:.{decimals}f} m"


@dataclass(frozen=True)
class Settled:
    """What is settled before points are measured."""

    stated: Stated
    threshold: ThresholdChoice

    @property
    def sigma_px(self) -> float:
        """The noise of the clicks."""
        assert self.threshold.noise is not None  # stated, or estimated
        return self.threshold.noise.sigma_px


@dataclass(frozen=True, eq=False)
class ClickMeasure:
    """The sets that match and measure, what is stated, and the world frame."""

    matching: RigParameters
    measuring: RigParameters
    stated: Stated = field(default_factory=lambda: Stated(names=TRACK))
    world: Pose | None = None

    def settled(self, clicks: Clicks) -> Settled:
        """The threshold and the noise, as of `pairs`; `CLICK_PX` where the pairs do not show their
        own noise: that of the targets, which is taken of other points, is not that of a hand.
        """
        first, second = clicks.tables(to_match=True).values()
        second, _ = points_in_step(second, POINT, self.matching)
        sample, distinct = sample_frames(first, second), [first[[TRACK]], second[[TRACK]]]

        def choose(stated: Stated) -> Settled:
            settled = PairMatching.settled(self.matching, sample, distinct, stated)
            return Settled(stated, settled.threshold)

        stated = self.stated
        if stated.sigma_px is None:
            with suppress(StereocalError):  # without a threshold
                found = choose(stated)
                if found.threshold.noise and found.threshold.noise.source != "calibration":
                    return found
            stated = replace(stated, sigma_px=CLICK_PX)
        return choose(stated)

    def measured(self, clicks: Clicks, settled: Settled) -> "MeasuredClicks":
        """What the clicks measure."""
        first, second = clicks.tables(to_match=True).values()
        second, timing = points_in_step(second, POINT, self.matching)
        pairs = first.merge(second, on=["frame", TRACK], suffixes=SUFFIXES)
        pixels = pairs[list(PIXELS)].to_numpy(dtype=np.float64)
        errors = self.matching.reprojection_errors(pixels[:, :2], pixels[:, 2:]).mean(axis=1)
        return MeasuredClicks(self, settled, pairs.assign(error_px=errors), timing)

    def curve(self, click: Click, velocity: FloatArray | None = None) -> FloatArray:
        """(n, 2): the epipolar line of a click in the other image, by the set that matches.

        Args:
            velocity: (2,) of the point in its own image, px per frame: the other camera sees it
                later or earlier, by the time offset of the parameters.
        """
        pixel, offset = np.array([click.u, click.v]), self.matching.time_offset
        if offset is not None and velocity is not None:
            later = float(offset.at([click.frame])[0])
            pixel += velocity * (later if click.camera == CAMERAS[0] else -later)
        return epipolar_curve(self.matching, click.camera, pixel)


@dataclass(frozen=True, eq=False)
class MeasuredClicks:
    """3D points of clicks, and distances between them."""

    how: ClickMeasure
    settled: Settled
    pairs: pd.DataFrame
    """Of `frame` and `track`, in the columns of `pairs.csv`."""
    timing: str = ""
    """How the secondary points were brought into step."""

    @cached_property
    def _pixels(self) -> tuple[FloatArray, FloatArray]:
        pixels = self.pairs[list(PIXELS)].to_numpy(dtype=np.float64)
        return pixels[:, :2], pixels[:, 2:]

    @cached_property
    def _xyz(self) -> FloatArray:
        """(n, 3) in the primary's frame."""
        return self.how.measuring.reconstruct(*self._pixels)

    def point(self, row: int) -> Points3D:
        """One point, as in `points.csv`."""
        first, second = (side[row : row + 1] for side in self._pixels)
        how, sigma_px = self.how, self.settled.sigma_px
        return reconstruct_points(how.measuring, first, second, how.world, sigma_px)

    @cached_property
    def rows(self) -> dict[Place, int]:
        """The row of each point that is in front of both cameras."""
        known = np.asarray(np.isfinite(self._xyz).all(axis=1))
        places = zip(self.pairs[TRACK], self.pairs["frame"], strict=True)
        return {Place(str(t), int(f)): k for k, (t, f) in enumerate(places) if known[k]}

    def sentence(self, place: Place) -> str:
        """Error, and position with its standard error, of one of `rows` in words."""
        row, limit_px = self.rows[place], self.settled.threshold.threshold_px
        point = self.point(row)
        error_px = float(self.pairs["error_px"].iloc[row])
        fits = "below" if error_px <= limit_px else "above"
        doubt = "" if error_px <= limit_px else ": not the same point, or clicked badly"
        assert point.sigma_m is not None
        numbers = zip("xyz", point.xyz[0].tolist(), point.sigma_m[0].tolist(), strict=True)
        where = ", ".join(f"{axis} {Length(value, sigma)}" for axis, value, sigma in numbers)
        outside = point.outside_volume is not None and bool(point.outside_volume[0])
        return (
            f"{rounded(error_px)} px, {fits} the threshold of {rounded(limit_px, 3)} px{doubt}. "
            f"{where}{', outside the volume of the bars' * outside}."
        )

    @property
    def tracks(self) -> list[str]:
        """Those with any point in both images."""
        return list(dict.fromkeys(each.track for each in self.rows))

    def beyond(self, frame: int) -> set[str]:
        """The tracks whose point in a frame has an error above the threshold."""
        off = self.pairs["error_px"] > self.settled.threshold.threshold_px
        return {*self.pairs.loc[off & (self.pairs["frame"] == frame), TRACK]}

    def in_words(self, *ends: tuple[Place, Place]) -> str:
        """The distance of two points, or the mean of several such, as a sentence; empty if none is
        measured."""
        if (found := self.length(*ends)) is None:
            return ""
        one, other = ends[0]
        if len(ends) > 1:
            of = f"{one.track} to {other.track}, mean of {found.frames} frames"
        else:
            of = f"{one} to {other}"
        return f"{of}: {found}."

    def previous(self, place: Place) -> Place | None:
        """The point of the track in the nearest frame before."""
        before = [e for e in self.rows if e.track == place.track and e.frame < place.frame]
        return max(before, key=lambda each: each.frame, default=None)

    def common(self, one: str, other: str) -> list[tuple[Place, Place]]:
        """The points of two tracks in the frames that have both."""
        frames = sorted(each.frame for each in self.rows if each.track == one)
        both = [(Place(one, frame), Place(other, frame)) for frame in frames]
        return [each for each in both if each[1] in self.rows]

    def length(self, *ends: tuple[Place, Place]) -> Length | None:
        """The distance of two points, or the mean of those of several pairs of points, with its
        error: that of the parameters is common to all.

        Pixels are taken as independent: no point may be in two of the pairs.
        """
        rows = [(self.rows[a], self.rows[b]) for a, b in ends if {a, b} <= {*self.rows}]
        if not rows or any(a == b for a, b in rows):
            return None
        rig = self.how.measuring
        first, second = self._xyz[np.array(rows).T]
        metres = float(np.linalg.norm(first - second, axis=1).mean())
        about = shared_unknowns(rig), lenses_of_cameras(rig.primary, rig.secondary)
        own, by_shared = length_variances(*about, self.settled.sigma_px, first, second)
        covariance, mean = noise_of_file(rig)[1], by_shared.mean(axis=0)
        variance = own.sum() / len(rows) ** 2
        if covariance is not None:
            variance += mean @ covariance @ mean
        return Length(metres, float(np.sqrt(variance)), len(rows))
