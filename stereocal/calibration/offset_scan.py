"""How well the points of two cameras fit together at each whole offset of their counts of frames.

At a wrong offset the points of different moments are compared: no fundamental matrix fits them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stereocal.rig.compiled import compiled
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.rig.tracks import exchanged_ends, interpolate
from stereocal.system.array_types import FloatArray, IntArray

MOST, FEWEST = 120, 25
"""Moments that a matrix is fitted to; with fewer, an offset is not judged."""
CELLS, IN_CELL = 32, 4
"""A camera's points are counted on a grid of so many cells a side; of a cell, so many are used: a
bar at rest is one place, and a camera that sees one place alone fits whatever the other sees."""
ROUNDS = 5
FAR = 2.5
"""A multiple of the median: points farther from their lines lose their weight."""


Tracks = tuple[FloatArray, FloatArray, IntArray, IntArray]
"""The rays and the cells of the primary and of the secondary."""


@dataclass(frozen=True, eq=False)
class Track:
    """What one camera saw, by its own count of frames."""

    first: int
    """The number of the first frame."""
    rays: FloatArray
    """(n, k, 2): of the targets in frames that follow each other; NaN where not seen."""

    @cached_property
    def cells(self) -> IntArray:
        """(n, k): the cell of the grid over what this camera saw; -1 where not seen."""
        seen = np.isfinite(self.rays[..., 0])
        if not seen.any():
            return np.full(seen.shape, -1)
        low, high = (np.percentile(self.rays[seen], q, axis=0) for q in (1, 99))
        width = max(float((high - low).max()), 1e-12) / CELLS
        cell = np.clip(np.nan_to_num((self.rays - low) / width), 0, CELLS - 1).astype(np.int64)
        return np.asarray(np.where(seen, cell[..., 0] * CELLS + cell[..., 1], -1))

    def earlier(self, fraction: float) -> "Track":
        """What it saw at the instants of its frames less a fraction of one; also where the ends of
        what is held are exchanged in some frames."""
        frame, target = np.nonzero(np.isfinite(self.rays[..., 0]))
        late, rays = np.full(len(frame), fraction), np.full_like(self.rays, np.nan)
        turned = exchanged_ends(self.rays[:, [0, -1]])[frame]
        track = np.where(turned, self.rays.shape[1] - 1 - target, target)
        seen = self.rays[frame, target]
        rays[frame, target] = interpolate(track, frame, seen, late).positions
        return Track(self.first, rays)


def scan(primary: Track, secondary: Track, offsets: IntArray) -> FloatArray:
    """The median distance of the points from their epipolar lines at each offset, on z = 1.

    Args:
        offsets: (m,): the secondary's frame j is taken for frame j + offset of the primary.

    Returns:
        (m,); NaN where too few moments are in common.
    """
    misfits = np.full(len(offsets), np.nan)
    tracks = primary.rays, secondary.rays, primary.cells, secondary.cells
    _scan(tracks, offsets + secondary.first - primary.first, misfits)
    return misfits


def common_points(
    primary: Track, secondary: Track, offset: int, most: int
) -> tuple[IntArray, FloatArray]:
    """Some of the points that both see at an offset, at places that differ, spread over the time:
    their index of the frame and of the target in the primary, and the cells of the grid of both,
    (n, 4); and their rays (4, n)."""
    marks, pairs = np.empty((most, 4), dtype=np.int64), np.empty((most, 4))
    used = np.zeros((2, CELLS * CELLS), dtype=np.int64)
    tracks = primary.rays, secondary.rays, primary.cells, secondary.cells
    n = _choose(tracks, offset + secondary.first - primary.first, used, marks, pairs)
    return marks[:n], np.ascontiguousarray(pairs[:n].T)


@compiled
def _scan(tracks: Tracks, offsets: IntArray, misfits: FloatArray) -> None:
    used = np.zeros((2, CELLS * CELLS), dtype=np.int64)
    marks, pairs = np.empty((MOST, 4), dtype=np.int64), np.empty((MOST, 4))
    for k in range(len(offsets)):
        n = _choose(tracks, offsets[k], used, marks, pairs)
        if n >= FEWEST:
            misfits[k] = _misfit(pairs[:n])


@compiled
def _choose(tracks: Tracks, offset: int, used: IntArray, marks: IntArray, pairs: FloatArray) -> int:
    """Write points that both see: frame, target and cells to `marks`, rays to `pairs`. Returns
    their number; `used`, how many of each cell are taken, is 0 before and after."""
    primary, secondary, primary_cells, secondary_cells = tracks
    targets, n, item = primary.shape[1], 0, 0
    start, stop = max(0, offset), min(len(primary), len(secondary) + offset)
    items = max(stop - start, 0) * targets
    step = _coprime(items)
    for _ in range(items):
        item = (item + step) % items
        frame, target = start + item // targets, item % targets
        one, other = primary_cells[frame, target], secondary_cells[frame - offset, target]
        if one < 0 or other < 0 or used[0, one] >= IN_CELL or used[1, other] >= IN_CELL:
            continue
        used[0, one] += 1
        used[1, other] += 1
        marks[n] = frame, target, one, other
        pairs[n, :2] = primary[frame, target]
        pairs[n, 2:] = secondary[frame - offset, target]
        n += 1
        if n == len(pairs):
            break
    for k in range(n):
        used[0, marks[k, 2]] = 0
        used[1, marks[k, 3]] = 0
    return n


@compiled
def _coprime(items: int) -> int:
    """A step that visits all items, in an order that is even at each of its beginnings."""
    step = int(0.618 * items) + 1  # the golden section
    while True:
        a, b = items, step
        while b > 0:
            a, b = b, a % b
        if a <= 1:
            return step
        step += 1


@compiled
def _misfit(pairs: FloatArray) -> float:
    """The median distance from the epipolar lines of a robust fundamental matrix.

    The normalised 8-point estimate, solved again with the weights 1 / (1 + (d / c)^2) of Cauchy's
    function for the distances d, c being `FAR` medians.
    """
    n = len(pairs)
    scale, rows = _normalised(pairs)
    weights, distances = np.ones(n), np.empty(n)
    f, A = np.ones(9), np.empty((9, 9))
    median = np.nan
    for _ in range(ROUNDS):
        _fill_normal(rows, weights, A)
        if not factor(A, 0.0):
            return np.nan
        for _ in range(4):  # inverse iteration: the vector of the smallest eigenvalue
            forward(A, f)
            backward(A, f)
            f /= np.sqrt(np.sum(f * f))
        for k in range(n):
            distances[k] = _distance(rows[k], scale, f)
        median = float(np.median(distances))
        for k in range(n):
            weights[k] = 1.0 / (1.0 + (distances[k] / (FAR * median + 1e-15)) ** 2)
    return median


@compiled
def _normalised(pairs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean distances of each camera's points from their middle (2,), and the coefficients (n,
    9) of the entries of F, row by row, in q_s^T F q_p = 0: with the normalised points (x, y) of the
    primary and (u, v) of the secondary, (u x, u y, u, v x, v y, v, x, y, 1)."""
    n = len(pairs)
    middle, scale, rows = np.sum(pairs, axis=0) / n, np.zeros(2), np.ones((n, 9))
    for k in range(n):
        for i in range(2):
            dx, dy = pairs[k, 2 * i] - middle[2 * i], pairs[k, 2 * i + 1] - middle[2 * i + 1]
            scale[i] += np.sqrt(dx * dx + dy * dy) / n
    for k in range(n):
        x, y = (pairs[k, 0] - middle[0]) / scale[0], (pairs[k, 1] - middle[1]) / scale[0]
        u, v = (pairs[k, 2] - middle[2]) / scale[1], (pairs[k, 3] - middle[3]) / scale[1]
        rows[k, :8] = u * x, u * y, u, v * x, v * y, v, x, y
    return scale, rows


