"""Whether a recording of boards is two: since some frame a camera stands elsewhere, or in some
frames a board of another size is held.

Each camera places a board by itself, so that a single frame has a pose of the cameras. A step in
these poses is judged against their differences from frame to frame. Errors of the lenses that
follow the places of the board make steps too: so both parts must also fit better, each by itself,
than the whole recording does.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.readings import fewer_corners
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
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
OTHER_SIZE = 0.02
"""Least difference of the size of a board, in logarithms, and the share of it by which frames of
one board differ."""
ALIKE = 0.2
MOST_NAMED = 10


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
    dataset = fit.dataset
    if dataset.board is None:
        return ""
    frames = dataset.correspondences.frames
    at = evenly_spread(len(frames), MOST_FRAMES)
    poses = _poses(fewer_corners(dataset.of_frames(frames[at])))
    start = _step(poses)
    if not start or not _parts_fit_better(fit, poses.frames[start]):
        return ""
    before, after = slice(start), slice(start, None)
    turn, place = (
        np.median(own[after], axis=0) - np.median(own[before], axis=0)
        for own in (poses.turns, poses.places)
    )
    return (
        f"A camera moved between frames {poses.frames[start - 1]} and {poses.frames[start]}: from "
        f"then on the pose of the cameras is another, by "
        f"{rounded(float(np.degrees(np.linalg.norm(turn))))} degrees and "
        f"{rounded(1000.0 * float(np.linalg.norm(place)))} mm. Two cameras cannot tell which of "
        "them it was. Calibrate the frames before it and those after it each by themselves."
    )


def other_size(fit: RefinedResult, out: BoolArray) -> str:
    """A message if frames that were left out show a bar or a board of one other size; else empty.

    Args:
        out: (f,): which frames of the fit contradict the others.
    """
    rows = fit.dataset.correspondences
    lengths = fit.apply(fit.dataset).reconstructed_lengths_m(fit.pose)
    logs = np.log(lengths / fit.dataset.bar_distances_m)
    at = np.searchsorted(fit.frames, rows.frame[rows.bars[:, 0]])
    known = np.isfinite(logs)
    with np.errstate(invalid="ignore"):
        sizes = np.bincount(at[known], logs[known], len(out)) / np.bincount(
            at[known], None, len(out)
        )
    others = out & (np.abs(sizes) > OTHER_SIZE)
    if np.count_nonzero(others) < max(FEWEST, 0.5 * np.count_nonzero(out)):
        return ""
    middle = float(np.median(sizes[others]))
    alike = others & (np.abs(sizes - middle) < ALIKE * abs(middle))
    if np.count_nonzero(alike) < 0.8 * np.count_nonzero(others) or out.all():
        return ""
    residuals = np.abs(fit.standardised_residuals)
    of_these, of_kept = (
        float(np.median(residuals[np.isin(rows.frame, fit.frames[own])])) for own in (alike, ~out)
    )
    if of_these > 2.0 * of_kept:
        return ""
    frames = fit.frames[alike].tolist()
    named = ", ".join(map(str, frames[:MOST_NAMED])) + (", ..." if frames[MOST_NAMED:] else "")
    held = "board" if fit.dataset.board else "bar"
    return (
        f"In {count(len(frames), 'frame')} ({named}) the {held} is "
        f"{rounded(float(np.exp(middle)), 3)} times as large as in the others: is it another "
        f"{held}? Give the frames of each as a recording of its own."
    )


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


def _parts_fit_better(fit: RefinedResult, first: int) -> bool:
    """Whether the frames before `first` and those from it on fit better each by themselves."""
    frames = fit.dataset.correspondences.frames
    parts = []
    for own in (frames[frames < first], frames[frames >= first]):
        try:
            parts.append(refine(fit.dataset.of_frames(own), fit.settings))
        except StereocalError:
            return False
    noise = min(float(part.sigma_px.value) for part in (fit, *parts))

    def cost(part: RefinedResult) -> float:
        limits = part.fit.limit
        return float(
            np.minimum(part.chi_squares * (part.sigma_px.value / noise) ** 2, limits).sum()
        )

    return cost(fit) > BETTER * sum(map(cost, parts))
