"""Has a camera moved, or was a lens refocused, since the parameters were found?

New bars, or matched points alone, are fitted with the old parameters as prior: with nothing
changed, with the pose free, and with the focal lengths free. Nested hypotheses are compared by F
tests. A lens that shifted sideways cannot be told from a turn, and counts as one.
"""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.findings import Recheck
from stereocal.field.fits import (
    NOTHING,
    Change,
    Fit,
    Noise,
    focal_changes,
    noise_of,
    pose_change,
    pose_of,
)
from stereocal.field.new_images import NewImages
from stereocal.field.power import Smallest, power
from stereocal.field.prior import Prior
from stereocal.field.since import Since, since_when
from stereocal.refined.refine import robust_start
from stereocal.rig.compiled import BoolArray, IntArray

BLOCK = {True: 8, False: 24}
"""Groups whose noise is estimated together: bars, and matched points alone."""
MOST_BLOCKS = 40


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
    after, outlying = images, noise.outlying
    pose = _pose_fit(prior, images, moved, noise, outlying)
    p_pose = _p_of_movement(prior, images, pose, noise)
    since = _since(prior, images, pose, noise, p_pose) if len(blocks) > 1 else None
    if since is not None:
        # The block that the change point lay in took part of the movement for noise.
        noise = noise_of(prior, images, moved + focal, _blocks(images, since.at))
        pose = _pose_fit(prior, images, moved, noise, noise.outlying)
        since = since_when(prior, images, pose, noise.outlying)
        later = np.arange(since.at, len(images.numbers))
        after, outlying = images.of_groups(later), noise.outlying[later]
        pose = _pose_fit(prior, after, moved, noise, outlying)
        p_pose = since.candidates * noise.probability(since.gain, len(moved))
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
        p_pose=min((2 if len(blocks) > 1 else 1) * p_pose, 1.0),
        p_focal=noise.probability(pose.cost - both.cost, len(focal)),
    )


def _p_of_movement(prior: Prior, images: NewImages, pose: Fit, noise: Noise) -> float:
    """Probability that an unmoved rig prefers a movement by so much."""
    same = Fit(prior, images, NOTHING, noise.sigma_px).minimise(noise.outlying)
    return noise.probability(same.cost - pose.cost, len(pose.change))


def _since(
    prior: Prior, images: NewImages, pose: Fit, noise: Noise, p_whole: float
) -> Since | None:
    """The change point, if a movement among the images explains them better than one before."""
    found = since_when(prior, images, pose, noise.outlying)
    p_since = found.candidates * noise.probability(found.gain, len(pose.change))
    return found if p_since < p_whole and found.low > images.numbers[0] else None


def _pose_fit(
    prior: Prior, images: NewImages, change: Change, noise: Noise, outlying: BoolArray
) -> Fit:
    """The fit with the pose free, from the old pose and from an estimate without it."""
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
