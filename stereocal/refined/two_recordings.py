"""Whether a recording is two: since some frame a camera stands elsewhere, or in some frames a bar
or a board of another size is held.

Each camera places a board by itself, so that a single frame has a pose of the cameras. A step in
these poses is judged against their differences from frame to frame. Of bars it is the frame from
which on another pose would explain the residuals, or most frames contradict the others. Errors of
the lenses that follow the places of the object make steps too: so both parts must also fit better,
each by itself, than the whole recording does; and bars of each must be predicted far worse by the
other than the halves of each predict each other.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import fewer_corners
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.robust import RobustFit
from stereocal.refined.two_views import BASELINE
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.lengths_in_words import word_of
from stereocal.rig.rigid_object import placed
from stereocal.system.numbers import count, rounded
from stereocal.system.sampling import evenly_spread

FEWEST = 4
"""Frames before and after a step."""
STEP = 100.0
"""Squared step of the median pose, in its standard errors, from which both parts are fitted. 40
simulated pairs with 20 boards that stood still: 140 at most; turned by 0.3 degrees half-way: 70 to
5,000, by 2 degrees: 1,500 and more."""
KEPT = 0.8
"""Share of the differences of neighbouring poses by which their covariance is found; that of normal
ones is so many times larger."""
OF_ALL = 1.35
OF_MEDIANS = 0.5 * np.pi
"""Variance of a median over that of a mean."""
BETTER = 1.3
"""How many times the chi-square of both parts is that of the whole recording. Of 12 pairs that
stood still 1.03 at most, turned by 0.3 degrees 1.4 to 12, by 1 degree 3.8 to 12."""
MOST_FRAMES = 200
FEWEST_BARS, BLOCKS = 16, 16
"""Frames of bars that tell of a movement, and into how many parts they are divided to find it."""
LEFT_OUT, EXPLAINED = 3.0, 30.0
"""Standard errors by which more frames are left out after a step of bars than before it, or the
other way round; or the chi-square, of 6 values, that another pose explains. Bars that stood still
before exact lenses: 20 at most, of 54 recordings; turned by 0.2 degrees half-way: 36 and more."""
BETTER_BARS, APART = 2.5, 2.5
"""Of bars, as `BETTER`, and how many times worse the parts predict each other than their halves do.
Parts of real recordings that stood still: (1.6, 1.9) and (2.2, 1.2) at most; simulated ones with
lenses off by up to 1 px: (1.6, 0.3) and (1.2, 4.2); turned by 0.2 degrees, with 60 frames and more:
2.6 and 2.8 at least."""
OF_PART, BY_ITSELF, APART_PART = 0.7, 0.2, 5.0
"""Or: least share of the frames of a part that are left out of the whole, largest share by itself,
and then as `APART`. The real recording: turned by 0.3 or 1 degree before its last or first 31 to 88
frames 1.0, at most 0.02 and at least 6.8; no part of it as it is has more than 0.1 and 3.7."""
OTHER_SIZE = 0.02
"""Least difference of the size of a board, in logarithms."""
ALIKE, MOST_ALIKE = 0.2, 0.8
"""Share of it by which frames of one board differ, and share of its frames that do not differ more.
"""
WORSE = 4.0
"""Times by which the residuals may differ of frames that show one board and another."""
MOST_NAMED = 10
Fit = TypeVar("Fit")


class _Poses(NamedTuple):
    """The poses of the secondary camera that single frames give."""

    frames: IntArray
    turns: FloatArray
    """(f, 3): from a typical one, as rotation vectors."""
    places: FloatArray
    """(f, 3): translations, in metres."""
    depth: float


def two_recordings(fit: RefinedResult) -> str:
    """What differs between two parts of a recording of boards; empty if they are one.

    Args:
        fit: a fit with wide priors, such as that of the screening.
    """
    if fit.dataset.board is None:
        return _moved_before_bars(fit)
    frames = fit.dataset.correspondences.frames
    at = evenly_spread(len(frames), MOST_FRAMES)
    poses = _poses(fewer_corners(fit.dataset.of_frames(frames[at])))
    if not (start := _step(poses)):
        return ""
    first = int(poses.frames[start])
    if not _fits_better(fit, _parts(fit, first), BETTER):
        return ""
    before, after = slice(start), slice(start, None)
    turn, place = (
        np.median(own[after], axis=0) - np.median(own[before], axis=0)
        for own in (poses.turns, poses.places)
    )
    return _moved(int(poses.frames[start - 1]), first, turn, place)


def _moved(last: int, first: int, turn: FloatArray, place: FloatArray) -> str:
    return (
        f"A camera moved between frames {last} and {first}: from "
        f"then on the pose of the cameras is another, by "
        f"{rounded(float(np.degrees(np.linalg.norm(turn))))} degrees and "
        f"{rounded(1000.0 * float(np.linalg.norm(place)))} mm. Two cameras cannot tell which of "
        "them it was. Calibrate the frames before it and those after it each by themselves."
    )


def _moved_before_bars(fit: RefinedResult) -> str:
    """The message of `two_recordings` on bars and single targets."""
    frames = fit.frames
    if len(frames) < FEWEST_BARS:
        return ""
    for first in _steps_of_bars(fit):
        parts = _parts(fit, first)
        least = APART if _fits_better(fit, parts, BETTER_BARS) else APART_PART
        if least == APART_PART and not _left_out_as_one(fit, parts):
            continue
        if _predict_each_other(fit, parts) > least:
            one, other = (part.pose for part in parts)
            turn = Rotation.from_matrix(other.R @ one.R.T).as_rotvec()
            first = _first_after(fit, parts)
            last = int(frames[frames < first][-1])
            return _moved(last, first, turn, other.T - one.T)
    return ""


def _left_out_as_one(fit: RefinedResult, parts: Sequence[RefinedResult]) -> bool:
    """Whether nearly all frames of a part are left out of the whole, and fit as well by themselves
    as the others do."""
    for part in parts:
        of_whole = float(fit.outlying[np.isin(fit.frames, part.frames)].mean())
        noise = part.sigma_px.value / fit.sigma_px.value
        if (
            of_whole > OF_PART
            and part.outlying.mean() < BY_ITSELF
            and noise < 2.0
            and len(part.frames) >= FEWEST_BARS
        ):
            return True
    return False


def _steps_of_bars(fit: RefinedResult) -> Iterator[int]:
    """The frames from which on a camera may stand elsewhere: where the share of the frames left out
    changes most, and where another pose explains most of the residuals."""
    starts = np.arange(FEWEST, len(fit.frames) - FEWEST + 1)
    out, total = np.cumsum(fit.outlying), len(fit.frames)
    share = out[-1] / total
    if share:
        apart = np.abs(out[starts - 1] - starts * share)
        apart *= np.sqrt(
            total / (starts * (total - starts) * share * max(1.0 - share, 1.0 / total))
        )
        if apart.max() > LEFT_OUT:
            yield int(fit.frames[starts[apart.argmax()]])
    blocks = np.array_split(fit.used, min(BLOCKS, len(fit.used) // 2))
    if len(blocks) > 2:
        of_pose, M = slice(BASELINE + 1), fit.unknowns.M
        H, g, _ = fit.fit.equations(fit.q, blocks)
        H, g = (each[::-1].cumsum(axis=0)[::-1][:, of_pose] for each in (H, g))
        C = fit.unknowns.covariance(fit.information)
        informed = H[:, :, of_pose] - H @ (M @ C @ M.T) @ H.transpose(0, 2, 1)
        explained = np.einsum("si,sij,sj->s", g, np.linalg.pinv(informed, hermitian=True), g)
        start = 2 + int(explained[2:-1].argmax()) if len(blocks) > 3 else 0
        if explained[start] > EXPLAINED and start:
            yield int(fit.frames[blocks[start][0]])


def _first_after(fit: RefinedResult, parts: Sequence[RefinedResult]) -> int:
    """The frame from which on the second of two fits explains the frames best."""
    before, after = (_costs_of(part.fit_of(fit.dataset)) for part in parts)
    gain = np.cumsum((before - after)[::-1])[::-1]
    return int(fit.frames[1 + gain[1:].argmax()])


def _costs_of(fit: RobustFit) -> FloatArray:
    """(f,): the chi-squares of the frames, up to the limit of those that are left out."""
    fit.explained()
    return np.asarray(np.minimum(fit.chi_squares, fit.limit))


def _predict_each_other(fit: RefinedResult, parts: Sequence[RefinedResult]) -> float:
    """As `predict_each_other`, by distances from epipolar lines; fewer frames than `FEWEST_BARS`
    fit too well to predict others."""

    def fitted(frames: IntArray) -> RefinedResult | None:
        with suppress(StereocalError):
            return refine(fit.dataset.of_frames(frames), fit.settings)
        return None

    def error(of: RefinedResult, frames: IntArray) -> float:
        rows = fit.dataset.of_frames(frames).correspondences
        return float(np.nanmedian(np.abs(of.rig.epipolar_errors(rows.primary, rows.secondary))))

    return predict_each_other([part.frames for part in parts], fitted, error, FEWEST_BARS)


def predict_each_other(
    parts: Sequence[IntArray],
    fitted: Callable[[IntArray], Fit | None],
    error: Callable[[Fit, IntArray], float],
    fewest: int = 2,
) -> float:
    """How many times worse two parts predict each other than the halves of each do.

    Args:
        parts: their frames.
        fitted: a fit of some frames; None if it fails.
        error: the median error of a fit on some frames.
        fewest: frames of a part that is divided into halves.
    """

    def ratio(pair: Sequence[IntArray]) -> float:
        """How many times worse frames are predicted by the other fit than by their own, the smaller
        factor of the two; 1 where one fails."""
        one, other = map(fitted, pair)
        if one is None or other is None:
            return 1.0
        both = zip(pair, (one, other), (other, one), strict=True)
        return min(error(other, own) / max(error(one, own), 1e-12) for own, one, other in both)

    halves = (np.array_split(part, 2) for part in parts if len(part) >= fewest)
    return ratio(parts) / max([1.0, *map(ratio, halves)])


def other_size(fit: RefinedResult, least: float = 0.0) -> str:
    """A message if some frames show a bar or a board of one other size; else empty.

    Args:
        least: share of the frames that must show it.
    """
    rows = fit.dataset.correspondences
    lengths = fit.apply(fit.dataset).reconstructed_lengths_m(fit.pose)
    logs = np.log(lengths / fit.dataset.bar_distances_m)
    at = np.searchsorted(fit.frames, rows.frame[rows.bars[:, 0]])
    known = np.isfinite(logs)
    seen = np.bincount(at[known], None, len(fit.frames))
    has, sums = seen > 0, np.bincount(at[known], logs[known], len(fit.frames))
    frames, sizes = fit.frames[has], np.asarray(sums[has] / seen[has])
    others = _apart(sizes)
    if np.count_nonzero(others) < max(FEWEST, least * len(fit.frames)):
        return ""
    residuals = np.abs(fit.standardised_residuals)
    of_both = [
        float(np.median(residuals[np.isin(rows.frame, frames[own])])) for own in (others, ~others)
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
    middles = [float(np.median(sizes[own])) for own in (low, ~low)]
    ranks = [(-np.count_nonzero(own), abs(m)) for own, m in zip((low, ~low), middles, strict=True)]
    away = abs(middles[1] - middles[0])
    for own, middle in zip((low, ~low), middles, strict=True):
        alike = np.abs(sizes[own] - middle) < ALIKE * away
        if np.mean(alike) < MOST_ALIKE:
            return none
    return (low if ranks[0] > ranks[1] else ~low) if away > OTHER_SIZE else none


def _poses(dataset: Dataset) -> _Poses:
    rows = dataset.correspondences
    assert rows.rigid_object is not None
    own = rows.rigid_object.points[rows.target]
    first, second = (placed(rows.frame, own, rays) for rays in np.split(dataset.rays, 2))
    frames, turns, places = [], list[Rotation](), []
    for frame in rows.frames:
        a, b = (points[rows.frame == frame] for points in (first, second))
        if np.isfinite(a).all() and np.isfinite(b).all():
            turn, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
            frames.append(frame)
            turns.append(turn)
            places.append(b.mean(axis=0) - turn.apply(a.mean(axis=0)))
    if not frames:
        return _Poses(rows.frames[:0], np.empty((0, 3)), np.empty((0, 3)), 1.0)
    all_turns = Rotation.concatenate(turns)
    apart = np.array([(all_turns * turn.inv()).magnitude() for turn in turns])
    typical = turns[int(np.median(apart, axis=1).argmin())]
    depth = float(np.nanmedian(np.concatenate([first[:, 2], second[:, 2]])))
    vectors = (all_turns * typical.inv()).as_rotvec()
    return _Poses(np.array(frames), vectors, np.array(places), depth)


def _step(poses: _Poses) -> int:
    """The index of the first frame after a step of the poses; 0 without one."""
    count = len(poses.frames)
    if count < 2 * FEWEST:
        return 0
    x = np.column_stack([poses.turns, poses.places / poses.depth])
    changes = np.diff(x, axis=0) / np.sqrt(2.0)
    C = changes.T @ changes / len(changes)
    for _ in range(5):
        sizes = np.einsum("fi,ij,fj->f", changes, np.linalg.pinv(C, hermitian=True), changes)
        kept = changes[sizes <= np.quantile(sizes, KEPT)]
        C = OF_ALL * kept.T @ kept / len(kept)
    inverse, best, found = np.linalg.pinv(C, hermitian=True), STEP, 0
    for start in range(FEWEST, count - FEWEST + 1):
        step = np.median(x[start:], axis=0) - np.median(x[:start], axis=0)
        size = float(step @ inverse @ step) * start * (count - start) / count / OF_MEDIANS
        if size > best:
            best, found = size, start
    return found


def _parts(fit: RefinedResult, first: int) -> list[RefinedResult]:
    """Fits of the frames before `first` and of those from it on; empty where one fails."""
    frames = fit.dataset.correspondences.frames
    try:
        return [
            refine(fit.dataset.of_frames(own), fit.settings)
            for own in (frames[frames < first], frames[frames >= first])
        ]
    except StereocalError:
        return []


def _fits_better(fit: RefinedResult, parts: Sequence[RefinedResult], factor: float) -> bool:
    """Whether the parts of a recording fit so many times better each by themselves."""
    noise = min(float(part.sigma_px.value) for part in (fit, *parts))

    def cost(part: RefinedResult) -> float:
        limits = part.fit.limit
        return float(
            np.minimum(part.chi_squares * (part.sigma_px.value / noise) ** 2, limits).sum()
        )

    return bool(parts) and cost(fit) > factor * sum(map(cost, parts))