@compiled
def _fill_normal(rows: FloatArray, weights: FloatArray, A: FloatArray) -> None:
    """Write the lower half of the weighted sum of the rows' products, and a little of the unit
    matrix: an exact fit has no Cholesky factor."""
    A[:] = 0.0
    trace = 0.0
    for k in range(len(rows)):
        for i in range(9):
            w = weights[k] * rows[k, i]
            trace += w * rows[k, i]
            for j in range(i + 1):
                A[i, j] += w * rows[k, j]
    for i in range(9):
        A[i, i] += 1e-14 * trace


@compiled
def _distance(row: FloatArray, scale: FloatArray, f: FloatArray) -> float:
    """Sampson's distance, on the planes z = 1, as in `geometry.sampson`: the residual over the
    length of its gradient by the four coordinates, that is of F q_p and F^T q_s without their last
    entries, over the scales of the normalised points.

    Args:
        row: (9,), scale: (2,): as of `_normalised`.
        f: (9,): the entries of F.
    """
    x, y, u, v = row[6], row[7], row[2], row[5]
    a, b = (f[0] * x + f[1] * y + f[2]) / scale[1], (f[3] * x + f[4] * y + f[5]) / scale[1]
    c, d = (f[0] * u + f[3] * v + f[6]) / scale[0], (f[1] * u + f[4] * v + f[7]) / scale[0]
    residual = 0.0
    for i in range(9):
        residual += f[i] * row[i]
    return float(abs(residual) / np.sqrt(a * a + b * b + c * c + d * d + 1e-300))
