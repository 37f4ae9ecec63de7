"""One validation run (paper, Section 6), compiled: calibrate on some rays, count on the others.

It is compiled as a whole so that runs in several threads use several cores, because compiled code
releases the interpreter lock.
"""

import numpy as np

from stereocal.calibration.essential import LINEAR_PAIRS, choose_pose, constrain, linear_essential
from stereocal.calibration.montecarlo import Problem, Steps, search
from stereocal.rig.compiled import CountArray, FloatArray, IntArray, compiled, internal
from stereocal.rig.geometry import (
    angles_of,
    bar_length,
    fill_essential,
    fill_pose,
    is_degenerate,
    reprojection_shift,
)

LOWEST, HIGHEST, BIN_WIDTH = -12.0, 6.0, 0.02
"""Range of the bins in log10, and their width."""
BINS = round((HIGHEST - LOWEST) / BIN_WIDTH)
UNDERFLOW, OVERFLOW = BINS, BINS + 1
"""Two more counters: for values below the range or 0, and for values above it or NaN."""
RESIDUAL, REPROJECTION = 0, 1
WRONG, CORRECT = 0, 1


@compiled
def calibrate_rays(
    angles: FloatArray,
    baseline: float,
    constrained: bool,
    matching: Problem,
    measuring: Problem,
    of_2d: np.random.Generator,
    of_3d: np.random.Generator,
    steps: Steps,
) -> bool:
    """Calibrate with the three methods.

    Args:
        angles: (3, 5), written: essential, 2D, 3D; in radians.
        constrained: whether to use the constrained essential solver.
        matching, measuring: the 2D and the 3D problem, of_2d, of_3d: their random generators.
        steps: settings of the searches.

    Returns:
        False for fewer than 8 pairs, or points that do not determine the pose.
    """
    rays = matching.rays
    if rays.shape[1] < LINEAR_PAIRS:
        return False
    E = linear_essential(rays)
    if np.isnan(E[0, 0]):
        return False
    R, T, in_front = choose_pose(E, rays)
    if in_front == 0 or is_degenerate(R, T):
        return False
    start, no_trace = np.empty(5), np.empty((3, 0))
    fill_angles(R, T, start)
    if constrained:
        start = constrain(start, rays)[0]
    fill_pose(start, baseline, R, T)
    if is_degenerate(R, T):
        return False
    for method in range(3):
        # Recomputed from the pose, so that pitch and delta are within +-90 degrees.
        fill_angles(R, T, angles[method])
        if method > 0:
            problem, rng = (matching, of_2d) if method == 1 else (measuring, of_3d)
            cost, _, _ = search(problem, angles[method], baseline, rng, steps, no_trace)
            if not np.isfinite(cost):
                return False
    return True


@internal
def fill_angles(R: FloatArray, T: FloatArray, angles: FloatArray) -> None:
    """Write the five angles of a pose to `angles` (5,)."""
    angles[0], angles[1], angles[2], angles[3], angles[4] = angles_of(R, T)


@compiled
def validate_rays(
    angles: FloatArray,
    baseline: float,
    pixel_scale: FloatArray,
    rays: FloatArray,
    partners: IntArray,
    bar_rays: FloatArray,
    distances: FloatArray,
    counts: CountArray,
    nans: IntArray,
    lengths: FloatArray,
    correct_px: FloatArray,
) -> None:
    """Count the errors of all pairs with the angles of each method, and measure the bars.

    Args:
        rays: (4, n).
        partners: (n, p): the secondary points paired with each primary point.
        bar_rays: (4, 2 m): the ends A of the bars, then the ends B.
        distances: (m,), in metres.
        counts: (methods, 2, 2, BINS + 2), added to: residual, reprojection; wrong, correct; bin.
        nans: (methods, 2), added to: wrong, correct.
        lengths: (methods, m), written: D^R / D.
        correct_px: (methods,), written: mean reprojection error of the correct pairs that have one.
    """
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    bars = len(distances)
    for method in range(len(angles)):
        fill_pose(angles[method], baseline, R, T)
        fill_essential(R, T, E)
        correct_px[method] = count_pairs(
            R, T, E, rays, pixel_scale, partners, counts[method], nans[method]
        )
        for k in range(bars):
            lengths[method, k] = bar_length(R, T, bar_rays, k, k + bars) / distances[k]


@compiled
def count_pairs(
    R: FloatArray,
    T: FloatArray,
    E: FloatArray,
    rays: FloatArray,
    pixel_scale: FloatArray,
    partners: IntArray,
    counts: CountArray,
    nans: IntArray,
) -> float:
    """Add |residual| and reprojection error of all pairs to `counts`, and the NaN to `nans`.

    Returns:
        The mean reprojection error of the correct pairs with a value, in pixels; NaN if none has.
    """
    total, known = 0.0, 0
    xp, yp, xs, ys = rays[0], rays[1], rays[2], rays[3]
    for i in range(partners.shape[0]):
        a = E[0, 0] * xp[i] + E[0, 1] * yp[i] + E[0, 2]
        b = E[1, 0] * xp[i] + E[1, 1] * yp[i] + E[1, 2]
        c = E[2, 0] * xp[i] + E[2, 1] * yp[i] + E[2, 2]
        for k in range(partners.shape[1]):
            j = partners[i, k]
            label = CORRECT if i == j else WRONG
            counts[RESIDUAL, label, bin_of(abs(xs[j] * a + ys[j] * b + c))] += 1
            first, second, _ = reprojection_shift(R, T, xp[i], yp[i], xs[j], ys[j], pixel_scale)
            error = 0.5 * (first + second)
            if np.isnan(error):
                nans[label] += 1
            elif label == CORRECT:
                total += error
                known += 1
            counts[REPROJECTION, label, bin_of(error)] += 1
    return total / known


@internal
def bin_of(value: float) -> int:
    if np.isnan(value):
        return OVERFLOW
    if value <= 0.0:
        return UNDERFLOW
    index = np.floor((np.log10(value) - LOWEST) / BIN_WIDTH)
    if index < 0.0:
        return UNDERFLOW
    return OVERFLOW if index >= BINS else int(index)
