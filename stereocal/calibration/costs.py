"""The costs that the Monte Carlo search minimises (paper, Section 3.2.1), compiled.

All costs have one signature, so that one search handles them all. `rays` has shape (4, n), as in
`geometry`; the content of `reference` depends on the cost:

- `REPROJECTION` (2D): empty, shape (0, 0). Sum over pairs of E2D(1) + E2D(2), in pixels.
- `DISTANCE` (3D): distances in metres, shape (1, m). The first m rays are ends A, the next m ends B
  of the bars. Sum over bars of |D - D^R|, in metres.
- `POINTS` (3D, the paper's footnote 4): known points in the primary frame, shape (3, n). Sum over
  points of |Q - Q^R|, in metres.

The cost is NaN if a point is behind a camera; the search never accepts NaN.
"""

import numpy as np

from stereocal.rig.compiled import compiled, inlined
from stereocal.rig.geometry import bar_length, midpoint, reprojection_shift
from stereocal.system.array_types import FloatArray

REPROJECTION = 0
DISTANCE = 1
POINTS = 2


@compiled
def cost(
    kind: int,
    R: FloatArray,
    T: FloatArray,
    rays: FloatArray,
    reference: FloatArray,
    pixel_scale: FloatArray,
) -> float:
    """The cost `kind` of the pose `x_secondary = R x_primary + T`."""
    if kind == REPROJECTION:
        return reprojection_cost(R, T, rays, pixel_scale)
    if kind == DISTANCE:
        return distance_cost(R, T, rays, reference)
    return points_cost(R, T, rays, reference)


@inlined
def reprojection_cost(
    R: FloatArray, T: FloatArray, rays: FloatArray, pixel_scale: FloatArray
) -> float:
    """Sum of the reprojection errors over all pairs and both cameras, in pixels."""
    total = 0.0
    for k in range(rays.shape[1]):
        first, second, _ = reprojection_shift(
            R, T, rays[0, k], rays[1, k], rays[2, k], rays[3, k], pixel_scale
        )
        total += first + second
    return total


@inlined
def distance_cost(R: FloatArray, T: FloatArray, rays: FloatArray, distances: FloatArray) -> float:
    """Sum over bars of the difference between measured and reconstructed length, in metres."""
    total = 0.0
    m = distances.shape[1]
    for k in range(m):
        total += abs(distances[0, k] - bar_length(R, T, rays, k, k + m))
    return total


@inlined
def points_cost(R: FloatArray, T: FloatArray, rays: FloatArray, points: FloatArray) -> float:
    """Sum over points of the distance between known and reconstructed point, in metres."""
    total = 0.0
    for k in range(rays.shape[1]):
        x, y, z, _, _, _ = midpoint(R, T, rays[0, k], rays[1, k], rays[2, k], rays[3, k])
        total += np.sqrt(
            (x - points[0, k]) ** 2 + (y - points[1, k]) ** 2 + (z - points[2, k]) ** 2
        )
    return total
