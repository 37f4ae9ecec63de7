"""Frames that one camera lost, or has twice: from there on its count is ahead, or behind."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from stereocal.calibration.corrections import with_files, with_frames
from stereocal.calibration.mistakes import CORRECT_FROM, FEWEST_TO_SHIFT, SHIFTS
from stereocal.calibration.reading import Group, Reading, Row, Way, readings_of
from stereocal.errors import StereocalError
from stereocal.fit.readings.noise_left import fewer_points, fit_of_pair
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.pairs import pairs_worth_a_fit
from stereocal.rig.camera import camera_in_words, pixel_scales
from stereocal.rig.geometry import reprojection_errors_of_rays, stack_rays
from stereocal.rig.recording import CameraPair, Recording
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count

FITTING, LEAST_FITTING_PX = 4.0, 1.0
"""Errors of a frame that count as not fitting: so many times the noise of those that fit."""
PART = 0.4
"""Share of the frames that are the first, or the last."""
EXPLAINED = 0.5
"""Largest share of the errors at the best single count that a step may leave."""


def lost_frames(recording: Recording, group: Group) -> Iterator[Way]:
    """The step of a camera's count after which most frames fit, by robust poses of the pair: of all
    frames, of the first and of the last, since a slow object fits a compromise of both counts."""
    camera, common = group.names[0], recording.common_frames(*group.pair)
    if len(common) < 2 * FEWEST_TO_SHIFT or recording.object.board is not None:
        return
    part = max(int(PART * len(common)), FEWEST_TO_SHIFT)
    steps = [
        step
        for chosen in (common, common[:part], common[-part:])
        for step in _steps(recording, group.pair, common, chosen)
    ]
    if not steps:
        return
    step = min(steps)
    every, first = np.unique(recording.frame), int(common[step.place])
    before = every < first
    taken = every + (step.ahead * before if step.is_before else -step.ahead * ~before)
    # What it lost is nowhere, and of what it has twice one is left out.
    kept = before == (taken < first)
    corrected = partial(with_frames, recording, camera, every[kept], taken[kept])
    words = _in_words(camera, group.pair[0], step.ahead, len(recording.cameras) == 2)
    yield Way(corrected, {"from": f"{first}", **words})


class _Step(NamedTuple):
    """A step of a count."""

    error: float
    """Sum of the squares of the errors that are left, over the largest."""
    place: int
    """Of its first frame."""
    ahead: int
    """By how many frames the count is ahead from there on."""
    is_before: bool
    """Whether the frames before it are those to correct, for the pose that was taken."""


def _steps(
    recording: Recording, pair: CameraPair, common: IntArray, chosen: IntArray
) -> Iterator[_Step]:
    """Steps that explain enough, by the pose of some frames."""
    two = recording.of_cameras(pair)
    try:
        part = fewer_points(two.where(np.isin(two.frame, chosen)))
        fit = fit_of_pair(part, pair, {}, {})
    except StereocalError:
        return
    fitted = with_files(two, dict(zip(pair, (fit.primary, fit.secondary), strict=True)))
    rays = fitted.images(fitted.rays)
    limit_px = max(FITTING * fit.sigma_px.value, LEAST_FITTING_PX)
    # Squares, so that noise hardly counts where the step is near one end.
    counts = (0, *SHIFTS)
    errors = {ahead: np.square(_errors(rays, fit, common, ahead, limit_px)) for ahead in counts}
    at_one_count = min(float(of_count.sum()) for of_count in errors.values())
    for ahead in SHIFTS:
        for is_before, before, after in (
            (False, errors[0], errors[ahead]),
            (True, errors[-ahead], errors[0]),
        ):
            error, place = _best_step(before, after)
            if error < EXPLAINED * at_one_count:
                yield _Step(error, place, ahead, is_before)


def _in_words(camera: str, other: str, ahead: int, are_two: bool) -> dict[str, str]:
    """Of two cameras either may have lost what the other has, of more the one that differs."""
    frames = count(abs(ahead), "frame")
    its, others = (f"lost {frames}", f"has {frames} twice")[:: 1 if ahead > 0 else -1]
    others = f", or {camera_in_words(other)} {others}" if are_two else ""
    beside = camera_in_words(other) if are_two else "the others"
    return {
        "who": camera_in_words(camera),
        "apart": f"{frames} {'ahead of' if ahead > 0 else 'behind'} {beside}",
        "reason": f"it {its} there{others}",
    }


def _best_step(before: FloatArray, after: FloatArray) -> tuple[float, int]:
    """The least sum of errors (f,) that are those of `before` up to some frame and those of `after`
    from it on, and its place."""
    sums = np.append(0.0, np.cumsum(before)) + np.append(np.cumsum(after[::-1])[::-1], 0.0)
    places = np.arange(FEWEST_TO_SHIFT, len(before) - FEWEST_TO_SHIFT + 1)
    place = int(places[sums[places].argmin()])
    return float(sums[place]), place


def _errors(
    rays: tuple[IntArray, FloatArray],
    fit: RefinedResult,
    common: IntArray,
    ahead: int,
    limit_px: float,
) -> FloatArray:
    """(f,): the largest reprojection error in each common frame if the second camera's count is so
    many frames ahead, over `limit_px` and at most 1; 0.5 where it is not known.

    Args:
        rays: frame numbers (n,), and normalised points (n, k, 2, 2) of both cameras.
    """
    frames, points = rays
    first = points[np.searchsorted(frames, common), :, 0]
    place = np.searchsorted(frames, common - ahead).clip(max=len(frames) - 1)
    second = np.where((frames[place] == common - ahead)[:, None, None], points[place, :, 1], np.nan)
    seen = np.isfinite(first).all(axis=2) & np.isfinite(second).all(axis=2)
    both = stack_rays(first[seen], second[seen])
    scales = pixel_scales((fit.primary, fit.secondary))
    px = reprojection_errors_of_rays(fit.pose.R, fit.pose.T, both, scales).mean(axis=1)
    errors = np.full(seen.shape, -np.inf)
    errors[seen] = np.where(np.isfinite(px), np.minimum(px / limit_px, 1.0), 1.0)
    largest = np.asarray(errors.max(axis=1))
    return np.where(np.isfinite(largest), largest, 0.5)


LOST = Row(
    "From frame {from} on {who} seems to be {apart}: {reason}",
    CORRECT_FROM,
    "one",
    lost_frames,
    "bars and wands",
    least_gain=2.0,
)


def lost_in_step(recording: Recording) -> str:
    """Which camera of a recording that was brought into step lost frames, or has some twice, from
    which of its own frames on; empty if none did.

    Of three cameras and more it is the one that shows it with most others, two at least.
    """
    names, readings = [*recording.cameras], dict[str, list[Reading]]()
    for pair in pairs_worth_a_fit(recording):
        for group in (Group((pair[1],), pair), Group((pair[0],), pair[::-1]))[: len(names) - 1]:
            few = readings.setdefault(group.names[0], [])
            few += readings_of(recording, [LOST], [group], names)
    camera = max(readings, key=lambda name: len(readings[name]), default="")
    if not camera or len(readings[camera]) < min(len(names) - 1, 2):
        return ""
    reading = readings[camera][0]
    first = int(reading.words["from"]) - recording.start_frames.get(camera, 0)
    by_its_count = replace(reading, words={**reading.words, "from": f"{first}"})
    return f"{by_its_count.claim}. {by_its_count.remedy}"
