"""What a file of another program contributes to a data set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.units import UNITS, Unit
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import TARGETS, Correspondences, Dataset
from stereocal.system.numbers import rounded

NOMINAL_SIGMA = 0.02
"""Standard error of a baseline that is another program's result and not measured, relative."""
THROW = "THROW.csv"
"""File with the points of a thrown object, beside the data set."""
BACKGROUND_STEP = 10
"""Between the numbers of background frames, so that they are no neighbours in time."""


@dataclass(frozen=True)
class Taken:
    """A line of the report: what was taken, and from where."""

    what: str
    taken: str
    origin: str


@dataclass(frozen=True, eq=False)
class Archive:
    """The parts of a data set found in files of other programs; None for those not found."""

    taken: tuple[Taken, ...]
    primary: Camera | None = None
    secondary: Camera | None = None
    correspondences: Correspondences | None = None
    baseline_m: float | None = None
    """Result of the other program, not a measurement."""
    target_distance_m: float | None = None
    throw: pd.DataFrame | None = None
    """Points of a thrown object: frame, u_primary, v_primary, u_secondary, v_secondary."""
    notes: tuple[str, ...] = ()
    """For the data set."""
    remarks: tuple[str, ...] = ()
    """For the user."""

    @property
    def baseline_sigma_m(self) -> float | None:
        """Standard error assumed for the nominal baseline."""
        return None if self.baseline_m is None else NOMINAL_SIGMA * self.baseline_m

    def missing(self, baseline_m: float | None, distance_m: float | None) -> list[Taken]:
        """Lines of the report on what is missing; lengths as for `dataset`."""
        baseline = self.baseline_m if baseline_m is None else baseline_m
        distance = self.target_distance_m if distance_m is None else distance_m
        wanted = (
            ("table of points", self.correspondences, "give the CSV of the bar's ends"),
            ("camera files", self.primary, "give both lenses"),
            ("baseline", baseline, "give --baseline B in metres, or free"),
            ("distance A-B", distance, "give --distance D in metres"),
        )
        return [Taken(what, "missing", remedy) for what, value, remedy in wanted if value is None]

    def dataset(self, name: str, baseline_m: float | None, distance_m: float | None) -> Dataset:
        """The data set of a complete archive.

        Args:
            baseline_m: as measured; infinite to leave it free; None: the nominal one, with its
                standard error.
            distance_m: as measured; None: that of the files.
        """
        distance = self.target_distance_m if distance_m is None else distance_m
        if lines := self.missing(baseline_m, distance_m):
            raise StereocalError(
                f"{'; '.join(f'{line.what} is missing, {line.origin}' for line in lines)}."
            )
        assert self.primary is not None and self.secondary is not None
        assert self.correspondences is not None and distance is not None
        nominal, sigma = self.baseline_m or 1.0, self.baseline_sigma_m
        free = baseline_m == np.inf
        if baseline_m is not None:
            sigma = np.inf if free else None
        notes = self.notes
        if baseline_m is None:
            notes += ("The baseline is a result of the other program, not a measurement.",)
        return with_baseline_found(
            Dataset(
                name=name,
                primary=self.primary,
                secondary=self.secondary,
                correspondences=self.correspondences,
                baseline_m=nominal if free or baseline_m is None else baseline_m,
                target_distance_m=distance,
                baseline_sigma_m=sigma,
                notes=" ".join(notes),
            )
        )


def baseline_taken(baseline_m: float, origin: str) -> Taken:
    """The line of the report on a baseline that is a result and not a measurement."""
    words = f"{rounded(baseline_m, 4)} m ± {100 * NOMINAL_SIGMA:g} %, nominal: not a measurement"
    return Taken("baseline", words, origin)


def points_taken(rows: Correspondences, origin: str) -> Taken:
    """The line of the report on the bars."""
    words = f"{len(rows)} pairs of points, {len(rows.bars)} bars in {len(rows.frames)} frames"
    return Taken("bars", words, origin)


def lens_taken(which: str, camera: Camera, origin: str) -> Taken:
    """The line of the report on a lens."""
    width, height = camera.image_size
    K = camera.K
    distortion = (
        f"k1 {rounded(camera.distortion[0], 3)}" if camera.distortion.any() else "no distortion"
    )
    words = (
        f"f {rounded(K[0, 0], 5)} px, centre ({rounded(K[0, 2], 5)}, {rounded(K[1, 2], 5)}), "
        f"{width}x{height} px, {distortion}"
    )
    return Taken(f"{which} lens", words, origin)


def check_bar(length: float, unit: Unit | None, source: str) -> float:
    """The length of the bar in metres."""
    metres = length * UNITS[unit or "m"]
    if not 0 < metres <= 20:
        raise StereocalError(
            f"{source}: the bar would be {metres:g} m long: state the unit of its lengths, --unit "
            "mm or cm, or the length, --distance."
        )
    return metres


def with_background(
    bars: Correspondences, points: FloatArray, origin: str
) -> tuple[Correspondences, Taken, str]:
    """The bars, and background points as further frames with one target, which serve matching.

    Args:
        points: (n, 4) pixels of points that both cameras saw, n > 0.

    Returns:
        All rows, the line of the report, and the note for the data set.
    """
    first = 1000 * (1 + (int(bars.frame.max()) + BACKGROUND_STEP) // 1000)
    numbers = range(first, first + BACKGROUND_STEP * len(points), BACKGROUND_STEP)
    rows = Correspondences.from_arrays(
        frame=[*bars.frame.tolist(), *numbers],
        target=[*(TARGETS[k] for k in bars.target), *("A" for _ in numbers)],
        primary=np.concatenate([bars.primary, points[:, :2]]),
        secondary=np.concatenate([bars.secondary, points[:, 2:]]),
    )
    words = f"frames {first} to {numbers[-1]}"
    return (
        rows,
        Taken("background points", f"{len(points)} pairs, {words}", origin),
        f"Background points are the {words}, with one target each: they serve matching only.",
    )
