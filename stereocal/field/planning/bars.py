"""Bars in the part of a planned volume that both cameras see."""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.planning.common_view import COLUMNS, DEPTHS, ROWS, sees
from stereocal.field.planning.plan import Plan
from stereocal.rig.compiled import FloatArray

MARGIN_PX = 15.0
"""Least distance of a bar's end from the edge of an image: room for noise and half a target."""
SIGMAS = 3.0
"""Errors of the lenses for which the margin leaves room, in standard deviations."""
MOST_MARGIN = 0.1
"""Of the smaller side of an image."""
ROUNDS = 200


def place_planned_bars(plan: Plan, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 2, 3): ends of bars in random places and directions, in the primary's frame.

    The middle of a bar is uniform over the image and the depths, as far as both cameras see it; its
    direction is uniform over the sphere. Both ends are in view, from near to far.
    """
    depths = plan.near_m, plan.far_m
    grid = plan.common_points
    cell = np.array(
        [
            np.ptp(grid[:, 0] / grid[:, 2]) / (COLUMNS - 1),
            np.ptp(grid[:, 1] / grid[:, 2]) / (ROWS - 1),
            (plan.far_m - plan.near_m) / (DEPTHS - 1),
        ]
    )
    margins = [margin_px(plan, camera.image_size) for camera in (plan.primary, plan.secondary)]
    found = np.empty((0, 2, 3))
    for _ in range(ROUNDS):
        tried = max(3 * (count - len(found)), 200)
        middle = grid[rng.integers(len(grid), size=tried)]
        middle = np.column_stack([middle[:, :2] / middle[:, 2:], middle[:, 2]])
        middle += cell * rng.uniform(-0.5, 0.5, (tried, 3))
        middle[:, :2] *= middle[:, 2:]
        along = rng.standard_normal((tried, 3))
        along *= 0.5 * plan.bar_m / np.linalg.norm(along, axis=1, keepdims=True)
        bars = np.stack([middle - along, middle + along], axis=1)
        points = bars.reshape(-1, 3)
        seen = (points[:, 2] >= depths[0]) & (points[:, 2] <= depths[1])
        seen &= sees(plan.primary, points, margins[0])
        seen &= sees(plan.secondary, plan.pose.apply(points), margins[1])
        found = np.concatenate([found, bars[seen.reshape(-1, 2).all(axis=1)]])
        if len(found) >= count:
            return found[:count]
    raise StereocalError(
        f"A bar of {plan.bar_m:g} m hardly fits into what both cameras see from {plan.near_m:g} to "
        f"{plan.far_m:g} m: take a shorter bar, or turn the cameras towards each other."
    )


def margin_px(plan: Plan, image_size: tuple[int, int]) -> float:
    """Distance from the edge of an image within which no target is planned."""
    own = plan.uncertainty
    lens = SIGMAS * (own.centre_px + 0.5 * own.focal * max(image_size))
    return min(MARGIN_PX + lens, MOST_MARGIN * min(image_size))
