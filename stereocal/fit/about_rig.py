"""What `rig.json` tells of a rig: how good it is, what was left out, and what its pairs say."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from stereocal.fit.errors.held_out import HeldOutErrors
from stereocal.fit.screening.wrong_images import WrongImage
from stereocal.system.records import plain


@dataclass(frozen=True, kw_only=True)
class RigFigures:
    """The errors of a rig, on the frames it was fitted to."""

    reprojection_px: float
    length_error_p95: float | None
    """95 % of the lengths are within this fraction; None without known lengths."""
    frames: int
    independent_frames: int = 0
    design_effect: float = 1.0
    length_scatter_m: float = 0.0
    metric_error_p95: float | None = None
    """95 % of lengths in metres are within this fraction: with the error of the object, which all
    lengths share; None without known lengths, and in files of earlier versions."""
    object_sigma: float | None = None
    """Standard deviation of the object's lengths, a fraction, as stated or assumed."""
    object_sigma_stated: bool = False
    weakest_camera: str
    held_out: Mapping[str, HeldOutErrors] = field(default_factory=dict)
    """On frames not fitted: as of `held_out.held_out`."""

    @property
    def to_expect(self) -> "RigFigures | HeldOutErrors":
        """The errors on whole runs of frames not fitted; of a recording without such, on frames not
        fitted; and if it is too short for that, on those fitted."""
        return self.held_out.get("runs") or self.held_out.get("frames") or self


@dataclass(frozen=True)
class Gap:
    """How far three pairs by themselves are from closing."""

    rotation_deg: float
    translation_m: float


@dataclass(frozen=True)
class Loop:
    """Three cameras whose three pairs were calibrated: in the rig they close."""

    cameras: tuple[str, str, str]
    rotation_deg: float
    translation_m: float
    before: Gap


@dataclass(frozen=True)
class ThirdCamera:
    """Median distances (px) of points of two cameras from their images in a third: before, with the
    three pairs by themselves, and after."""

    pair: tuple[str, str]
    camera: str
    points: int
    before: float
    after: float


@dataclass(frozen=True)
class PairOfRig:
    """What a pair by itself said; None, and no key in the file, if unknown."""

    cameras: tuple[str, str]
    bars: int
    """That both see."""
    frames: int | None = None
    noise_px: float | None = None
    failed: str | None = None
    """Why it could not be calibrated by itself."""
    fcp_reprojection: Mapping[str, float] | None = None
    """The forecast of its refined set: value, low and high; so the next ones."""
    median_error_3d: Mapping[str, float] | None = None
    p95_error_3d: Mapping[str, float] | None = None
    p95_metric_error_3d: Mapping[str, float] | None = None
    threshold_px: Mapping[str, float] | None = None


@dataclass(frozen=True, kw_only=True)
class AboutRig:
    """Entries of `rig.json`."""

    inputs: Mapping[str, Any] = field(default_factory=dict)
    """The `name` and the digest `sha256` of the recording."""
    object: Mapping[str, Any] = field(default_factory=dict)
    """The points (m) of the object by name, and the `factor` by which it was found longer."""
    figures: RigFigures | None = None
    """None in files of earlier versions that had no recording."""
    image_errors_px: Mapping[str, float | None] = field(default_factory=dict)
    """By camera; None if unknown."""
    frames_left_out: tuple[int, ...] = ()
    wrong_images: tuple[WrongImage, ...] = ()
    loops: tuple[Loop, ...] = ()
    third_camera_px: tuple[ThirdCamera, ...] = ()
    pairs: Mapping[str, PairOfRig]
    not_connected: Mapping[str, str] = field(default_factory=dict)
    """Cameras, and why."""
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The entries; of pairs only those that are known."""
        entries: dict[str, Any] = plain(self)
        for pair in entries["pairs"].values():
            for name in [name for name, value in pair.items() if value is None]:
                del pair[name]
        return entries
