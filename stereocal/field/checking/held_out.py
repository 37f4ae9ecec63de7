"""Whether repaired parameters measure new images better that they were not fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocal.field.checking.fits import Fit
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.refined.unknowns import rig_of

FOLDS = 5
"""Runs of neighbouring groups, each held out once: neighbours share their errors."""
CLEARLY = 0.5
"""Where the errors in the images fall to this fraction, the repaired parameters are better though
lengths are not: a turn about the baseline's normal hardly changes any."""
NOT_WORSE = 1.2
"""By what factor length errors may grow then, by chance."""


@dataclass(frozen=True)
class HeldOut:
    """Mean errors of groups that were held out, before and after the repair."""

    px: tuple[float, float]
    """Mean reprojection errors."""
    length: tuple[float, float] | None
    """Mean |reconstructed - stated| / stated lengths; None without bars."""

    @property
    def better(self) -> bool:
        """Whether the repaired parameters measure them better."""
        before, after = self.px
        if self.length is None:
            return after < before
        was, now = self.length
        return now < was or (after < CLEARLY * before and now < NOT_WORSE * was)


def measured_held_out(prior: Prior, images: NewImages, best: Fit) -> HeldOut:
    """The errors of each run of groups with the old parameters, and repaired by the other runs.

    Args:
        best: the fit of all groups; those outlying there are not used. If fewer than two are left,
            nothing is better.
    """
    kept = np.flatnonzero(~best.outlying)
    errors = []
    if len(kept) < 2:
        return HeldOut((0.0, 0.0), None)
    for held in np.array_split(kept, min(FOLDS, len(kept))):
        fit = Fit(prior, images, best.change, best.sigma_px)
        fit.p[:] = best.p
        fit.points[:] = np.nan
        outlying = best.outlying.copy()
        outlying[held] = True
        q, old = fit.minimise(outlying).q, prior.rig
        part, repaired = images.of_groups(held), rig_of(old.primary, old.secondary, q)
        errors.append(np.stack([part.errors_with(old), part.errors_with(repaired)], axis=1))
    whole = np.concatenate(errors, axis=2)
    (px, new_px), lengths = np.nanmean(whole[0], axis=1).tolist(), None
    if np.isfinite(whole[1]).any(axis=1).all():
        was, now = np.nanmean(whole[1], axis=1).tolist()
        lengths = was, now
    return HeldOut((px, new_px), lengths)
