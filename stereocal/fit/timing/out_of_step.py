"""Whether cameras are out of step though nobody asked: then the offset is applied, and reported.

The score test of a fit without an offset says whether it is worth a fit with one. That fit must
find it significant, and frames that were not fitted must fit better with it: bars that are waved
before a lens with errors of its own have residuals that follow the motion by chance.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from stereocal.calibration.corrections import fewer_corners
from stereocal.calibration.mistakes import counted_apart
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.timing.time_offset import (
    LARGEST,
    MAXIMUM_SIGMA,
    STEP,
    apparent_offset,
    drifting,
    first_value,
    fit_in_step,
    offset_note,
    usable_after,
)
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.tracks import COUNTED, WHOLE, TimeOffset

TRIED, SIGNIFICANT = 2.0, 5.0
"""Standard errors from which an offset is tried, and applied."""
POOR_PX, ALIKE = 1.0, 10.0
"""Noise above which an offset is tried in any case, and the design effect above which it need not
be significant: the derivatives say little of one by a frame and more."""
EXPLAINED = 0.05
"""An offset that explains less of the residuals is not applied. Measured on the real recording:
0.02 with a distortion of the wrong sign, 0.5 with an offset of 0.02 frames."""
SMALLEST = 0.01
"""In frames. A smaller offset is not applied: with frames that do not follow each other, other
errors gave offsets of 0.001 frames with far smaller standard errors."""
MOST_OUTLYING = 0.2
"""Of the frames, of a fit that explains them."""
PARTS = 5
"""Runs of frames, of which each is held out of a fit to the others."""


def with_offset_if_out_of_step(
    dataset: Pair, settings: RefineSettings, also_failing: bool = True
) -> tuple[RefinedResult, str]:
    """The fit, with the time offset if the cameras are out of step, and then a note in words.

    Args:
        settings: without an offset.
        also_failing: try the offset also where nothing fits without one.
    """
    failure: StereocalError | None = None
    try:
        recorded: RefinedResult | None = refine(dataset, settings)
    except StereocalError as error:
        if not also_failing:
            raise
        recorded, failure = None, error
    with_offset = None
    if recorded is None or _is_worth_trying(recorded):
        with suppress(StereocalError):
            with_offset = _certain_fit(dataset, settings)
    if with_offset is not None:
        note = f"The cameras are out of step. {offset_note(with_offset)}{_counted(with_offset)}"
        return with_offset, note
    if recorded is None:
        assert failure is not None
        raise failure
    return recorded, ""


def _certain_fit(dataset: Pair, settings: RefineSettings) -> RefinedResult | None:
    """The fit with the time offset; None if it is not certain.

    Of a board some corners come first: where most of their frames do not fit with an offset, or one
    is not seen, no more corners would tell one, and each of their fits takes many times as long.
    """
    few, start = fewer_corners(dataset), None
    if few is not dataset:
        fit = _fit_with_offset(few, settings)
        offset = fit.dataset.time_offset
        if (
            offset is None
            or fit.outlying.mean() > MOST_OUTLYING
            or not fit.time_offset.is_claimed(TRIED)
        ):
            return None
        start = replace(offset, drift=0.0), fit.pose
    fit = _fit_with_offset(dataset, settings, start)
    certain = _is_certain(fit) and _fits_held_out_frames(dataset, fit, settings)
    return fit if certain else None


def _fit_with_offset(
    dataset: Pair, settings: RefineSettings, start: tuple[TimeOffset, Pose | None] | None = None
) -> RefinedResult:
    """The fit with the time offset, from a first value that is searched for if None."""
    reference = dataset.correspondences.mean_time
    start = start or first_value(dataset, reference)
    return drifting(dataset, fit_in_step(dataset, replace(settings, time_offset=True), *start))


def _is_certain(fit: RefinedResult) -> bool:
    """Whether an offset is so significant, and so large, that it is applied unasked."""
    offset, degrees = fit.time_offset, fit.degrees_of_freedom[~fit.outlying].sum()
    if not 0.0 < offset.sigma < MAXIMUM_SIGMA or fit.outlying.mean() > MOST_OUTLYING:
        return False
    enough = max(SIGNIFICANT, float(EXPLAINED * degrees) ** 0.5)
    most = offset.most(fit.dataset.correspondences.time_frame)
    within = most >= SMALLEST and abs(offset.frames) <= LARGEST - STEP
    return within and offset.is_claimed(enough)


def _is_worth_trying(fit: RefinedResult) -> bool:
    """Whether a fit without an offset is poor, or leaves residuals that follow the motion."""
    offset = apparent_offset(fit)
    if offset is None:
        return False
    poor = fit.sigma_px.value > POOR_PX or fit.outlying.mean() > MOST_OUTLYING
    alike = fit.design_effect > ALIKE or offset.is_claimed(TRIED)
    return poor or (alike and offset.most(fit.dataset.correspondences.time_frame) >= SMALLEST)


def _fits_held_out_frames(dataset: Pair, fit: RefinedResult, settings: RefineSettings) -> bool:
    """Whether runs of frames fit better to the others with the offset than without one."""
    offset, noise = fit.dataset.time_offset, fit.sigma_px.value
    assert offset is not None
    shifted = usable_after(dataset, offset)
    used = fit.frames[~fit.outlying]
    if len(used) < PARTS:
        return False
    parts = [(part, np.setdiff1d(used, part)) for part in np.array_split(used, PARTS)]
    with_offset, offsets = 0.0, list[TimeOffset]()
    for part, rest in parts:
        try:
            fit_of_rest = refine(shifted.of_frames(rest), fit.settings, fit.pose, near=fit)
        except StereocalError:
            return False
        offsets.append(fit_of_rest.time_offset)
        with_offset += _chi_square(fit_of_rest, shifted.of_frames(part), noise)
    # The jackknife over runs, whose errors are alike.
    spread = (PARTS - 1) ** 0.5 * np.std(
        [(measured.frames, measured.drift) for measured in offsets], axis=0
    )
    measured = fit.time_offset
    if not (np.abs([measured.frames, measured.drift]) > SIGNIFICANT * spread).any():
        return False
    without = 0.0
    for part, rest in parts:  # mostly the first is enough; points out of step take long to fit
        try:
            fit_of_rest = refine(dataset.of_frames(rest), settings, fit.pose)
            without += _chi_square(fit_of_rest, dataset.of_frames(part), noise)
        except StereocalError:
            without = np.inf
        if with_offset < without:
            return True
    return False


def _chi_square(fit: RefinedResult, dataset: Pair, noise_px: float) -> float:
    """The chi-square of points of frames that were not fitted; infinite behind a camera."""
    solve = fit.fit_of(dataset)
    solve.sigma_px = noise_px
    solve.evaluate(np.zeros(len(solve.frames)))
    return float(solve.chi_squares.sum())


def _counted(fit: RefinedResult) -> str:
    """A sentence if the offset is a whole number of frames."""
    whole, rest = fit.time_offset.split()
    if not whole or abs(rest.frames) > WHOLE + COUNTED * rest.sigma:
        return ""
    return f" {counted_apart(fit.frames, whole)}"
