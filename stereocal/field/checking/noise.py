"""The noise of new images, and the groups of points that contradict the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from stereocal.field.checking.fits import Change, Fit
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.refined.design_effect import clusters_in, design_effect
from stereocal.refined.refine import robust_start
from stereocal.refined.unknowns import rig_of
from stereocal.rig.clusters import FEWEST, Clusters
from stereocal.rig.compiled import BoolArray, IntArray

MAXIMUM_OUTLYING = 1 / 3
HIGHER_NOISE, LOWER_NOISE = 0.005, 1e-6
"""Probabilities of residuals by the file's noise below which the noise has changed."""
NOISE_STEP, LARGEST_NOISE = 2.0, 30.0
"""Where more groups than a third contradict the others, the noise is assumed larger by a factor,
up to a limit, px."""
EFFECT_DEGREES = 24.0
"""Degrees of freedom of a design effect: of 300 simulated recordings of runs it scattered by a
quarter."""


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise of new images, and the groups that contradict the others."""

    sigma_px: float
    degrees: float
    """Degrees of freedom behind it, with those of the file unless the noise has changed."""
    as_before: bool
    """Whether it agrees with the file's noise."""
    outlying: BoolArray
    """(f,)."""
    design_effect: float = 1.0
    """Variance over that with independent groups."""

    @property
    def counted_px(self) -> float:
        """The noise with which independent groups would have the same information."""
        return self.sigma_px * float(np.sqrt(self.design_effect))

    def probability(self, gain: float, degrees: int) -> float:
        """p-value of this cost difference, for hypotheses that differ by `degrees` values."""
        return float(fdtrc(degrees, self.degrees, max(gain, 0.0) / degrees))


def noise_of(prior: Prior, images: NewImages, change: Change, blocks: list[IntArray]) -> Noise:
    """The noise by fits with everything free that may have changed, block by block.

    A movement between blocks then neither counts as noise nor makes groups outlying. The residuals
    and the file's noise are pooled unless they differ. A few residuals that are small by chance are
    no lower noise: taken for it, they gave 1.35 % false alarms instead of 1 %.
    """
    sigma = prior.sigma_px
    total, degrees, outlying = _blocks(prior, images, change, blocks, sigma)
    while outlying.mean() > MAXIMUM_OUTLYING and sigma < LARGEST_NOISE:
        sigma *= NOISE_STEP
        total, degrees, outlying = _blocks(prior, images, change, blocks, sigma)
    if degrees < 1:
        return Noise(sigma, prior.degrees, sigma == prior.sigma_px, outlying)
    ratio = total / degrees
    above = float(fdtrc(degrees, prior.degrees, ratio))
    if sigma == prior.sigma_px and HIGHER_NOISE < above < 1 - LOWER_NOISE:
        whole = prior.degrees + degrees
        pooled = sigma * np.sqrt((prior.degrees + total) / whole)
        return Noise(float(pooled), whole, True, outlying)
    for _ in range(5):
        sigma *= float(np.sqrt(max(total / degrees, 1e-4)))
        total, degrees, outlying = _blocks(prior, images, change, blocks, sigma)
        if degrees < 1 or abs(total / degrees - 1.0) < 0.02:
            break
    return Noise(sigma, max(float(degrees), 1.0), False, outlying)


def _blocks(
    prior: Prior, images: NewImages, change: Change, blocks: list[IntArray], sigma_px: float
) -> tuple[float, int, BoolArray]:
    """Sum of the costs, degrees of freedom, and outlying groups, of robust fits of all blocks."""
    total, degrees = 0.0, 0
    outlying = np.ones(len(images.numbers), dtype=np.bool_)
    for block in blocks:
        part = images if len(blocks) == 1 else images.of_groups(block)
        found = robust_fit(prior, part, change, sigma_px)
        if found is None:
            continue
        total, degrees = total + found.cost, degrees + found.degrees
        outlying[block] = found.outlying
    return total, degrees, outlying


def robust_fit(prior: Prior, images: NewImages, change: Change, sigma_px: float) -> Fit | None:
    """The robust fit from the old pose or, where it leaves groups out, from another estimate."""
    best: Fit | None = None
    for start in (None, robust_start):
        fit = Fit(prior, images, change, sigma_px)
        if start is not None:
            pose = start(images.dataset, images.dataset.rays)
            if pose is None:
                break
            fit.start_at(pose)
        if fit.run() and (best is None or fit.outlying.sum() < best.outlying.sum()):
            best = fit
        if best is not None and not best.outlying.any():
            break
    return best


def with_design_effect(
    prior: Prior, images: NewImages, noise: Noise, parts: list[tuple[IntArray, Change]]
) -> Noise:
    """The noise with the design effect: the file's or, if larger, that of a part of the images.

    Errors of a lens or of a detector are alike in bars that lie close together, so that many frames
    know less than their number says.

    Args:
        parts: groups before and after a movement, and what may have changed for each.
    """
    found = replace(noise, design_effect=prior.design_effect)
    for groups, change in parts:
        fit = Fit(prior, images.of_groups(groups), change, noise.sigma_px)
        fit.minimise(noise.outlying[groups])
        effect, clusters = _design_effect(fit, prior.design_effect > 1)
        if effect > found.design_effect:
            degrees = min(noise.degrees, float(clusters * max(len(change), 1)))
            found = replace(found, design_effect=effect, degrees=degrees)
    if found.design_effect > 1:
        found = replace(found, degrees=min(found.degrees, EFFECT_DEGREES))
    return found


def _design_effect(fit: Fit, runs: bool) -> tuple[float, int]:
    """The design effect of the groups of a fit, and the number of clusters.

    Args:
        runs: count the groups in runs also where too few show that their errors are alike.
    """
    used = np.flatnonzero(~fit.outlying)
    if len(used) < 2 or not np.isfinite(fit.cost):
        return 1.0, len(used)
    data, q = fit.dataset, fit.q
    rig = rig_of(data.primary, data.secondary, q)
    frames = fit.frames[used]
    rows = data.correspondences.of_frames(frames)
    clusters = clusters_in(rows, rig, frames)
    if runs and not clusters.has_runs:
        clusters = Clusters(np.arange(len(used)) * FEWEST // len(used), max(len(used) // FEWEST, 1))
    return design_effect(fit, q, used, clusters), clusters.count
