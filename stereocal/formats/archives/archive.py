"""What a file of another program contributes to a data set."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.point_files import BarPoints
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.numbers import count, rounded

NOMINAL_SIGMA = 0.02
"""Standard error of a baseline that is another program's result and not measured, relative."""
THROW = "THROW.csv"
"""File with the points of a thrown object, beside the data set."""
BACKGROUND_STEP = 10
"""Between the numbers of background frames, so that they are no neighbours in time."""


@dataclass(frozen=True)
class Part:
    """A line of the report: what was taken, and from where."""

    what: str
    taken: str
    origin: str


@dataclass(frozen=True, eq=False)
class Archive:
    """The parts of a data set found in files of other programs; None for those not found."""

    taken: tuple[Part, ...]
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
    no_baseline: str = ""
    """Why there is none in the camera files."""
    counted: BarPoints | None = None
    own_frames: bool = False
    """As of `Bars`."""

    @property
    def baseline_sigma_m(self) -> float | None:
        """Standard error assumed for the nominal baseline."""
        return None if self.baseline_m is None else NOMINAL_SIGMA * self.baseline_m

    def missing(self, baseline_m: float | None, distance_m: float | None) -> list[Part]:
        """Lines of the report on what is missing; lengths as for `dataset`."""
        baseline = self.baseline_m if baseline_m is None else baseline_m
        distance = self.target_distance_m if distance_m is None else distance_m
        why = f"{self.no_baseline.removesuffix('.')}: " if self.no_baseline else ""
        wanted = (
            ("table of points", self.correspondences, "give the CSV of the bar's ends"),
            ("camera files", self.primary, "give both lenses"),
            ("baseline", baseline, f"{why}give --baseline B in metres, or free"),
            ("distance A-B", distance, "give --distance D in metres"),
        )
        return [Part(what, "missing", remedy) for what, value, remedy in wanted if value is None]

    def dataset(self, name: str, baseline_m: float | None, distance_m: float | None) -> Pair:
        """The data set of two cameras in step; arguments as of `recording`."""
        return self.recording(name, baseline_m, distance_m).pair(*CAMERAS)

    def recording(self, name: str, baseline_m: float | None, distance_m: float | None) -> Recording:
        """The data set of a complete archive; a free baseline is still to be found, and the step of
        cameras that count their own frames.

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
        baseline, sigma, notes = baseline_m, None, self.notes
        if baseline_m is None:
            baseline, sigma = self.baseline_m, self.baseline_sigma_m
            notes += ("The baseline is a result of the other program, not a measurement.",)
        elif baseline_m == np.inf:
            baseline = None
        recording = Recording.of_two(
            name, self.primary, self.secondary, baseline, distance, sigma, notes=" ".join(notes)
        )
        if self.own_frames and self.counted is not None:
            return replace(self.counted.put_into(recording), own_frames=True)
        return recording.with_pairs(self.correspondences)


def with_background(bars: BarPoints, points: BarPoints) -> tuple[BarPoints, str]:
    """The bars, and background points as further frames with one target, which serve matching.

    Returns:
        All rows, and in words which frames are added.
    """
    first = 1000 * (1 + (int(bars.frame.max()) + BACKGROUND_STEP) // 1000)
    numbers = first + BACKGROUND_STEP * np.arange(len(points.frame))
    joined = BarPoints(
        np.append(bars.frame, numbers),
        np.append(bars.target, points.target),
        np.concatenate([bars.pixels, points.pixels]),
    )
    return joined, f"frames {first} to {numbers[-1]}"


def baseline_taken(baseline_m: float, origin: str) -> Part:
    """The line of the report on a baseline that is a result and not a measurement."""
    words = f"{rounded(baseline_m, 4)} m ± {100 * NOMINAL_SIGMA:g} %, nominal: not a measurement"
    return Part("baseline", words, origin)


def points_taken(rows: Correspondences, origin: str, own: BarPoints | None = None) -> Part:
    """The line of the report on the bars; `own`: of cameras that count their own frames."""
    if own is not None:
        points = " and ".join(f"{number:,}" for number in own.seen.sum(axis=0))
        return Part("bars", f"{points} points, with each camera's own frames", origin)
    bars, frames = count(len(rows.bars), "bar"), count(len(rows.frames), "frame")
    words = f"{count(len(rows), 'pair')} of points, {bars} in {frames}"
    return Part("bars", words, origin)


def lens_taken(which: str, camera: Camera, origin: str) -> Part:
    width, height = camera.image_size
    K, lens = camera.K, camera.distortion
    distortion = f"k1 {rounded(lens[0], 3)}" if lens.any() else "no distortion"
    words = (
        f"f {rounded(K[0, 0], 5)} px, centre ({rounded(K[0, 2], 5)}, {rounded(K[1, 2], 5)}), "
        f"{width}x{height} px, {distortion}"
    )
    return Part(f"{which} lens", words, origin)
