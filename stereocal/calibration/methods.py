"""The names of the methods, and the settings of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from stereocal.calibration.essential import Solver
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.errors import StereocalError

Method = Literal["essential", "2d", "3d", "refined"]
METHODS: tuple[Method, ...] = ("essential", "2d", "3d")
"""The paper's methods."""
SWITCHES = ("known_points", "all_frames", "time_offset", "time_drift")
"""The settings of a calibration that are true or false."""
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
    """The settings of a calibration; the defaults are the paper's.

    Raises:
        StereocalError: a value outside its range.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    essential: Solver = "constrained"
    calibration_frames: int | None = None
    """Number of frames to calibrate with, drawn at random; None for all."""
    known_points: bool = False
    """Use the 3D cost of the paper's footnote 4: known points instead of bar lengths."""
    all_frames: bool = False
    """Use every frame, as the paper does, without screening."""
    frames_put_back: tuple[int, ...] = ()
    """Numbers of frames that the screening must keep."""
    frames_left_out: tuple[int, ...] = ()
    """Numbers of frames to leave out, whatever the screening finds."""
    time_offset: bool = False
    """Find the time offset between the cameras, and shift the secondary points by it."""
    time_drift: bool = False
    """Find its drift too."""

    def __post_init__(self) -> None:
        if self.essential not in ("constrained", "linear"):
            raise StereocalError(
                f'The essential solver "{self.essential}" is unknown: constrained or linear.'
            )
        if self.calibration_frames is not None and self.calibration_frames < 1:
            raise StereocalError("The number of calibration frames must be at least 1.")
        if self.time_drift and not self.time_offset:
            raise StereocalError("A drift of the time offset is found only with the offset.")

    def to_json(self) -> dict[str, Any]:
        """All settings in one flat object."""
        return {
            **asdict(self.search),
            "essential": self.essential,
            "calibration_frames": self.calibration_frames,
            "known_points": self.known_points,
            "all_frames": self.all_frames,
            "frames_put_back": list(self.frames_put_back),
            "frames_left_out": list(self.frames_left_out),
            "time_offset": self.time_offset,
            "time_drift": self.time_drift,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CalibrationSettings:
        """The settings that `to_json` describes; missing ones keep their defaults.

        Raises:
            StereocalError: an unknown setting, or a value of the wrong type or out of range.
        """
        rest = dict(data)
        own: dict[str, Any] = {
            name: rest.pop(name)
            for name in ("essential", "calibration_frames", *SWITCHES)
            if name in rest
        }
        try:
            for name in SWITCHES:
                if not isinstance(own.get(name, False), bool):
                    raise TypeError(f"{name} is neither true nor false")
            for name in ("frames_put_back", "frames_left_out"):
                frames = rest.pop(name, [])
                if not all(isinstance(frame, int) for frame in frames):
                    raise TypeError(f"{name} is not a list of frame numbers")
                own[name] = tuple(sorted(frames))
            if not isinstance(own.get("calibration_frames"), int | None):
                raise TypeError("calibration_frames is not a whole number")
            return cls(search=SearchSettings(**rest), **own)
        except TypeError as error:
            raise StereocalError(f"The settings cannot be read: {error}.") from error
