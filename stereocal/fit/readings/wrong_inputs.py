"""Which wrong input explains the points of a recording, if they do not fit as they were given.

Of more than `MOST_CAMERAS`, each camera is judged with those with which it shares most bars.
"""

from collections.abc import Collection, Iterator
from contextlib import suppress

import numpy as np

from stereocal.calibration.checks import LARGEST_SCALE_ERROR
from stereocal.calibration.corrections import fitting_px
from stereocal.calibration.wrong_inputs import MINIMUM_BARS, essential_fit, inconsistency_message
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.readings.judge import CERTAIN_GAIN, Judge
from stereocal.fit.readings.noise_left import (
    ALIKE,
    CLEAN_PX,
    HELD_LENGTHS,
    PARTS,
    NoiseLeft,
    fewer_points,
    largest_noise,
    noise_of,
)
from stereocal.fit.start.fuse import PairFit
from stereocal.fit.start.pairs import pairs_worth_a_fit, reached
from stereocal.rig.camera import camera_in_words, one_file_in_words
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.numbers import rounded

MOST_CAMERAS = 4


def check_inputs(
    recording: Recording,
    fit: RobustFit | None = None,
    pairs: Collection[PairFit] = (),
    out_of_step: bool = False,
) -> list[str]:
    """Reject inputs that are certainly wrong, though they fit; return warnings about those that
    may be.

    Args:
        fit: of all cameras, if there is one; and its pairs.
        out_of_step: as of `Judge`: no camera is named as possible then.
    """
    possible = list[str]()
    fits = fit is None or _fits(fit, min(pair.noise_px for pair in pairs))
    for judge in judges_of(recording, pairs, fit, out_of_step):
        if fits and not judge.suspected:
            continue
        judged = judge.explanations()
        if judge.named(judged, CERTAIN_GAIN):
            raise StereocalError(judge.message(judged))
        possible += judge.warnings(judged)
    return [] if out_of_step else list(dict.fromkeys(possible))


def find_wrong_input(recording: Recording, out_of_step: bool = False) -> str:
    """A message that names the wrong input if one explains the points; else empty.

    Args:
        out_of_step: as of `Judge`.
    """
    judges = judges_of(recording, out_of_step=out_of_step)
    messages = (judge.message(judge.judged(judge.every_reading())) for judge in judges)
    return next(filter(None, messages), "")


def instead_of_movement(recording: Recording) -> str:
    """A message that names a wrong input which looks like a camera that moved; else empty.

    It must leave no more noise than a part of the recording in time does as given, which a movement
    hardly disturbs: of a real recording in which a camera was turned, readings left 1.4 px and
    more, or 0.38 px of mirrored images, and its parts 0.2. Where no part fits, it must leave less
    than `CLEAN_PX`: of frames after which a simulated camera was turned, a reading left 1.2 px.
    """
    parts = np.array_split(np.unique(recording.frame), PARTS)
    of_parts = (recording.where(np.isin(recording.frame, part)) for part in parts)
    least_px = min(noise_of(fewer_points(part)).px for part in of_parts)
    limit_px = ALIKE * least_px if np.isfinite(least_px) else CLEAN_PX
    for judge in judges_of(recording):
        judged = judge.judged(judge.every_reading())
        if message := judge.message([it for it in judged if it.noise.px < limit_px]):
            return message
    return ""


def nothing_fits(dataset: Pair) -> str:
    """A message if no pose fits and `find_wrong_input` names nothing; else empty."""
    part = fewer_points(dataset.recording)
    nominal = noise_of(part)
    if (
        nominal.px < fitting_px(part.cameras.values())
        or len(dataset.correspondences.bars) < MINIMUM_BARS
    ):
        return ""
    to = f" better than to {rounded(nominal.px)} px" if np.isfinite(nominal.px) else ""
    return (
        f"{one_file_in_words((dataset.primary, dataset.secondary))}Nothing fits these points{to}. "
        "None of these explains it: camera files or targets exchanged, "
        "images mirrored or counted from below, frames and columns in another order, other signs "
        "and models of the distortion, image sizes, focal lengths and centres. Check that the "
        "points of a frame are of the same moment and of the same target in both cameras, that "
        "the cameras stood still, and both camera files."
    )


def _fits(fit: RobustFit, best_pair_px: float) -> bool:
    """Whether all cameras together leave noise, with lengths and lenses as they are stated."""
    scatter = fit.scatter / fit.recording.object.longest_m
    largest = largest_noise(fit.recording, best_pair_px)
    noise = NoiseLeft(fit.sigma_px, largest, fit.prior_cost)
    return noise.fits and scatter < HELD_LENGTHS and not fit.settings.lenses


def contradicting_lengths(recording: Recording) -> str:
    """A message if a measured baseline and the object cannot both be right; else empty."""
    for pair in () if recording.has_windows else recording.pairs:
        if recording.baseline_m(*pair) is None or recording.baseline_sigma_m == np.inf:
            continue
        with suppress(StereocalError):
            dataset = recording.pair(*pair)
            fit = essential_fit(dataset)
            if fit.only_scale_is_wrong and abs(np.log(fit.scale)) > np.log(LARGEST_SCALE_ERROR):
                both = camera_in_words(*pair, begins=True)
                return f"{both}: {inconsistency_message(dataset, fit)}"
    return ""


def judges_of(
    recording: Recording,
    known: Collection[PairFit] = (),
    fit: RobustFit | None = None,
    out_of_step: bool = False,
) -> Iterator[Judge]:
    """Judges of groups of cameras that share bars; of a large group, one for each camera. None
    behind windows, for a wrong input there is as good a reading of a window."""
    if recording.has_windows:
        return
    worth = pairs_worth_a_fit(recording)
    with suppress(StereocalError):  # a lens that cannot be inverted may be read otherwise
        if not worth or len(recording.pair(*worth[0]).correspondences.bars) < MINIMUM_BARS:
            return
    names = reached([*recording.cameras], worth)
    if 2 <= len(names) <= MOST_CAMERAS:
        yield Judge(recording, names, names, known, fit, out_of_step)
    for name in names if len(names) > MOST_CAMERAS else ():
        group = [name]
        while len(group) < MOST_CAMERAS:  # the camera that shares most bars with one of the group
            group += next({*pair} - {*group} for pair in worth if len({*pair} & {*group}) == 1)
        ordered = [camera for camera in names if camera in group]
        yield Judge(recording, ordered, [name], known, fit, out_of_step)
