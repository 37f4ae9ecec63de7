"""Levenberg-Marquardt fit of an X-corner (`corner_model`), covariance and residual noise.

Small dense systems are solved by Cholesky's method: `np.linalg.solve` takes 5 s to compile.
"""

import numpy as np

from stereocal.detection.corner_model import ALL, FRAME, fill_frame, fill_rows
from stereocal.rig.compiled import compiled, internal
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.system.array_types import FloatArray

CHUNK = 64
SMALLEST_PIVOT = 1e-14
"""Relative to the diagonal entry; a smaller pivot is rounding."""


@internal
def _normal_equations(
    pixels: FloatArray,
    p: FloatArray,
    radius: float,
    samples: int,
    penalty: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> float:
    """Write H = J^T J + diag(penalty) and g = J^T e + penalty p; return the cost.

    `CHUNK` pixels are processed at a time, so that the products sum over consecutive memory.
    """
    size, n = g.size, pixels.shape[0]
    frame, rows = np.empty(FRAME), np.empty((ALL + 1, CHUNK))
    products = np.zeros((size + 1, size + 1))
    fill_frame(p, radius, samples, frame)
    for first in range(0, n, CHUNK):
        count = min(CHUNK, n - first)
        fill_rows(p, frame, pixels, first, count, rows)
        for a in range(size + 1):
            left = a if a < size else ALL
            for b in range(a + 1):
                right = b if b < size else ALL
                total = 0.0
                for i in range(count):
                    total += rows[left, i] * rows[right, i]
                products[a, b] += total
    cost: float = products[size, size]
    for a in range(size):
        g[a] = products[size, a] + penalty[a] * p[a]
        cost += penalty[a] * p[a] * p[a]
        for b in range(a + 1):
            H[a, b] = H[b, a] = products[a, b]
        H[a, a] += penalty[a]
    return cost


@internal
def _damp(H: FloatArray, g: FloatArray, damping: float, L: FloatArray, step: FloatArray) -> None:
    """Write the lower half of H with a damped diagonal to L, and g to `step`."""
    for a in range(g.size):
        step[a] = g[a]
        for b in range(a):
            L[a, b] = H[a, b]
        L[a, a] = (1.0 + damping) * H[a, a] + 1e-30


@compiled
def fit_parameters(
    pixels: FloatArray,
    p: FloatArray,
    size: int,
    radius: float,
    samples: int,
    penalty: FloatArray,
    rounds: int,
    tolerance: float,
) -> tuple[float, bool]:
    """Levenberg-Marquardt on the first `size` parameters of p, in place.

    Args:
        pixels: (n, 3): u, v, grey level.
        p: (13,), the start, then the result.
        size: 7 (straight edges, uniform illumination) or 13.
        radius: of the window in px, the unit of the gradients.
        samples: 4 averages the model over each pixel, for small blurs; 1 uses the pixel's centre;
            0 also assumes perpendicular edges, which is fastest.
        penalty: (13,): weights of the squared parameters in the cost.
        rounds: maximum number of iterations.
        tolerance: px; the fit ends when a step moves the centre by less than this and lowers the
            cost by less than a tenth of it, relatively.

    Returns:
        The cost, and whether the fit converged.
    """
    H, L, trial = np.empty((size, size)), np.empty((size, size)), p.copy()
    g, step = np.empty(size), np.empty(size)
    H_new, g_new = np.empty((size, size)), np.empty(size)
    cost = _normal_equations(pixels, p, radius, samples, penalty, H, g)
    damping = 1e-3
    for _ in range(rounds):
        _damp(H, g, damping, L, step)
        if not factor(L, SMALLEST_PIVOT):
            damping = max(damping * 10.0, 1e-6)
            if damping > 1e8:
                return cost, False
            continue
        forward(L, step)
        backward(L, step)
        for a in range(size):
            trial[a] = p[a] - step[a]
        new = _normal_equations(pixels, trial, radius, samples, penalty, H_new, g_new)
        if new <= cost:
            moved = abs(step[0]) + abs(step[1])
            small = moved < tolerance and cost - new < 0.1 * tolerance * cost
            for a in range(size):
                p[a] = trial[a]
            H, H_new, g, g_new, cost = H_new, H, g_new, g, new
            damping *= 0.1
            if small:
                return cost, True
        else:
            if abs(step[0]) + abs(step[1]) < 0.01 * tolerance:
                return cost, True
            damping *= 10.0
            if damping > 1e8:
                return cost, False
    return cost, False


@compiled
def covariance_and_noise(
    pixels: FloatArray,
    p: FloatArray,
    radius: float,
    samples: int,
    penalty: FloatArray,
    shift: float,
) -> FloatArray:
    """Covariance of the centre and measures of the residuals.

    Args:
        shift: the centre is p[:2] + shift * p[11:13], where shading has not moved it.

    Returns:
        (7,): uu, uv, vv of the covariance for unit noise variance; the variance of the residuals;
        their variance weighted by the influence of each pixel on the centre, since noise and model
        errors are different near the edges; the mean product of neighbouring residuals, which is 0
        for noise, and positive for objects that are not a board; the correlation of neighbouring
        residuals with the weights. All NaN if the pixels do not determine the parameters.
    """
    measures = np.full(7, np.nan)
    L, g = np.empty((ALL, ALL)), np.empty(ALL)
    columns = np.zeros((2, ALL))
    _normal_equations(pixels, p, radius, samples, penalty, L, g)
    if not factor(L, SMALLEST_PIVOT):
        return measures
    for a in range(2):
        columns[a, a], columns[a, 11 + a] = 1.0, shift
        forward(L, columns[a])
        backward(L, columns[a])
    frame, rows = np.empty(FRAME), np.empty((ALL + 1, CHUNK))
    fill_frame(p, radius, samples, frame)
    total, weighted, weights = 0.0, 0.0, 0.0
    beside, neighbours, before = 0.0, 0, 0.0
    weighted_beside, weights_beside, weight_before = 0.0, 1e-300, 0.0
    for i in range(pixels.shape[0]):
        column = i % CHUNK
        if column == 0:
            fill_rows(p, frame, pixels, i, min(CHUNK, pixels.shape[0] - i), rows)
        error = rows[ALL, column]
        du, dv = 0.0, 0.0
        for a in range(ALL):
            du += columns[0, a] * rows[a, column]
            dv += columns[1, a] * rows[a, column]
        weight = du * du + dv * dv
        total += error * error
        weighted += weight * error * error
        weights += weight
        if i > 0 and pixels[i, 0] == pixels[i - 1, 0] + 1.0:
            beside += error * before
            neighbours += 1
            both = np.sqrt(weight * weight_before)
            weighted_beside += both * error * before
            weights_beside += both
        before, weight_before = error, weight
    measures[0] = columns[0, 0] + shift * columns[0, 11]
    measures[1] = columns[0, 1] + shift * columns[0, 12]
    measures[2] = columns[1, 1] + shift * columns[1, 12]
    measures[3] = total / max(pixels.shape[0] - ALL, 1)
    measures[4] = weighted / weights
    measures[5] = beside / max(neighbours, 1)
    measures[6] = weighted_beside / weights_beside / measures[4] if measures[4] > 0.0 else 0.0
    return measures
