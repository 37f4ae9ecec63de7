"""Bars in the part of a planned volume that both cameras see: at random, and where to hold one."""

import itertools
from dataclasses import dataclass

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.planning.plan import (
    COLUMNS,
    DEPTHS,
    ROWS,
    AimedPose,
    Plan,
    common_points,
    sees,
)
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.sampling import evenly_spread

MARGIN_PX = 15.0
"""Least distance of a bar's end from the edge of an image: room for noise and half a target."""
SIGMAS = 3.0
"""Errors of the lenses for which the margin leaves room, in standard deviations."""
MOST_MARGIN = 0.1
"""The same as a fraction of the smaller side of an image."""
ROUNDS = 200
DISTANCES = ("near", "middle", "far")
ACROSS, HEIGHTS = ("left", "centre", "right"), ("low", "middle", "high")
DIRECTIONS = {
    "level": (1.0, 0.0, 0.0),
    "upright": (0.0, 1.0, 0.0),
    "left end near": (np.sqrt(0.5), 0.0, np.sqrt(0.5)),
    "right end near": (-np.sqrt(0.5), 0.0, np.sqrt(0.5)),
    "rising right": (np.sqrt(0.5), -np.sqrt(0.5), 0.0),
    "rising left": (-np.sqrt(0.5), -np.sqrt(0.5), 0.0),
}
"""The bar's, on the ground's axes: right, down, ahead. None points at the cameras, because one
target would hide the other."""
OPPOSITE = 0.1
"""Cameras that look in nearly opposite directions have no mean: the primary's axes are taken."""
ENOUGH_DIRECTIONS = 3
STEPS = 20


@dataclass(frozen=True, eq=False)
class BarPlace:
    """One frame of the checklist: the middle of the bar, and its direction."""

    distance: str
    across: str
    height: str
    direction: str
    position_m: FloatArray
    """(3,): of the middle of the bar in the frame of `ground_from_primary`."""
    ends_m: FloatArray
    """(2, 3): the ends of the bar in the primary's frame."""


