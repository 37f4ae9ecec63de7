"""The names of the methods, the settings of a calibration, and the errors of a pose on a data
set."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, get_args

import numpy as np

from stereocal.calibration.essential import Solver
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.errors import StereocalError
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.settings import Settings, described, joined

Method = Literal["essential", "2d", "3d", "refined"]
FileMethod = Literal["2d", "3d", "refined"]
FILE_METHODS: tuple[FileMethod, ...] = get_args(FileMethod)
"""Those with a parameter file."""
METHODS: tuple[Method, ...] = ("essential", "2d", "3d")
"""The paper's methods."""
PAPER_SETS: tuple[Method, Method] = ("2d", "3d")
"""The paper's two sets: one to match with, one to measure with."""
ALL_METHODS: tuple[Method, ...] = (*METHODS, "refined")
METHOD_NAMES: Mapping[Method, str] = {
    "essential": "Essential matrix",
    "2d": "2D set",
    "3d": "3D set",
    "refined": "Refined set",
}
POOR_LENGTH = 0.05
"""Relative length error; a set whose 95th percentile is above it is not fit to measure with."""
COST_UNITS: Mapping[Method, str] = {"essential": "", "2d": "px", "3d": "m", "refined": ""}


@dataclass(frozen=True)
class CalibrationSettings(Settings):
    """The settings of a calibration; the defaults are the paper's."""

    search: SearchSettings = joined(SearchSettings)
    essential: Solver = described(
        "constrained",
        "Solver of the essential matrix",
        "Constrained: the best essential matrix. Linear: the textbook's 8-point estimate alone, as "
        "the start of the searches.",
        choices=get_args(Solver),
        name="essential solver",
    )
    calibration_frames: int | None = described(None, "Calibration frames")
    """Number of frames to calibrate with, drawn at random; None for all."""
    known_points: bool = described(False, "3D cost from known points instead of lengths")
    """Use the 3D cost of the paper's footnote 4: known points instead of bar lengths."""
    all_frames: bool = described(
        False,
        "Trust every frame, as the paper does",
        "Without screening: otherwise frames that contradict the others are left out.",
        name="trust in every frame",
    )
    frames_put_back: tuple[int, ...] = described(
        (),
        "Frames put back",
        "Frames to keep though they contradict the others.",
        option="put-back",
    )
    frames_left_out: tuple[int, ...] = described(
        (),
        "Frames left out",
        "Frames to leave out, whatever the screening finds.",
        option="leave-out",
    )
    time_offset: bool = described(
        False,
        "Find the time offset between the cameras",
        "How many frames later the secondary takes its frames; its points are shifted by that. An "
        "offset that is significant is applied without this; with it, any. Needs a bar that moves, "
        "in consecutive frames.",
        name="time offset",
    )
    time_drift: bool = described(
        False,
        "Find its drift too",
        "How the time offset changes (frames per frame), for long recordings by cameras that each "
        "run by their own clock.",
        name="its drift",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.calibration_frames is not None and self.calibration_frames < 1:
            raise StereocalError("The number of calibration frames must be at least 1.")
        if self.time_drift and not self.time_offset:
            raise StereocalError("A drift of the time offset is found only with the offset.")

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The settings of JSON data, with frames in the order of their numbers."""
        settings = super().from_json(data)
        put_back, left_out = (
            tuple(sorted(frames)) for frames in (settings.frames_put_back, settings.frames_left_out)
        )
        return replace(settings, frames_put_back=put_back, frames_left_out=left_out)


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a pose on all pairs and bars of a data set; means exclude the frames left out."""

    reprojection_px: FloatArray
    """(n,): of each pair the mean over both cameras; NaN behind a camera."""
    length: FloatArray
    """(m,): of each bar |D - D^R| / D; NaN behind a camera."""
    kept_pairs: BoolArray
    """(n,): false for pairs of frames that were left out."""
    kept_bars: BoolArray
    """(m,): false for bars of frames that were left out."""

    @property
    def mean_reprojection_px(self) -> float:
        """Mean over the kept pairs with a value; NaN if there are none."""
        return _mean(self.reprojection_px[self.kept_pairs])

    @property
    def mean_length(self) -> float:
        """Mean relative length error over the kept bars with a value; NaN if there are none."""
        return _mean(self.length[self.kept_bars])

    @property
    def p95_length(self) -> float:
        """95th percentile of the relative length error; NaN if there are no values."""
        known = self.length[self.kept_bars & np.isfinite(self.length)]
        return float(np.percentile(known, 95)) if len(known) else float("nan")


def errors_of(dataset: Pair, pose: Pose, left_out: Collection[int] = ()) -> Errors:
    """Reprojection and length errors of a pose on a data set.

    Args:
        left_out: numbers of the frames that the means exclude.
    """
    rows = dataset.correspondences
    kept = ~np.isin(rows.frame, list(left_out))
    rig = Rig(dataset.primary, dataset.secondary, pose)
    if rig.has_windows:
        both = rig.reprojection_errors(rows.primary, rows.secondary)
    else:
        both = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale)
    lengths = dataset.reconstructed_lengths_m(pose)
    measured = dataset.bar_distances_m
    return Errors(
        both.mean(axis=1), np.abs(lengths - measured) / measured, kept, dataset.bars_among(kept)
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
