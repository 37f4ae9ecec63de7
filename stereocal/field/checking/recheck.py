"""Has a camera moved, or was a lens refocused, since the parameters were found?

New bars, or matched points alone, are fitted with the old parameters as prior: with nothing
changed, with the pose free, and with the focal lengths free. Nested hypotheses are compared by F
tests. A lens that shifted sideways cannot be told from a turn, and counts as one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from stereocal.errors import StereocalError
from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import (
    NOTHING,
    Change,
    Fit,
    focal_changes,
    pose_change,
)
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.noise import Noise, noise_of, robust_fit
from stereocal.field.checking.power import Smallest, power
from stereocal.field.checking.prior import Prior
from stereocal.field.checking.since import Since, since_when
from stereocal.refined.refine import robust_start
from stereocal.refined.unknowns import pose_of
from stereocal.rig.compiled import BoolArray, IntArray

BLOCK = {True: 8, False: 24}
"""Groups whose noise is estimated together: bars, and matched points alone."""
MOST_BLOCKS = 40
ROUNDS = 4
ALIKE = 0.01
"""Probability of blocks that differ so much by chance, below which neighbours are alike."""


def recheck(prior: Prior, images: NewImages, smallest: Smallest | None = None) -> Recheck:
    """Check whether a camera has moved or a lens was refocused.

    Args:
        smallest: the smallest movement that matters; "same" is said only where it would be seen.

    Raises:
        StereocalError: no pose of these cameras fits the new images at all.
    """
    prior = prior.with_bar_of(images.dataset) if images.bars else prior
    moved, focal = pose_change(prior, images.bars > 0), focal_changes(prior)
    blocks = _blocks(images)
    noise = noise_of(prior, images, moved + focal, blocks)
    if noise.outlying.all():
        raise StereocalError(
            f"{images.dataset.name}: no pose of these cameras fits the points. Are they of the "
            "same cameras, with primary and secondary not exchanged, and are the pairs right?"
        )
    noise, since = (noise, None) if len(blocks) == 1 else _settled(prior, images, noise)
    after, outlying = images, noise.outlying
    p_whole = _p_of_movement(prior, images, noise)
    if since is not None:
        later = np.arange(since.at, len(images.numbers))
        after, outlying = images.of_groups(later), noise.outlying[later]
        p_whole = since.candidates * noise.probability(since.gain, len(moved))
    pose = _pose_fit(prior, after, noise, outlying)
    both = Fit(prior, after, moved + focal, noise.sigma_px)
    both.start_at(pose_of(pose.q))
    both.minimise(outlying)
    return Recheck(
        prior=prior,
        images=images,
        after=after,
        outlying=outlying,
        noise=noise,
        since=since,
        pose=pose,
        both=both,
        power=power(pose, smallest or Smallest()),
        smallest=smallest or Smallest(),
        p_pose=min((2 if len(blocks) > 1 else 1) * p_whole, 1.0),
        p_focal=noise.probability(pose.cost - both.cost, len(focal)),
    )


def _p_of_movement(prior: Prior, images: NewImages, noise: Noise) -> float:
    """Probability that an unmoved rig prefers a movement by so much."""
    pose = _pose_fit(prior, images, noise, noise.outlying)
    same = Fit(prior, images, NOTHING, noise.sigma_px).minimise(noise.outlying)
    return noise.probability(same.cost - pose.cost, len(pose.change))


def _settled(prior: Prior, images: NewImages, noise: Noise) -> tuple[Noise, Since | None]:
    """The change point among many groups, if there is one, with the noise that goes with it.

    A run of bad detections looks like a movement that is taken back. So the groups before and
    after the change point are fitted again, each by a robust fit, until the outlying ones stay.
    """
    white = noise.sigma_px
    for _ in range(ROUNDS):
        since = _since(prior, images, noise)
        parts = _parts(prior, images, since)
        outlying = _outlying(prior, images, parts, white)
        settled = bool((outlying == noise.outlying).all())
        noise = replace(noise, outlying=outlying)
        noise = _with_likeness(prior, images, noise, parts, white)
        if settled:
            break
    return noise, _since(prior, images, noise)


def _since(prior: Prior, images: NewImages, noise: Noise) -> Since | None:
    """The change point, if a movement among the images explains them better than one before."""
    pose = _pose_fit(prior, images, noise, noise.outlying)
    found = since_when(prior, images, pose, noise.outlying)
    p_since = found.candidates * noise.probability(found.gain, len(pose.change))
    p_whole = _p_of_movement(prior, images, noise)
    return found if p_since < p_whole and found.low > images.numbers[0] else None


def _parts(prior: Prior, images: NewImages, since: Since | None) -> list[tuple[IntArray, Change]]:
    """The groups before and after the change point, and what may have changed for each."""
    index, moved = np.arange(len(images.numbers)), pose_change(prior, images.bars > 0)
    if since is None:
        return [(index, moved)]
    return [(index[: since.at], NOTHING), (index[since.at :], moved)]


def _outlying(
    prior: Prior, images: NewImages, parts: list[tuple[IntArray, Change]], sigma_px: float
) -> BoolArray:
    """(f,): the groups that contradict the others of their part."""
    outlying = np.ones(len(images.numbers), dtype=np.bool_)
    for groups, change in parts:
        fit = robust_fit(prior, images.of_groups(groups), change, sigma_px)
        if fit is not None:
            outlying[groups] = fit.outlying
    return outlying


def _with_likeness(
    prior: Prior,
    images: NewImages,
    noise: Noise,
    parts: list[tuple[IntArray, Change]],
    white_px: float,
) -> Noise:
    """The noise with that part of it in which neighbouring groups are alike.

    Errors of a lens or of a detector are alike in bars that lie close together (on the recording
    ewand12, consecutive frames are correlated by 0.6), so that many frames know less than their
    number says. It shows as blocks that differ more than their noise allows.
    """
    whole = pose_change(prior, images.bars > 0) + focal_changes(prior)
    blocks = _blocks(images, len(parts[0][0]) if len(parts) > 1 else None)

    def cost(groups: IntArray, change: Change) -> float:
        fit = Fit(prior, images.of_groups(groups), change, white_px)
        return float(fit.minimise(noise.outlying[groups]).cost)

    degrees = len(whole) * len(blocks) - sum(len(change) for _, change in parts)
    lack = sum(cost(*part) for part in parts) - sum(cost(block, whole) for block in blocks)
    factor = lack / degrees
    # Not finite where a point is behind a camera for every pose that was tried.
    if not np.isfinite(factor) or fdtrc(degrees, noise.degrees, max(factor, 0.0)) > ALIKE:
        return replace(noise, sigma_px=white_px)
    sigma_px = white_px * float(np.sqrt(factor))
    return replace(noise, sigma_px=sigma_px, degrees=float(degrees), as_before=False)


def _pose_fit(prior: Prior, images: NewImages, noise: Noise, outlying: BoolArray) -> Fit:
    """The fit with the pose free, from the old pose and from an estimate without it."""
    change = pose_change(prior, images.bars > 0)
    fits = [Fit(prior, images, change, noise.sigma_px).minimise(outlying)]
    rows = images.dataset.correspondences
    kept = np.isin(rows.frame, rows.frames[~outlying])
    start = robust_start(images.dataset, np.ascontiguousarray(images.dataset.rays[:, kept]))
    if start is not None:
        other = Fit(prior, images, change, noise.sigma_px)
        other.start_at(start)
        fits.append(other.minimise(outlying))
    return min(fits, key=lambda fit: fit.cost)


def _blocks(images: NewImages, split: int | None = None) -> list[IntArray]:
    """The groups in blocks of neighbours; one block if there are few.

    Args:
        split: a group at which a block begins in any case.
    """
    n, size = len(images.numbers), BLOCK[images.bars > 0]
    if n < 2 * size or images.numbers[0] == images.numbers[-1]:
        return [np.arange(n)]
    parts = [np.arange(n)] if split is None else [np.arange(split), np.arange(split, n)]
    most = MOST_BLOCKS // len(parts)
    return [
        block
        for part in parts
        for block in np.array_split(part, min(max(len(part) // size, 1), most))
        if len(block)
    ]
