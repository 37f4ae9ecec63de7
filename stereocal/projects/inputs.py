"""The inputs of a project: files and measured lengths."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np

from stereocal.errors import can_be_shown
from stereocal.rig.camera import CAMERAS, Camera, CameraName, LensUncertainty

Slot = Literal["primary", "secondary", "correspondences"]
LENGTHS = {"baseline_m": "the baseline", "target_distance_m": "the distance between the targets"}


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
    lens_known: Mapping[str, Sequence[float | None] | None] = field(default_factory=dict)
    """Camera to the standard deviations that the user stated: a fraction of the focal length, and
    pixels of the centre; used once both are given. None: not stated, whatever the camera's file
    says. A missing camera: as its file says."""
    planned: list[str] = field(default_factory=list)
    """The lengths, of `LENGTHS`, that a plan states and nobody has measured yet: still missing."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Slot to the SHA-256 of its file."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Slot to the name of the uploaded file."""
    exchanged: list[int] = field(default_factory=list)
    """Frames of the table whose targets the user has exchanged in the secondary image."""
    put_back: list[int] = field(default_factory=list)
    """Frames of the table that contradict the others, but that the user keeps."""
    left_out: list[int] = field(default_factory=list)
    """Frames of the table that the user leaves out."""

    def known(self, which: CameraName, camera: Camera) -> Camera:
        """A camera with the stated uncertainty instead of its file's.

        The standard errors of the distortion stay as in the file, or are 0.

        Raises:
            StereocalError: a negative number.
        """
        if which not in self.lens_known:
            return camera
        stated = self.lens_known[which]
        if stated is None or None in stated:
            return replace(camera, uncertainty=None)
        focal, centre = (float(value) for value in stated if value is not None)
        own = camera.uncertainty
        distortion = own.distortion if own else np.zeros_like(camera.distortion)
        fx, fy = focal * camera.K[0, 0], focal * camera.K[1, 1]
        return replace(camera, uncertainty=LensUncertainty(fx, fy, centre, centre, distortion))

    @property
    def missing(self) -> list[str]:
        """What is still missing, in words."""
        named = {
            "correspondences": "the table of points",
            "primary": "the primary camera's file",
            "secondary": "the secondary camera's file",
        }
        lacking = [words for slot, words in named.items() if slot not in self.files]
        for name, words in LENGTHS.items():
            metres = getattr(self, name)
            if name in self.needs_measuring:
                lacking.append(f"{words} as measured (planned: {metres:.12g} m)")
            elif metres is None and not (self.baseline_free and name == "baseline_m"):
                lacking.append(words)
        return lacking

    @property
    def needs_measuring(self) -> list[str]:
        """The planned lengths that a calibration would use."""
        return [name for name in self.planned if not (self.baseline_free and name == "baseline_m")]


def checked_inputs(data: Mapping[str, Any]) -> Inputs:
    """The inputs of a stored mapping.

    Raises:
        TypeError: a value has the wrong type.
    """
    inputs = Inputs(**data)
    check_inputs(inputs)
    return inputs


def check_inputs(inputs: Inputs) -> None:
    """Check the types of all values.

    Raises:
        TypeError: a value has the wrong type.
    """
    for mapping in (inputs.files, inputs.labels):
        if not isinstance(mapping, dict) or not all(map(can_be_shown, mapping.values())):
            raise TypeError(mapping)
    if not can_be_shown(inputs.name) or set(inputs.files) - set(inputs.labels):
        raise TypeError(inputs)
    frames = (*inputs.exchanged, *inputs.put_back, *inputs.left_out)
    if not all(isinstance(frame, int) for frame in frames):
        raise TypeError(inputs)
    if any(name not in LENGTHS or getattr(inputs, name) is None for name in inputs.planned):
        raise TypeError(inputs.planned)
    if not isinstance(inputs.baseline_free, bool):
        raise TypeError(inputs.baseline_free)
    _check_lens_known(inputs.lens_known)
    for each in fields(Inputs):
        value = getattr(inputs, each.name)
        if not each.name.endswith("_m") or value is None:
            continue
        if not isinstance(value, float | int) or abs(value) > sys.float_info.max:
            raise TypeError(each.name)


def _check_lens_known(known: object) -> None:
    if not isinstance(known, dict):
        raise TypeError(known)
    for which, stated in known.items():
        if which not in CAMERAS or not (
            stated is None or (len(stated) == 2 and all(map(_is_sigma, stated)))
        ):
            raise TypeError(stated)


def _is_sigma(value: object) -> bool:
    if value is None:
        return True
    return isinstance(value, float | int) and 0 <= value <= sys.float_info.max
