"""Errors of new images with the old and with the repaired parameters, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereocal.field.checking.findings import Recheck
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one parameter set; NaN behind a camera."""

    reprojection_px: FloatArray
    """(n,): mean of all points of a frame, of both cameras."""
    length: FloatArray | None
    """(n,): |reconstructed - stated| / stated length of the bar, NaN without one; None if there
    are no bars."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """The errors of all frames."""

    frames: IntArray
    """(n,): the frame numbers."""
    before: Errors
    """With the old parameters."""
    after: Errors | None
    """With the repaired ones; None if none are offered."""


def residuals_of(check: Recheck) -> Residuals:
    """The errors with the old and, if they are offered, the repaired parameters."""
    return Residuals(
        np.unique(check.images.numbers),
        _errors(check, check.prior.rig),
        _errors(check, check.repaired) if check.offers_repair else None,
    )


def _errors(check: Recheck, rig: Rig) -> Errors:
    images = check.images
    seen = replace(images.dataset, primary=rig.primary, secondary=rig.secondary)
    rows = seen.correspondences
    px = rig.reprojection_errors(rows.primary, rows.secondary).mean(axis=1)
    numbers = np.unique(images.numbers)
    of_groups = np.searchsorted(numbers, images.numbers)
    at = of_groups[np.searchsorted(rows.frames, rows.frame)]
    reprojection = np.bincount(at, px) / np.bincount(at)
    if not images.bars:
        return Errors(reprojection, None)
    length = np.full(len(numbers), np.nan)
    stated = seen.bar_distances_m
    length[at[rows.bars[:, 0]]] = np.abs(seen.reconstructed_lengths_m(rig.pose) / stated - 1.0)
    return Errors(reprojection, length)
