"""What the frames left out by the screening have in common: a wrong lens, or the timing."""

from __future__ import annotations

import numpy as np

from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.geometry import residuals

COMMON_CAUSE_PROBABILITY = 0.003
"""Significance level of each of the four tests for a common cause: together, they reject 1 % of the
correct recordings."""
MINIMUM_CASES = 3
NEIGHBOURS = 5
SHARED_RESIDUAL = 0.1
"""With a wrong lens, kept points near a point left out have at least this fraction of its
residual."""


def common_cause(fit: RefinedResult, out: BoolArray) -> str:
    """A message on what the frames left out have in common; empty if it may be chance.

    Consecutive frames count as one case: a target that is hidden stays hidden for a while.
    """
    first = out & ~np.append(False, out[:-1])
    if np.count_nonzero(first) < MINIMUM_CASES:
        return ""
    depth = fit.middles_m[:, 2]
    properties = (
        (_from_centre(fit), "farther from the centre of the images", "a wrong lens distortion"),
        (depth, "farther away", "a wrong lens or baseline"),
        (-depth, "nearer", "a wrong lens or baseline"),
    )
    for values, where, cause in properties if _like_neighbours(fit, out) else ():
        if _higher(values, first, ~out):
            return (
                f"The frames left out lie {where} than the others, and neighbouring points deviate "
                f"in the same way: this suggests {cause} rather than errors of these frames. "
                "Calibrate the lenses again."
            )
    if _higher(_speed(fit), first, ~out):
        return (
            "The frames left out are those in which the bar moved fast: this suggests cameras that "
            "do not expose at the same moment, or motion blur, rather than errors of these "
            "frames. Check how the cameras are triggered."
        )
    return ""


def _higher(values: FloatArray, some: BoolArray, others: BoolArray) -> bool:
    """Whether values are significantly higher in some frames than in others (Mann-Whitney)."""
    known = np.isfinite(values)
    one, other = values[some & known], values[others & known]
    if min(len(one), len(other)) < MINIMUM_CASES:
        return False
    # Importing it takes 0.4 s, which every command and worker would wait for.
    from scipy.stats import mannwhitneyu

    return bool(mannwhitneyu(one, other, alternative="greater").pvalue < COMMON_CAUSE_PROBABILITY)


def _from_centre(fit: RefinedResult) -> FloatArray:
    """(f,): the largest distance of a frame's points from the image centre, in pixels."""
    rows, found = fit.dataset.correspondences, np.zeros(len(fit.frames))
    at = np.searchsorted(fit.frames, rows.frame)
    for points, camera in ((rows.primary, fit.primary), (rows.secondary, fit.secondary)):
        middle = 0.5 * (np.array(camera.image_size) - 1.0)
        np.maximum.at(found, at, np.linalg.norm(points - middle, axis=1))
    return found


def _speed(fit: RefinedResult) -> FloatArray:
    """(f,): the largest motion of a target in the primary image, in pixels per frame.

    Of the motions from the previous recorded frame and to the next; NaN if both are missing.
    """
    rows = fit.dataset.correspondences
    at = {
        (int(frame), int(target)): row
        for row, (frame, target) in enumerate(zip(rows.time_frame, rows.target, strict=True))
    }
    found = np.full(len(fit.frames), np.nan)
    for (frame, target), row in at.items():
        before = at.get((frame - 1, target))
        if before is None:
            continue
        moved = float(np.linalg.norm(rows.primary[row] - rows.primary[before]))
        for number in rows.frame[[before, row]]:
            index = np.searchsorted(fit.frames, number)
            found[index] = np.fmax(found[index], moved)
    return found


def _like_neighbours(fit: RefinedResult, out: BoolArray) -> bool:
    """Whether kept points near those left out have residuals of the same sign and similar size.

    A wrong lens shifts all points in a part of the image in the same way. In each frame left out,
    the point with the largest residual is compared with the nearest kept points in both images.
    Measured median ratio: 0.0 on the real recording ewand12, whose bad frames are bad detections;
    0.33 there with a distortion of the wrong sign, and 0.1 to 0.5 on simulated rigs.
    """
    rows, view = fit.dataset.correspondences, fit.apply(fit.dataset)
    signed = residuals(fit.pose.essential, view.rays[:2].T, view.rays[2:].T)
    positions = np.column_stack([rows.primary, rows.secondary])
    left_out = np.isin(rows.frame, fit.frames[out])
    kept = np.flatnonzero(~left_out)
    ratios = []
    for frame in fit.frames[out]:
        own = np.flatnonzero(rows.frame == frame)
        worst = own[np.argmax(np.abs(signed[own]))]
        distance = np.linalg.norm(positions[kept] - positions[worst], axis=1)
        nearest = kept[np.argsort(distance)[:NEIGHBOURS]]
        ratios.append(np.median(signed[nearest]) / signed[worst])
    return bool(np.median(ratios) > SHARED_RESIDUAL)