def place_planned_bars(plan: Plan, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 2, 3): ends of bars in random places and directions, in the primary's frame.

    The middle of a bar is uniform over the image and the depths, as far as both cameras see it; its
    direction is uniform over the sphere. Both ends are in view, from near to far.
    """
    grid = plan.common_points
    sides = np.ptp(grid[:, :2] / grid[:, 2:], axis=0)
    cell = np.array([*sides, plan.far_m - plan.near_m]) / (COLUMNS - 1, ROWS - 1, DEPTHS - 1)
    placed = np.empty((0, 2, 3))
    for _ in range(ROUNDS):
        tried = max(3 * (count - len(placed)), 200)
        middle = grid[rng.integers(len(grid), size=tried)]
        middle = np.column_stack([middle[:, :2] / middle[:, 2:], middle[:, 2]])
        middle += cell * rng.uniform(-0.5, 0.5, (tried, 3))
        middle[:, :2] *= middle[:, 2:]
        along = rng.standard_normal((tried, 3))
        along *= 0.5 * plan.bar_m / np.linalg.norm(along, axis=1, keepdims=True)
        bars = np.stack([middle - along, middle + along], axis=1)
        placed = np.concatenate([placed, bars[_in_view(plan, bars)]])
        if len(placed) >= count:
            return placed[:count]
    raise _hardly_fits(plan)


def _hardly_fits(plan: Plan) -> StereocalError:
    return StereocalError(
        f"A bar of {plan.bar_m:g} m hardly fits into what both cameras see from {plan.near_m:g} to "
        f"{plan.far_m:g} m: take a shorter bar, or turn the cameras towards each other."
    )


def _in_view(plan: Plan, ends: FloatArray) -> BoolArray:
    """(...): whether both ends (..., 2, 3) are in the volume and in view of both cameras."""
    points = ends.reshape(-1, 3)
    seen = (points[:, 2] >= plan.near_m) & (points[:, 2] <= plan.far_m)
    for camera, xyz in ((plan.primary, points), (plan.secondary, plan.pose.apply(points))):
        seen &= sees(camera, xyz, margin_px(plan, camera.image_size))
    return np.asarray(seen.reshape(ends.shape[:-1]).all(axis=-1))


def margin_px(plan: Plan, image_size: tuple[int, int]) -> float:
    """Distance from the edge of an image within which no target is planned."""
    sigma = plan.uncertainty
    lens = SIGMAS * (sigma.centre_px + 0.5 * sigma.focal * max(image_size))
    return min(MARGIN_PX + lens, MOST_MARGIN * min(image_size))


def ground_from_primary(plan: Plan) -> Pose:
    """The frame of the field: origin midway between the cameras, x right, y down, z ahead.

    Where the plan states R and T, the two cameras together are taken as level: down and ahead are
    the means of their y and z axes.
    """
    if isinstance(plan.stated_pose, AimedPose):
        R = plan.stated_pose.world_from_primary
    else:
        down, ahead = np.eye(3)[1:] + plan.pose.R[1:]
        if np.linalg.norm(down) < OPPOSITE or np.linalg.norm(np.cross(down, ahead)) < OPPOSITE:
            down, ahead = np.eye(3)[1:]
        down = down / np.linalg.norm(down)
        right = np.cross(down, ahead) / np.linalg.norm(np.cross(down, ahead))
        R = np.vstack([right, down, np.cross(right, down)])
    return Pose(R, -0.5 * R @ plan.pose.inverse().T)


def bar_places(plan: Plan) -> list[BarPlace]:
    """A place for each frame of the plan, from near to far, left to right and low to high.

    Each bar is in view of both cameras as a whole, also with lenses that are off as far as the plan
    says. Where frames are fewer than places, they are evenly chosen; where they are more, places
    come again with other directions.
    """
    spots = [spot for distance in range(3) for spot in _spots(plan, distance)]
    if not spots:
        raise _hardly_fits(plan)
    count, frames = len(spots), plan.frames
    chosen = evenly_spread(count, frames).tolist()
    chosen += [k % count for k in range(frames - len(chosen))]
    middles = np.array([spot[1] for spot in spots])
    ends, positions = _ends(plan, middles), ground_from_primary(plan).apply(middles)
    places = []
    for k, row in enumerate(chosen):
        (distance, across, height), _, fitting = spots[row]
        in_turn = (row + k // count + np.arange(len(DIRECTIONS))) % len(DIRECTIONS)
        turn = int(in_turn[np.argmax(fitting[in_turn])])
        direction = tuple(DIRECTIONS)[turn]
        bar = BarPlace(distance, across, height, direction, positions[row], ends[row, turn])
        places.append((row, bar))
    # The spots are from near to far, left to right and low to high.
    return [place for _, place in sorted(places, key=lambda entry: entry[0])]


def _spots(plan: Plan, distance: int) -> list[tuple[tuple[str, str, str], FloatArray, BoolArray]]:
    """The nine places at one distance, as far apart as the bar allows; fewer where it is tight.

    Of each its distance, place across and height, the middle of the bar (3,), and which directions
    fit (6,).
    """
    depths = np.unique(plan.common_points[:, 2])
    half = min(0.5 * plan.bar_m, 0.45 * float(np.ptp(depths)))
    depth = (depths[0] + half, 0.5 * (depths[0] + depths[-1]), depths[-1] - half)[distance]
    seen = common_points(plan.rig, np.array([depth]))
    middle, lowest, highest = seen.mean(axis=0), seen.min(axis=0)[:2], seen.max(axis=0)[:2]
    steps = np.array(list(itertools.product((-1.0, 0.0, 1.0), (1.0, 0.0, -1.0))))
    reach = np.where(steps > 0, highest - middle[:2], middle[:2] - lowest) * steps
    for enough, share in itertools.product(
        (ENOUGH_DIRECTIONS, 1), np.linspace(1.0, 0.0, STEPS + 1)
    ):
        tried = np.tile(middle, (9, 1))
        tried[:, :2] += share * reach
        fitting = _in_view(plan, _ends(plan, tried))
        if (fitting.sum(axis=1) >= enough).all():
            words = itertools.product(DISTANCES[distance : distance + 1], ACROSS, HEIGHTS)
            nine = list(zip(words, tried, fitting, strict=True))
            return nine if share > 1.5 / STEPS else [nine[4]]  # one place is left
    return []


def _ends(plan: Plan, middles: FloatArray) -> FloatArray:
    """(n, 6, 2, 3): both ends of a bar in each direction, in the primary's frame."""
    along = 0.5 * plan.bar_m * np.array(list(DIRECTIONS.values())) @ ground_from_primary(plan).R
    return np.asarray(middles[:, None, None] + np.stack([-along, along], axis=1)[None])
