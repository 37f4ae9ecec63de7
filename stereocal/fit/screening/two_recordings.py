"""Whether a recording is two: since some frame a camera stands elsewhere, or in some frames a bar
or a board of another size is held."""

from contextlib import suppress

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.screening.movement import Movement, movement
from stereocal.rig.lengths_in_words import word_of
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import count, rounded

FEWEST = 4
"""Frames of another size."""
OTHER_SIZE = 0.02
"""Least difference of the size of a board, in logarithms."""
ALIKE, MOST_ALIKE = 0.2, 0.8
"""Share of it by which frames of one board differ, and share of its frames that do not differ more.
"""
WORSE = 4.0
"""Times by which the residuals may differ of frames that show one board and another."""
MOST_NAMED = 10


def movement_of_pair(fit: RefinedResult) -> Movement | None:
    """The movement of one of two cameras among the frames of a fit, if there is one."""

    def fitted(frames: IntArray) -> RobustFit | None:
        with suppress(StereocalError):
            return refine(fit.dataset.of_frames(frames), fit.settings).fit
        return None

    return movement(fit.fit, fitted)


def camera_moved(fit: RefinedResult) -> str:
    """A message if a camera moved during a recording; else empty.

    Args:
        fit: a fit with wide priors, such as that of the screening.
    """
    moved = movement_of_pair(fit)
    if moved is None:
        return ""
    return (
        f"A camera moved between frames {moved.last} and {moved.first}: from then on the pose of "
        f"the cameras is another, by {moved.in_words}. Two cameras cannot tell which of them it "
        "was. Calibrate the frames before it and those after it each by themselves."
    )


def other_size(fit: RefinedResult, least: float = 0.0) -> str:
    """A message if some frames show a bar or a board of one other size; else empty.

    Args:
        least: share of the frames that must show it.
    """
    rows = fit.dataset.correspondences
    lengths = fit.apply(fit.dataset).reconstructed_lengths_m(fit.pose)
    logs = np.log(lengths / fit.dataset.bar_distances_m)
    frame_of = np.searchsorted(fit.frames, rows.frame[rows.bars[:, 0]])
    known = np.isfinite(logs)
    seen = np.bincount(frame_of[known], None, len(fit.frames))
    has, sums = seen > 0, np.bincount(frame_of[known], logs[known], len(fit.frames))
    frames, sizes = fit.frames[has], np.asarray(sums[has] / seen[has])
    others = _apart(sizes)
    if np.count_nonzero(others) < max(FEWEST, least * len(fit.frames)):
        return ""
    residuals = np.abs(fit.standardised_residuals)
    of_both = [
        float(np.median(residuals[np.isin(rows.frame, frames[group])]))
        for group in (others, ~others)
    ]
    if max(of_both) > WORSE * min(of_both):
        return ""
    factor = float(np.exp(np.median(sizes[others]) - np.median(sizes[~others])))
    named = ", ".join(map(str, frames[others][:MOST_NAMED]))
    named += ", ..." if np.count_nonzero(others) > MOST_NAMED else ""
    held = word_of(fit.dataset)
    return (
        f"In {count(int(np.count_nonzero(others)), 'frame')} ({named}) the {held} is "
        f"{rounded(factor, 3)} times as large as in the others: is it another "
        f"{held}? Give the frames of each as a recording of its own."
    )


def _apart(sizes: FloatArray) -> BoolArray:
    """(f,): which of sizes (f,), in logarithms, are of the smaller one of two groups, each of which
    scatters far less than they differ; none if there are no two."""
    order, none = np.argsort(sizes), np.zeros(len(sizes), dtype=np.bool_)
    if len(sizes) < 2 * FEWEST:
        return none
    sums, lower = np.cumsum(sizes[order]), np.arange(1, len(sizes))
    means = sums[:-1] / lower, (sums[-1] - sums[:-1]) / (len(sizes) - lower)
    between = lower * (len(sizes) - lower) * np.square(means[1] - means[0])
    low = none.copy()
    low[order[: lower[between.argmax()]]] = True
    # As many frames: those that the fit does not follow, whose sizes are farther from the stated.
    middles = [float(np.median(sizes[group])) for group in (low, ~low)]
    ranks = [
        (-np.count_nonzero(group), abs(m)) for group, m in zip((low, ~low), middles, strict=True)
    ]
    away = abs(middles[1] - middles[0])
    for group, middle in zip((low, ~low), middles, strict=True):
        alike = np.abs(sizes[group] - middle) < ALIKE * away
        if np.mean(alike) < MOST_ALIKE:
            return none
    return (low if ranks[0] > ranks[1] else ~low) if away > OTHER_SIZE else none
