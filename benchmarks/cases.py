"""What is timed: each cost and each search, compiled and in plain NumPy, on the same numbers."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks import vectorised
from stereocal.calibration import costs
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.montecarlo import Problem, SearchSettings, minimise
from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import Pose, fill_pose
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import Scene, simulate_field
from stereocal.system.array_types import FloatArray

PlainCost = Callable[[FloatArray, FloatArray], float]

COST_FRAMES = 20
"""40 correspondences, as the paper calibrates with."""

SEARCH_SETTINGS = SearchSettings()
START_SHIFT = 1e-3 * np.array([0.7, -1.3, 0.9, -1.1, 1.2])
"""The searches start so far (rad) from the essential result: from it, most moves are refused."""


@dataclass(frozen=True, eq=False)
class Case:
    """One cost on one data set, and the pose where it is computed or the search begins."""

    name: str
    problem: Problem
    pose: Pose
    plain: PlainCost
    """The cost of (R, T) in NumPy, from `benchmarks.vectorised`."""

    def compiled_cost(self) -> float:
        """One evaluation, called from Python."""
        return self.problem.cost(self.pose)

    def plain_cost(self) -> float:
        """The same evaluation in NumPy."""
        return self.plain(self.pose.R, self.pose.T)

    def compiled_costs(self, times: int) -> float:
        """`times` evaluations in a compiled loop, as the search does them: no call from Python."""
        return repeat_cost(self.problem, self.pose.R, self.pose.T.copy(), times)

    def compiled_search(self) -> tuple[float, int]:
        """A whole search: its last cost and the number of evaluations."""
        found = minimise(self.problem, self.pose, SEARCH_SETTINGS)
        return found.cost, found.evaluations

    def plain_search(self) -> tuple[float, int]:
        """The same search, same random numbers, in Python with the NumPy cost."""
        return plain_search(self.plain, self.pose, SEARCH_SETTINGS)


@compiled
def repeat_cost(problem: Problem, R: FloatArray, T: FloatArray, times: int) -> float:
    """Sum of `times` costs; T moves by 1e-9 m each time, so that no evaluation can be left out."""
    kind, rays, given, pixel_scale = problem
    total = 0.0
    for _ in range(times):
        T[0] += 1e-9
        total += costs.cost(kind, R, T, rays, given, pixel_scale)
    return total


def plain_search(cost: PlainCost, start: Pose, settings: SearchSettings) -> tuple[float, int]:
    """`montecarlo.search` line by line in plain Python, with the same random numbers."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(settings.seed)))
    angles, delta = np.array(start.angles), settings.delta
    R, T = _pose_of(angles, start.baseline)
    best = cost(R, T)
    tried = accepted = moves = 0
    while delta >= settings.delta_min and moves < settings.maximum_moves:
        draw = int(rng.integers(0, 10))
        chosen = draw >> 1
        before = angles[chosen]
        angles[chosen] = before + (delta if draw & 1 else -delta)
        R, T = _pose_of(angles, start.baseline)
        candidate = cost(R, T)
        tried += 1
        if candidate < best:
            best = candidate
            accepted += 1
        else:
            angles[chosen] = before
        moves += 1
        if tried >= settings.minimum_moves and accepted < settings.acceptance * tried:
            tried = accepted = 0
            delta *= settings.shrink
    return best, moves + 1


@functools.cache
def cost_cases() -> tuple[Case, ...]:
    """The three costs of 20 frames (40 correspondences) of the sample field, at the true pose."""
    scene, dataset = simulate_field(0)
    return _cases(scene, dataset, COST_FRAMES, scene.rig.pose)


@functools.cache
def search_cases() -> tuple[Case, ...]:
    """The three searches on all 25 frames, started beside the essential result."""
    scene, dataset = simulate_field(0)
    start = calibrate_essential(dataset.rays, dataset.baseline_m).pose
    angles = type(start.angles)(*(start.angles + START_SHIFT))
    return _cases(scene, dataset, 25, Pose.from_angles(angles, start.baseline))


def _cases(scene: Scene, dataset: Pair, frames: int, pose: Pose) -> tuple[Case, ...]:
    rays = np.ascontiguousarray(dataset.rays[:, : 2 * frames])
    ends = np.ascontiguousarray(np.hstack([rays[:, 0::2], rays[:, 1::2]]))  # all A, then all B
    lengths = np.full((1, frames), dataset.target_distance_m)
    points = np.ascontiguousarray(scene.points_m[0][: 2 * frames].T)
    scale = dataset.pixel_scale
    return (
        Case(
            "2d",
            Problem(costs.REPROJECTION, rays, np.empty((0, 0)), scale),
            pose,
            lambda R, T: vectorised.reprojection_cost(R, T, rays, scale),
        ),
        Case(
            "3d",
            Problem(costs.DISTANCE, ends, lengths, scale),
            pose,
            lambda R, T: vectorised.distance_cost(R, T, ends, lengths),
        ),
        Case(
            "points",
            Problem(costs.POINTS, rays, points, scale),
            pose,
            lambda R, T: vectorised.points_cost(R, T, rays, points),
        ),
    )


def _pose_of(angles: FloatArray, baseline: float) -> tuple[FloatArray, FloatArray]:
    # Compiled also here: the ratio is to be that of the cost, not of a slow rotation matrix.
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(angles, baseline, R, T)
    return R, T
