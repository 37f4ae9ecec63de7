"""Screening of a rig: a frame is seen in all cameras at once, so that the wrong image has a name.

Of two cameras that contradict each other nothing says which is wrong. Where more see a point, the
frame is tried without each marker, and then without each camera: if it fits without exactly one of
them, that one is wrong, and the rest of the frame stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereocal.network.fit import RigFit
from stereocal.refined.adjustment import equations_for, sum_normal_equations
from stereocal.refined.robust import frame_limits, unit_freedom
from stereocal.refined.views import OWN, Units
from stereocal.rig.compiled import BoolArray
from stereocal.rig.recording import Recording


@dataclass(frozen=True)
class WrongImage:
    """What is wrong in a frame."""

    frame: int
    camera: str
    target: str | None
    """None: all that the camera saw in this frame."""
    exchanged: bool = False
    """Whether it fits with the two ends exchanged in this camera."""


class _Trial(NamedTuple):
    """A frame with something changed in a camera."""

    frame: int
    camera: int
    target: int
    """Without this one; -1 without all; -2 with the ends of each known length exchanged."""


def wrong_images(fit: RigFit) -> list[WrongImage]:
    """What is wrong in the outlying frames of a fit, where exactly one image can be."""
    own, names = fit.placings, list(fit.recording.cameras)
    found: list[WrongImage] = []
    for frame in np.flatnonzero(fit.outlying).tolist():
        units = np.flatnonzero(own.of_frame == frame)
        trials = [
            _Trial(frame, camera, target)
            for camera in range(len(names))
            for target in (*own.targets[units][own.seen[units][..., camera]].tolist(), -1, -2)
        ]
        mine = [trial for trial, fits in zip(trials, _fitting(fit, trials), strict=True) if fits]
        exchanged = {trial.camera for trial in mine if trial.target == -2}
        # First single targets; several: it cannot be told which.
        some = [trial for trial in mine if trial.target >= 0]
        some = some or [trial for trial in mine if trial.target == -1]
        if len(some) == 1:
            _, camera, target = some[0]
            named = fit.recording.object.names[target] if target >= 0 else None
            is_exchanged = camera in exchanged
            found.append(WrongImage(int(own.frames[frame]), names[camera], named, is_exchanged))
    return found


def rows_of(recording: Recording, wrong: list[WrongImage]) -> BoolArray:
    """(n,): the rows of the images that are wrong."""
    names, targets = list(recording.cameras), recording.object.names
    found = np.zeros(len(recording.frame), dtype=np.bool_)
    for own in wrong:
        mine = (recording.frame == own.frame) & (recording.camera == names.index(own.camera))
        if own.target is not None:
            mine &= recording.target == targets.index(own.target)
        found |= mine
    return found


def _fitting(fit: RigFit, trials: list[_Trial]) -> BoolArray:
    """Which trials of a frame fit, with something left to contradict."""
    own = fit.placings
    units = np.flatnonzero(own.of_frame == trials[0].frame)
    count, targets = len(trials), own.targets[units]
    pixels, rays = (np.tile(of_fit[units], (count, 1, 1, 1)) for of_fit in (own.pixels, fit.rays))
    of_trial = np.repeat(np.arange(count), len(units))
    for images in (pixels, rays):
        for changed, (_, camera, target) in zip(np.split(images, count), trials, strict=True):
            if target == -2:
                pairs = targets[:, 1] >= 0
                changed[pairs, :, camera] = changed[pairs, ::-1, camera]
            else:
                changed[..., camera, :][(targets == target) | (target == -1)] = np.nan
    lone = np.isfinite(pixels[..., 0]).sum(axis=2) < 2
    pixels[lone], rays[lone] = np.nan, np.nan
    distances = np.where(lone.any(axis=1), np.nan, np.tile(own.distances[units], count))
    measured = Units(pixels, rays, fit.motion[:0], distances, 1 / fit.sigma_px, 1 / fit.scatter)
    n = len(pixels)
    limits, points, chi_squares = np.zeros(n), np.full((n, OWN), np.nan), np.empty(n)
    into = equations_for(fit.free)
    sum_normal_equations(fit.cameras, measured, limits, points, chi_squares, into)
    freedom = unit_freedom(pixels)
    limit = frame_limits(freedom + np.isfinite(distances), of_trial, len(fit.unknowns.names))
    fits = np.bincount(of_trial, chi_squares) <= limit
    return np.asarray(fits & (np.bincount(of_trial, freedom) > 0))
