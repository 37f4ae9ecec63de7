"""Is each target of an object where it is said to be?

The images give the mean distance of every two targets; the scale is that of the fit. A target is
named if the distances between all others agree with each other and with the measured baseline. Of
three targets two have a single distance, so that only a measured baseline can tell which of the
three it is.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import RefineSettings, baseline_sigma_m, distance_sigma_m
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult

MOST_TARGETS = 12
"""Of an object with more, such as a board, all targets come from one print."""
FEWEST_FRAMES = 5
CONTRADICTING = 4.5
"""Standard errors by which a distance contradicts the others; of normal errors 7 in a million."""
SIGMA_OF_MEDIAN = 1.25 * 1.4826
"""Standard error of a median over the median absolute deviation, by the root of the number."""


class _Distance(NamedTuple):
    """Of two targets, in logarithms: reconstructed over stated, and its standard error."""

    ends: tuple[int, int]
    ratio: float
    sigma: float


def misplaced_target(fit: RefinedResult) -> str:
    """Which target of the object is not where it is said to be; empty if none is.

    Args:
        fit: of all its targets.
    """
    rows = fit.dataset.correspondences
    if rows.rigid_object is None or len(rows.names) > MOST_TARGETS:
        return ""
    distances = _distances(fit)
    if _agree(distances):
        return ""
    try:  # whose lengths a wrong baseline does not change
        free = refine(fit.dataset, replace(fit.settings, baseline_sigma_m=np.inf), fit.pose)
    except StereocalError:
        free = fit
    fit, distances = free, _distances(free)
    suspects = [k for k in range(len(rows.names)) if _explains(fit, distances, k)]
    ranked = sorted(distances, key=lambda it: -abs(it.ratio) / it.sigma)
    named = [it for it in ranked if suspects[1:] or {*suspects} & {*it.ends}][:3]
    stated, scale = rows.rigid_object.distance, _scale(distances, suspects)
    seen = "; ".join(
        f"{rows.names[a]}-{rows.names[b]} {1e3 * stated(a, b) * np.exp(ratio - scale):.1f} ± "
        f"{1e3 * stated(a, b) * sigma:.1f} mm, stated {1e3 * stated(a, b):.1f} mm"
        for (a, b), ratio, sigma in named or ranked[:3]
    )
    names = [rows.names[k] for k in suspects] or list(rows.names)
    if len(suspects) == 1:
        return f"Target {names[0]} is not where it is said to be on the object: {seen}."
    which = f"{', '.join(names[:-1])} or {names[-1]}"
    return (
        f"The distances between the targets contradict each other: {seen}. The images cannot tell "
        f"which target is not where it is said to be ({which}): measure the distances again."
    )


def _distances(fit: RefinedResult) -> list[_Distance]:
    """The distances of every two targets that enough frames show."""
    used = fit.used_rows
    rows = fit.dataset.correspondences.where(used)
    assert rows.rigid_object is not None
    points = np.full((len(rows.frames), len(rows.names), 3), np.nan)
    frame_of = np.searchsorted(rows.frames, rows.frame)
    points[frame_of, rows.target] = fit.rig.reconstruct(rows.primary, rows.secondary)
    sigma_m, distances = distance_sigma_m(fit.dataset.recording, fit.settings), []
    for a, b in combinations(range(len(rows.names)), 2):
        stated = rows.rigid_object.distance(a, b)
        logs = np.log(np.linalg.norm(points[:, a] - points[:, b], axis=1) / stated)
        logs = logs[np.isfinite(logs)]
        if len(logs) < FEWEST_FRAMES:
            continue
        middle = float(np.median(logs))
        spread = SIGMA_OF_MEDIAN * float(np.median(np.abs(logs - middle)))
        of_noise = spread * np.sqrt(fit.design_effect / len(logs))
        distances.append(_Distance((a, b), middle, float(np.hypot(of_noise, sigma_m / stated))))
    return distances


def _mean(distances: Iterable[_Distance]) -> tuple[float, float]:
    """The weighted mean of the ratios and its standard error."""
    weights = np.array([it.sigma**-2 for it in distances])
    ratios = np.array([it.ratio for it in distances])
    return float(weights @ ratios / weights.sum()), float(weights.sum() ** -0.5)


def _agree(distances: list[_Distance]) -> bool:
    """Whether all distances have one scale."""
    if len(distances) < 2:
        return True
    mean, sigma = _mean(distances)
    return all(abs(it.ratio - mean) < CONTRADICTING * np.hypot(it.sigma, sigma) for it in distances)


def _explains(fit: RefinedResult, distances: list[_Distance], target: int) -> bool:
    """Whether the distances without a target agree, and with the measured baseline."""
    others = [it for it in distances if target not in it.ends]
    if not others or not _agree(others):
        return False
    dataset = fit.dataset
    stated = baseline_sigma_m(dataset, RefineSettings()) / dataset.baseline_m
    if dataset.baseline_is_free:
        return True
    scale, sigma = _mean(others)
    off = np.log(fit.pose.baseline / dataset.baseline_m) - scale
    return bool(abs(off) < CONTRADICTING * np.hypot(sigma, stated))


def _scale(distances: list[_Distance], suspects: list[int]) -> float:
    """The scale of the distances without the only suspect, in logarithms; 0 with several."""
    if len(suspects) != 1:
        return 0.0
    return _mean([it for it in distances if suspects[0] not in it.ends])[0]
