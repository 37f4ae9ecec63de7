"""The Monte Carlo search over the five angles of a rig (paper, Section 3.2, Steps 1 to 6).

One search handles every cost in `costs`. The paper does not say when the acceptance ratio is
checked; here, after `minimum_moves` trials. After a single trial the ratio is 0 or 1, so nearly
every rejection would shrink the step; `minimum_moves=1` follows the paper literally.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocal.calibration import costs
from stereocal.errors import StereocalError
from stereocal.rig.compilations import clock
from stereocal.rig.compiled import FloatArray, compiled, contiguous
from stereocal.rig.geometry import Angles, Pose, fill_pose

STEP_TOO_SMALL = "the step fell below its smallest size"
OUT_OF_MOVES = "the largest number of moves was reached"


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the search; the defaults are the paper's, where the paper gives one.

    Raises:
        StereocalError: a value outside its range.
    """

    delta: float = 1e-3
    """Initial step, in radians (paper: 0.001)."""
    delta_min: float = 1e-6
    """The search ends when the step falls below this, in radians (paper: 1e-6)."""
    acceptance: float = 0.2
    """The step shrinks when the acceptance ratio falls below this (paper: 0.2)."""
    shrink: float = 0.75
    """Factor by which the step shrinks (paper: 0.75)."""
    minimum_moves: int = 20
    """Trials with one step before the acceptance ratio is checked (paper: 1, implied)."""
    maximum_moves: int = 2_000_000
    """Limit of the number of trials (paper: none)."""
    seed: int = 0

    def __post_init__(self) -> None:
        for name, valid, allowed in (
            ("delta", 0 < self.delta <= 0.5, "above 0 and at most 0.5 rad"),
            ("delta_min", 1e-12 <= self.delta_min <= self.delta, "from 1e-12 rad to delta"),
            ("acceptance", 0 < self.acceptance < 1, "between 0 and 1"),
            ("shrink", 0.01 <= self.shrink <= 0.99, "from 0.01 to 0.99"),
            ("minimum_moves", 1 <= self.minimum_moves <= 100_000, "from 1 to 100000"),
            ("maximum_moves", self.maximum_moves >= 1, "at least 1"),
            ("seed", 0 <= self.seed < 2**63, "a whole number from 0 to 2^63 - 1"),
        ):
            if not valid:
                raise StereocalError(f"{name} is {getattr(self, name)}: it must be {allowed}.")


@dataclass(frozen=True, eq=False)
class Trace:
    """The history of a search: one entry per move, arrays of shape (moves,)."""

    cost: FloatArray
    """Cost after the move, in the cost's unit."""
    delta: FloatArray
    """Size of the step, in radians."""
    ratio: FloatArray
    """Acceptance ratio: accepted over tried moves since the step last shrank."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search, with its settings and the reason why it stopped."""

    pose: Pose
    cost: float
    """In pixels for the 2D cost, in metres for the 3D costs."""
    initial_cost: float
    evaluations: int
    """Number of evaluations of the cost."""
    stop_reason: str
    seconds: float
    settings: SearchSettings
    trace: Trace | None


@dataclass(frozen=True, eq=False)
class Problem:
    """A cost and its data, with the arrays described in `costs`."""

    kind: int
    rays: FloatArray
    reference: FloatArray
    pixel_scale: FloatArray

    def cost(self, pose: Pose) -> float:
        """The cost of a pose; NaN if a point cannot be reconstructed in front of both cameras."""
        R, T = contiguous(pose.R), contiguous(pose.T)
        return costs.cost(self.kind, R, T, self.rays, self.reference, self.pixel_scale)


def minimise(
    problem: Problem,
    start: Pose,
    settings: SearchSettings,
    seed: np.random.SeedSequence | None = None,
    trace: bool = False,
) -> SearchResult:
    """Minimise the cost over the five angles, starting at `start` and keeping its baseline.

    Args:
        seed: `SeedSequence(settings.seed)` if None.
        trace: record every move. The search then runs a second time with the same random numbers,
            because the length of the record is not known before.

    Raises:
        StereocalError: at the start, a point is behind a camera.
    """
    started = clock()
    initial_cost = problem.cost(start)
    if not np.isfinite(initial_cost):
        raise StereocalError(
            "The search cannot start: with the first estimate a point is behind a camera."
        )
    sequence = seed or np.random.SeedSequence(settings.seed)
    angles = np.array(start.angles)
    cost, evaluations, stopped = _run(problem, start, settings, sequence, angles, 0)[:3]
    seconds = clock() - started
    record = None
    if trace:
        again = np.array(start.angles)
        history = _run(problem, start, settings, sequence, again, evaluations - 1)[3]
        record = Trace(history[0], history[1], history[2])
    return SearchResult(
        pose=Pose.from_angles(Angles(*angles.tolist()), start.baseline),
        cost=cost,
        initial_cost=initial_cost,
        evaluations=evaluations,
        stop_reason=STEP_TOO_SMALL if stopped else OUT_OF_MOVES,
        seconds=seconds,
        settings=settings,
        trace=record,
    )


def _run(
    problem: Problem,
    start: Pose,
    settings: SearchSettings,
    sequence: np.random.SeedSequence,
    angles: FloatArray,
    history_length: int,
) -> tuple[float, int, bool, FloatArray]:
    """Run one search; `angles` holds the start and is overwritten with the result."""
    history = np.empty((3, history_length))
    cost, evaluations, stopped = search(
        problem.kind,
        angles,
        start.baseline,
        problem.rays,
        problem.reference,
        problem.pixel_scale,
        np.random.Generator(np.random.PCG64(sequence)),
        settings.delta,
        settings.delta_min,
        settings.acceptance,
        settings.shrink,
        settings.minimum_moves,
        settings.maximum_moves,
        history,
    )
    return cost, evaluations, stopped, history


@compiled
def search(
    kind: int,
    angles: FloatArray,
    baseline: float,
    rays: FloatArray,
    reference: FloatArray,
    pixel_scale: FloatArray,
    rng: np.random.Generator,
    delta: float,
    delta_min: float,
    acceptance: float,
    shrink: float,
    minimum_moves: int,
    maximum_moves: int,
    history: FloatArray,
) -> tuple[float, int, bool]:
    """The search, in place on `angles`.

    Returns the cost, the number of evaluations, and whether the step fell below `delta_min`.
    """
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(angles, baseline, R, T)
    best = costs.cost(kind, R, T, rays, reference, pixel_scale)
    tried = accepted = moves = 0
    while delta >= delta_min and moves < maximum_moves:
        draw = rng.integers(0, 10)  # Steps 1 and 2: one of five angles, one of two signs
        chosen = draw >> 1
        before = angles[chosen]
        angles[chosen] = before + (delta if draw & 1 else -delta)
        fill_pose(angles, baseline, R, T)  # Steps 3 and 4
        candidate = costs.cost(kind, R, T, rays, reference, pixel_scale)  # Step 5
        tried += 1
        if candidate < best:
            best = candidate
            accepted += 1
        else:
            angles[chosen] = before
        if moves < history.shape[1]:
            history[0, moves] = best
            history[1, moves] = delta
            history[2, moves] = accepted / tried
        moves += 1
        if tried >= minimum_moves and accepted < acceptance * tried:  # Step 6
            tried = accepted = 0
            delta *= shrink
    return best, moves + 1, delta < delta_min
