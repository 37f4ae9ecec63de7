"""Errors of new images with the old and with the repaired parameters, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

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
    images = check.images
    numbers, at = np.unique(images.numbers, return_inverse=True)

    def errors(rig: Rig) -> Errors:
        px, length = images.errors_with(rig)  # bars are one group a frame
        return Errors(np.bincount(at, px) / np.bincount(at), length if images.bars else None)

    repaired = errors(check.repaired) if check.offers_repair else None
    return Residuals(numbers, errors(check.prior.rig), repaired)
