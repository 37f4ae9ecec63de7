"""The Monte Carlo search over the five angles of a rig (paper, Section 3.2, Steps 1 to 6).

One search handles every cost in `costs`. The paper does not say when the acceptance ratio is
checked; here, after `minimum_moves` trials. After a single trial the ratio is 0 or 1, so nearly
every rejection would shrink the step; `minimum_moves=1` follows the paper literally.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereocal.calibration import costs
from stereocal.errors import StereocalError
from stereocal.rig.compiled import clock, compiled, contiguous
from stereocal.rig.geometry import Angles, Pose, fill_pose
from stereocal.rig.pair import Pair
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import SEEDS
from stereocal.system.settings import Settings, described

STEP_TOO_SMALL = "the step fell below its smallest size"
OUT_OF_MOVES = "the largest number of moves was reached"


@dataclass(frozen=True)
class SearchSettings(Settings):
    """Settings of the search; the defaults are the paper's, where the paper gives one."""

    delta: float = described(
        1e-3,
        "First step Δ (rad)",
        "How far an angle is moved at first, rad. Paper: 0.001.",
        between=(1e-12, 0.5),
        name="Δ",
    )
    delta_min: float = described(
        1e-6,
        "Smallest step Δ min (rad)",
        "The search ends when the step is smaller, rad. Paper: 0.000001.",
        between=(1e-12, 0.5),
        name="Δ min",
    )
    acceptance: float = described(
        0.2,
        "Acceptance ratio",
        "The step shrinks when fewer moves than this part are accepted. Paper: 0.2.",
        between=(1e-9, 1 - 1e-9),
    )
    shrink: float = described(
        0.75,
        "Shrink factor",
        "What the step is multiplied by when it shrinks. Paper: 0.75.",
        between=(0.01, 0.99),
    )
    minimum_moves: int = described(
        20,
        "Minimum moves",
        "Moves at one step before the ratio is looked at. Paper: 1, to the letter; 20 is steadier.",
        between=(1, 100_000),
    )
    maximum_moves: int = described(2_000_000, "Most moves of a search")
    """Limit of the number of trials (paper: none)."""
    seed: int = described(
        0,
        "Seed",
        "Source of the random numbers: the same seed gives the same files.",
        between=SEEDS,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.delta_min > self.delta:
            raise StereocalError(
                f"delta_min is {self.delta_min}: it must be at most delta, {self.delta}."
            )
        if self.maximum_moves < 1:
            raise StereocalError(f"maximum_moves is {self.maximum_moves}: it must be at least 1.")

    @property
    def steps(self) -> "Steps":
        """The settings for the compiled search."""
        return Steps(*(getattr(self, name) for name in Steps._fields))


class Steps(NamedTuple):
    """The settings of the compiled search, see `SearchSettings`."""

    delta: float
    delta_min: float
    acceptance: float
    shrink: float
    minimum_moves: int
    maximum_moves: int


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
class MethodResult:
    """The pose that one method found, and the reason why it stopped."""

    pose: Pose
    cost: float
    """Unit: `COST_UNITS` of the method."""
    evaluations: int
    """How often the cost was computed."""
    stop_reason: str
    seconds: float
    trace: Trace | None = None
    """History of a search; None for other methods, or if not asked for."""


class Problem(NamedTuple):
    """A cost and its data, with the arrays described in `costs`."""

    kind: int
    rays: FloatArray
    reference: FloatArray
    pixel_scale: FloatArray

    def cost(self, pose: Pose) -> float:
        """The cost of a pose; NaN if a point cannot be reconstructed in front of both cameras."""
        R, T = contiguous(pose.R), contiguous(pose.T)
        return costs.cost(self.kind, R, T, self.rays, self.reference, self.pixel_scale)


def reprojection_problem(dataset: Pair, rows: BoolArray | None = None) -> Problem:
    """The 2D cost over the pairs of a data set: all of them, or those in the mask `rows` (n,)."""
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    return Problem(costs.REPROJECTION, rays, np.empty((0, 0)), dataset.pixel_scale)


def reconstruction_problem(
    dataset: Pair, known_points: bool = False, rows: BoolArray | None = None
) -> Problem:
    """The 3D cost over the bars of a data set, or over its known points.

    Args:
        rows: mask (n,) of the rows to use, whole frames; all if None.

    Raises:
        StereocalError: no row has a known point, or no frame both ends of a bar.
    """
    table = dataset.correspondences
    used = np.ones(len(table), dtype=np.bool_) if rows is None else rows
    if known_points:
        known = used & np.isfinite(dataset.known_points_m).all(axis=1)
        if not known.any():
            raise StereocalError(
                "No row has a known point: the columns x_m, y_m, z_m are missing or empty, and the "
                "targets are not those of a board."
            )
        return Problem(
            costs.POINTS,
            np.ascontiguousarray(dataset.rays[:, known]),
            np.ascontiguousarray(dataset.known_points_m[known].T),
            dataset.pixel_scale,
        )
    bars = dataset.bars_among(used)
    if not bars.any():
        raise StereocalError(
            "No frame has both targets A and B, so there is no length to measure: the 3D method "
            "needs frames in which both cameras see both ends of the bar."
        )
    ends = table.bars[bars].T.ravel()  # rows: all ends A, then all ends B
    return Problem(
        costs.DISTANCE,
        np.ascontiguousarray(dataset.rays[:, ends]),
        np.ascontiguousarray(dataset.bar_distances_m[None, bars]),
        dataset.pixel_scale,
    )


def minimise(
    problem: Problem,
    start: Pose,
    settings: SearchSettings,
    seed: np.random.SeedSequence | None = None,
    trace: bool = False,
) -> MethodResult:
    """Minimise the cost over the five angles, starting at `start` and keeping its baseline.

    Args:
        seed: `SeedSequence(settings.seed)` if None.
        trace: record every move. The search then runs a second time with the same random numbers,
            because the length of the record is not known before.
    """
    started = clock()
    if not np.isfinite(problem.cost(start)):
        raise StereocalError(
            "The search cannot start: with the first estimate a point is behind a camera."
        )
    sequence = seed or np.random.SeedSequence(settings.seed)

    def run(angles: FloatArray, history: FloatArray) -> tuple[float, int, bool]:
        rng = np.random.Generator(np.random.PCG64(sequence))
        return search(problem, angles, start.baseline, rng, settings.steps, history)

    angles = np.array(start.angles)
    cost, evaluations, stopped = run(angles, np.empty((3, 0)))
    seconds, record = clock() - started, None
    if trace:
        history = np.empty((3, evaluations - 1))
        run(np.array(start.angles), history)
        record = Trace(*history)
    pose = Pose.from_angles(Angles(*angles.tolist()), start.baseline)
    reason = STEP_TOO_SMALL if stopped else OUT_OF_MOVES
    return MethodResult(pose, cost, evaluations, reason, seconds, record)


@compiled
def search(
    problem: Problem,
    angles: FloatArray,
    baseline: float,
    rng: np.random.Generator,
    steps: Steps,
    history: FloatArray,
) -> tuple[float, int, bool]:
    """The search, in place on `angles`.

    Returns the cost, the number of evaluations, and whether the step fell below `delta_min`.
    """
    kind, rays, reference, pixel_scale = problem
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(angles, baseline, R, T)
    best = costs.cost(kind, R, T, rays, reference, pixel_scale)
    delta, tried, accepted, moves = steps.delta, 0, 0, 0
    while delta >= steps.delta_min and moves < steps.maximum_moves:
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
        if tried >= steps.minimum_moves and accepted < steps.acceptance * tried:  # Step 6
            tried = accepted = 0
            delta *= steps.shrink
    return best, moves + 1, delta < steps.delta_min


def two_searches(
    dataset: Pair,
    start: Pose,
    settings: SearchSettings,
    known_points: bool = False,
    trace: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> list[MethodResult]:
    """The results of the 2D and the 3D search, whose random streams are independent.

    Args:
        known_points: as for `reconstruction_problem`.
        trace: record every move.
        report: called with the name of each when it begins.
    """
    _, *streams = np.random.SeedSequence(settings.seed).spawn(3)
    problems = reprojection_problem(dataset), reconstruction_problem(dataset, known_points)
    results = []
    for name, problem, stream in zip(("2d", "3d"), problems, streams, strict=True):
        report(name)
        results.append(minimise(problem, start, settings, stream, trace))
    return results
