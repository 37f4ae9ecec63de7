"""Screening of a rig: a frame is seen in all cameras at once, so that the wrong image has a name.

Of two cameras that contradict each other nothing says which is wrong. Where more see a point, the
frame is tried without each marker, and then without each camera: if it fits without exactly one of
them, that one is wrong, and the rest of the frame stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class WrongImage:
    """What is wrong in a frame."""

    frame: int
    camera: str
    target: str | None
    """None: all that the camera saw in this frame."""
    exchanged: bool = False
    """Whether it fits with the two ends exchanged in this camera."""


@dataclass(frozen=True)
class _Trial:
    """A frame with something changed in a camera."""

    frame: int
    camera: int
    target: int
    """Without this one; -1 without all; -2 with the ends of each known length exchanged."""


def wrong_images(fit: RobustFit) -> list[WrongImage]:
    """What is wrong in the outlying frames of a fit, where exactly one image can be."""
    seen, names = fit.seen, list(fit.recording.cameras)
    wrong: list[WrongImage] = []
    bad = np.flatnonzero(fit.outlying)
    trials = [
        _Trial(int(frame), camera, target)
        for frame in bad
        for camera in range(len(names))
        for target in (*_targets(seen, int(frame), camera), -1, -2)
    ]
    fits = _fitting(fit, trials)
    for frame in bad:
        mine = [trial for trial, fits_ in zip(trials, fits, strict=True) if fits_]
        mine = [trial for trial in mine if trial.frame == frame]
        for is_one in (True, False):
            some = [
                trial for trial in mine if (trial.target >= 0 if is_one else trial.target == -1)
            ]
            if len(some) == 1:
                trial = some[0]
                both = trial.camera in {t.camera for t in mine if t.target == -2}
                target = fit.recording.object.names[trial.target] if is_one else None
                wrong.append(WrongImage(int(seen.frames[frame]), names[trial.camera], target, both))
            if some:
                break  # several: it cannot be told which
    return wrong


def rows_of(recording: Recording, wrong: Sequence[WrongImage]) -> BoolArray:
    """(n,): the rows of the images that are wrong."""
    names, targets = list(recording.cameras), recording.object.names
    wrong_rows = np.zeros(len(recording.frame), dtype=np.bool_)
    for image in wrong:
        mine = (recording.frame == image.frame) & (recording.camera == names.index(image.camera))
        if image.target is not None:
            mine &= recording.target == targets.index(image.target)
        wrong_rows |= mine
    return wrong_rows


def _fitting(fit: RobustFit, trials: list[_Trial]) -> list[bool]:
    """Which trials the parameters of a fit explain, with a contradiction left to find."""
    if not trials:
        return []
    units = [np.flatnonzero(fit.frame_of == trial.frame) for trial in trials]
    order = np.concatenate(units)
    of_trial = np.repeat(np.arange(len(trials)), [len(some) for some in units])
    seen = fit.seen
    pixels, rays, targets = seen.pixels[order], seen.rays[order], seen.targets[order]
    for number, trial in enumerate(trials):
        mine = of_trial == number
        for images in (pixels, rays):
            images[mine] = _changed(images[mine], targets[mine], trial)
    lone = np.isfinite(pixels[..., 0]).sum(axis=2) < 2
    pixels[lone], rays[lone] = np.nan, np.nan
    changed = replace(
        seen,
        frames=np.arange(len(trials)),
        frame_of=of_trial,
        targets=targets,
        pixels=pixels,
        rays=rays,
        motion=seen.motion[:0],
        distances=np.where(lone.any(axis=1), np.nan, seen.distances[order]),
    )
    unknowns = replace(fit.unknowns, origin=fit.begin.q)
    tried = RobustFit(changed, unknowns, fit.settings, fit.begin.R, fit.baselines)
    explained = tried.take(fit.p, fit.sigma_px, fit.scatter).explained()
    return [bool(fits) for fits in explained & (tried.pixel_freedom > 0)]


def _targets(seen: Observations, frame: int, camera: int) -> list[int]:
    """What a camera sees of a frame."""
    mine = seen.frame_of == frame
    targets: list[int] = seen.targets[mine][np.isfinite(seen.pixels[mine, :, camera, 0])].tolist()
    return targets


def _changed(images: FloatArray, targets: IntArray, trial: _Trial) -> FloatArray:
    """The images (m, 2, c, 2) of a frame's units after a trial."""
    changed = images.copy()
    if trial.target == -2:
        pairs = targets[:, 1] >= 0
        changed[pairs, :, trial.camera] = images[pairs, ::-1, trial.camera]
    elif trial.target == -1:
        changed[:, :, trial.camera] = np.nan
    else:
        changed[..., trial.camera, :][targets == trial.target] = np.nan
    return changed
