"""The inputs of a project: files and measured lengths."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from stereocal.fit.start.baseline import with_baseline_found
from stereocal.formats.window_entry import window_entries, windows_in
from stereocal.rig.camera import CAMERAS, Camera, CameraName, LensUncertainty
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.window import StatedWindow
from stereocal.system.names import can_be_shown
from stereocal.system.records import of_plain

Slot = Literal["primary", "secondary", "correspondences"]
Length = Literal["baseline_m", "target_distance_m"]
FILES: dict[Slot, str] = {
    "correspondences": "the table of points",
    "primary": "the primary camera's file",
    "secondary": "the secondary camera's file",
}
LENGTHS: dict[Length, str] = {
    "baseline_m": "the baseline",
    "target_distance_m": "the distance between the targets",
}


@dataclass(frozen=True)
class Inputs:
    """The inputs so far; None for missing ones."""

    name: str = ""
    baseline_m: float | None = None
    target_distance_m: float | None = None
    baseline_sigma_m: float | None = None
    """Stated standard deviation of the baseline; None if not stated."""
    baseline_free: bool = False
    """Whether the baseline is not measured, but found from the lengths of the bars."""
    target_distance_sigma_m: float | None = None
    lens_known: Mapping[CameraName, tuple[float | None, float | None] | None] = field(
        default_factory=dict
    )
    """Camera to the standard deviations that the user stated: a fraction of the focal length, and
    pixels of the centre; used once both are given. None: not stated, whatever the camera's file
    says. A missing camera: as its file says."""
    planned: list[Length] = field(default_factory=list)
    """The lengths, of `LENGTHS`, that a plan states and nobody has measured yet: still missing."""
    files: Mapping[Slot, str] = field(default_factory=dict)
    """Slot to the SHA-256 of its file."""
    labels: Mapping[Slot, str] = field(default_factory=dict)
    """Slot to the name of the uploaded file."""
    baselines_m: Mapping[str, float] = field(default_factory=dict)
    """The measured baselines of three cameras and more by the name of their pair, in the place of
    those of the files."""
    exchanged: Mapping[str, list[int]] = field(default_factory=dict)
    """The frames in whose image the user has exchanged the targets, by camera."""
    put_back: list[int] = field(default_factory=list)
    """Frames of the table that contradict the others, but that the user keeps."""
    left_out: list[int] = field(default_factory=list)
    """Frames of the table that the user leaves out."""
    start_frame: int = 0
    """The start frame of the table, as of `Pair`."""
    step_notes: list[str] = field(default_factory=list)
    """How the table was brought into step, as of `Pair`."""
    windows: list[dict[str, Any]] | None = None
    """The windows that the cameras look through, as of `windows_in`; empty: none, whatever the
    files say; None: as they say."""

    def __post_init__(self) -> None:
        sigmas = [sigma for stated in self.lens_known.values() if stated for sigma in stated]
        sound = (
            all(map(can_be_shown, (self.name, *self.labels.values())))
            and self.files.keys() <= self.labels.keys()
            and all(getattr(self, name) is not None for name in self.planned)
            and all(map(can_be_shown, (*self.baselines_m, *self.exchanged)))
            and all(sigma is None or 0 <= sigma < math.inf for sigma in sigmas)
            and all("cameras" in window for window in self.windows or ())
        )
        if not sound:
            raise ValueError(self)

    def dataset(self, name: str, primary: Camera, secondary: Camera, rows: Correspondences) -> Pair:
        """The data set of complete inputs: the files as read, and what was stated.

        Args:
            name: used where the project has none.
        """
        rigid_object = rows.rigid_object
        measured = Recording.of_two(
            self.name or name,
            self._known("primary", primary),
            self._known("secondary", secondary),
            None if self.baseline_free else self.baseline_m or 0.0,
            rigid_object.longest_m if rigid_object else self.target_distance_m or 0.0,
            self.baseline_sigma_m,
            self.target_distance_sigma_m,
        )
        recording = replace(
            measured,
            start_frames={CAMERAS[1]: self.start_frame} if self.start_frame else {},
            step_notes=tuple(self.step_notes),
            windows=self._windows_of(measured),
        )
        dataset = recording.with_pairs(rows).pair(*CAMERAS)
        if exchanged := self.exchanged.get(CAMERAS[1]):
            dataset = dataset.with_targets_exchanged(exchanged)
        return dataset if dataset.recording.has_windows else with_baseline_found(dataset)

    def applied_to(self, as_read: Recording) -> Recording:
        """A recording of three cameras and more, of the files as read, with what was stated and
        corrected.

        Baselines that are stated replace those of the files together with their uncertainty.
        """
        held_object, sigma_m = as_read.object, self.target_distance_sigma_m
        recording = replace(
            as_read,
            name=self.name or as_read.name,
            object=held_object if sigma_m is None else replace(held_object, sigma_m=sigma_m),
        )
        if self.baseline_free:
            # Infinite: found from the lengths of the bar.
            recording = replace(recording, baselines_m={}, baseline_sigma_m=math.inf)
        elif self.baselines_m:
            measured = {recording.pair_named(pair): m for pair, m in self.baselines_m.items()}
            recording = replace(recording, baselines_m=measured, baseline_sigma_m=None)
        if self.baseline_sigma_m is not None and recording.baselines_m:
            recording = replace(recording, baseline_sigma_m=self.baseline_sigma_m)
        for camera, frames in self.exchanged.items():
            recording = recording.with_targets_exchanged(camera, frames)
        if self.windows is not None:
            recording = replace(recording, windows=self._windows_of(recording))
        return recording

    @property
    def stated_windows(self) -> tuple[StatedWindow, ...]:
        """What was stated of windows; empty if nothing was."""
        return of_plain(self.windows or [], tuple[StatedWindow, ...])

    def _windows_of(self, recording: Recording) -> tuple[StatedWindow, ...]:
        """Those stated of its cameras: others may have been given since."""
        known = [it for it in self.windows or () if {*it["cameras"]} <= {*recording.cameras}]
        return windows_in(known, recording.cameras)

    def _known(self, which: CameraName, camera: Camera) -> Camera:
        """A camera with the stated uncertainty instead of its file's.

        The standard errors of the distortion stay as in the file, or are 0.
        """
        if which not in self.lens_known:
            return camera
        focal, centre = self.lens_known[which] or (None, None)
        if focal is None or centre is None:
            return replace(camera, uncertainty=None)
        uncertainty = camera.uncertainty
        distortion = uncertainty.distortion if uncertainty else np.zeros_like(camera.distortion)
        fx, fy = focal * camera.K[0, 0], focal * camera.K[1, 1]
        return replace(camera, uncertainty=LensUncertainty(fx, fy, centre, centre, distortion))

    @property
    def missing(self) -> list[str]:
        """What is still missing, in words."""
        lacking = [words for slot, words in FILES.items() if slot not in self.files]
        for name, words in LENGTHS.items():
            metres = getattr(self, name)
            if name in self.needs_measuring:
                lacking.append(f"{words} as measured (planned: {metres:.12g} m)")
            elif metres is None and not (self.baseline_free and name == "baseline_m"):
                lacking.append(words)
        return lacking

    @property
    def needs_measuring(self) -> list[Length]:
        """The planned lengths that a calibration would use."""
        return [name for name in self.planned if not (self.baseline_free and name == "baseline_m")]


def inputs_of(stored: Mapping[str, Any]) -> Inputs:
    """Inputs as they are stored; earlier versions knew exchanged targets of the secondary only.

    Raises:
        TypeError, ValueError: these are none.
    """
    exchanged = stored.get("exchanged")
    by_camera = {CAMERAS[1]: exchanged} if isinstance(exchanged, list) and exchanged else exchanged
    return of_plain({**stored, "exchanged": by_camera or {}}, Inputs)


def stated_in(dataset: Pair) -> dict[str, Any]:
    """What a data set states beside its files, as values of the inputs."""
    free = dataset.baseline_is_free
    return {
        "name": dataset.name,
        "baseline_m": None if dataset.baseline_is_to_be_found else dataset.baseline_m,
        "baseline_free": free,
        "baseline_sigma_m": None if free else dataset.baseline_sigma_m,
        "target_distance_m": dataset.target_distance_m,
        "target_distance_sigma_m": dataset.target_distance_sigma_m,
        "start_frame": dataset.start_frame,
        "step_notes": [*dataset.recording.step_notes],
        "windows": window_entries(dataset.recording, CAMERAS) or None,
    }
