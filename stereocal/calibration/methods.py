"""The names of the methods, and the settings of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args

from stereocal.calibration.essential import Solver
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.errors import StereocalError
from stereocal.system.described import check_described, described
from stereocal.system.records import plain, settings_of

Method = Literal["essential", "2d", "3d", "refined"]
METHODS: tuple[Method, ...] = ("essential", "2d", "3d")
"""The paper's methods."""
ALL_METHODS: tuple[Method, ...] = (*METHODS, "refined")
METHOD_NAMES: Mapping[Method, str] = {
    "essential": "Essential matrix",
    "2d": "2D set",
    "3d": "3D set",
    "refined": "Refined set",
}
COST_UNITS: Mapping[Method, str] = {"essential": "", "2d": "px", "3d": "m", "refined": ""}


@dataclass(frozen=True)
class CalibrationSettings:
    """The settings of a calibration; the defaults are the paper's."""

    search: SearchSettings = field(default_factory=SearchSettings)
    essential: Solver = described(
        "constrained",
        "Solver of the essential matrix",
        "Constrained: the best essential matrix. Linear: the textbook's 8-point estimate alone, as "
        "the start of the searches.",
        choices=get_args(Solver),
    )
    calibration_frames: int | None = None
    """Number of frames to calibrate with, drawn at random; None for all."""
    known_points: bool = False
    """Use the 3D cost of the paper's footnote 4: known points instead of bar lengths."""
    all_frames: bool = described(
        False,
        "Trust every frame, as the paper does",
        "Without screening: otherwise frames that contradict the others are left out.",
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
        "For cameras that are not quite in step: how many frames later the secondary takes its "
        "frames. Its points are shifted by that. Needs a bar that moves, in consecutive frames.",
    )
    time_drift: bool = described(
        False,
        "Find its drift too",
        "How the time offset changes (frames per frame), for long recordings by cameras that each "
        "run by their own clock.",
    )

    def __post_init__(self) -> None:
        check_described(self)
        if self.calibration_frames is not None and self.calibration_frames < 1:
            raise StereocalError("The number of calibration frames must be at least 1.")
        if self.time_drift and not self.time_offset:
            raise StereocalError("A drift of the time offset is found only with the offset.")

    def to_json(self) -> dict[str, Any]:
        """All settings in one flat object."""
        own = plain(self)
        return {**own.pop("search"), **own}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CalibrationSettings:
        """The settings that `to_json` describes; missing ones keep their defaults."""
        own = dict(data)
        own["search"] = {
            each.name: own.pop(each.name) for each in fields(SearchSettings) if each.name in own
        }
        found = settings_of(own, cls)
        put_back, left_out = (
            tuple(sorted(frames)) for frames in (found.frames_put_back, found.frames_left_out)
        )
        return replace(found, frames_put_back=put_back, frames_left_out=left_out)
