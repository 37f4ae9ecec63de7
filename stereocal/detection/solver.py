"""Levenberg-Marquardt fit of an X-corner (`corner_model`), covariance and residual noise.

Small dense systems are solved by Cholesky's method: `np.linalg.solve` takes 5 s to compile.
"""

from typing import NamedTuple

import numpy as np

from stereocal.detection.corner_model import ALL, FRAME, LIGHT, fill_frame, fill_rows
from stereocal.rig.compiled import compiled
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.system.array_types import FloatArray

CHUNK = 64
SMALLEST_PIVOT = 1e-14
"""Relative to the diagonal entry; a smaller pivot is rounding."""
TINY = 1e-300
"""Keeps 0 / 0 from being NaN, and changes no other value."""
FIRST_DAMPING, EASED, RAISED, LEAST_RAISED, LARGEST_DAMPING = 1e-3, 0.1, 10.0, 1e-6, 1e8
"""Marquardt's damping: at first; its factors after a step that lowers the cost and after one that
does not; its least value where the matrix has no factor; and that at which the fit gives up.
Measured on 24 windows of sample_data/photographs, each number a quarter and four times as large:
180 to 183 evaluations instead of 181, all fits converge, centres move by 0.006 px at most while the
window grows, within the tolerance of 0.01 px."""


@compiled
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


@compiled
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
    damping = FIRST_DAMPING
    for _ in range(rounds):
        _damp(H, g, damping, L, step)
        if not factor(L, SMALLEST_PIVOT):
            damping = max(damping * RAISED, LEAST_RAISED)
            if damping > LARGEST_DAMPING:
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
            damping *= EASED
            if small:
                return cost, True
        else:
            if abs(step[0]) + abs(step[1]) < 0.01 * tolerance:
                return cost, True
            damping *= RAISED
            if damping > LARGEST_DAMPING:
                return cost, False
    return cost, False


class CornerMeasures(NamedTuple):
    """Covariance of the centre of a corner, and measures of the n residuals e of its fit. All NaN
    if the pixels do not determine the parameters."""

    uu: float
    """Covariance of the centre (u, v) for residuals of variance 1, px^2 over grey levels^2."""
    uv: float
    vv: float
    variance: float
    """Sum of e^2 / (n - 13), grey levels^2."""
    variance_of_centre: float
    """Mean of e^2 weighted by the squared influence of each pixel on the centre: noise and model
    errors are different near the edges."""
    product: float
    """Mean of e e' of neighbours in a row: 0 for noise, positive for what is not a board."""
    correlation: float
    """The same weighted by the influence of both, over `variance_of_centre`."""


@compiled
def covariance_and_noise(
    pixels: FloatArray,
    p: FloatArray,
    radius: float,
    samples: int,
    penalty: FloatArray,
    shift: float,
) -> CornerMeasures:
    """Covariance of the centre and measures of the residuals, as of `fit_parameters` at its end.

    With the normal equations H = J^T J + diag(penalty), the centre c = p[:2] + shift * p[11:13] =
    A p, where shading has not moved it, has the covariance A H^-1 A^T for residuals of variance 1.
    The influence of pixel i on it is A H^-1 J_i, J_i being the derivatives of its grey level.
    """
    n = pixels.shape[0]
    L, g = np.empty((ALL, ALL)), np.empty(ALL)
    _normal_equations(pixels, p, radius, samples, penalty, L, g)
    if not factor(L, SMALLEST_PIVOT):
        return CornerMeasures(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)
    gain = np.zeros((2, ALL))  # A H^-1
    for a in range(2):
        gain[a, a], gain[a, LIGHT + a] = 1.0, shift
        forward(L, gain[a])
        backward(L, gain[a])
    frame, rows = np.empty(FRAME), np.empty((ALL + 1, CHUNK))
    fill_frame(p, radius, samples, frame)
    squares, weighted_squares, weights = 0.0, 0.0, 0.0
    products, neighbours = 0.0, 0
    weighted_products, product_weights = 0.0, TINY
    error_before, weight_before = 0.0, 0.0
    for i in range(n):
        column = i % CHUNK
        if column == 0:
            fill_rows(p, frame, pixels, i, min(CHUNK, n - i), rows)
        error, du, dv = rows[ALL, column], 0.0, 0.0
        for a in range(ALL):
            du += gain[0, a] * rows[a, column]
            dv += gain[1, a] * rows[a, column]
        weight = du * du + dv * dv
        squares += error * error
        weighted_squares += weight * error * error
        weights += weight
        if i > 0 and pixels[i, 0] == pixels[i - 1, 0] + 1.0:  # the next pixel of a row
            products += error * error_before
            neighbours += 1
            both = np.sqrt(weight * weight_before)
            weighted_products += both * error * error_before
            product_weights += both
        error_before, weight_before = error, weight
    of_centre = weighted_squares / weights
    return CornerMeasures(
        gain[0, 0] + shift * gain[0, LIGHT],
        gain[0, 1] + shift * gain[0, LIGHT + 1],
        gain[1, 1] + shift * gain[1, LIGHT + 1],
        squares / max(n - ALL, 1),
        of_centre,
        products / max(neighbours, 1),
        weighted_products / product_weights / of_centre if of_centre > 0.0 else 0.0,
    )
