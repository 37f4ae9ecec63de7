"""Has a camera moved, or was a lens refocused, since the parameters were found?

New bars, or matched points alone, are fitted with the old parameters as prior: with nothing
changed, with the pose free, and with the focal lengths free. Nested hypotheses are compared by F
tests. A lens that shifted sideways cannot be distinguished from a turn, and counts as one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import NOTHING, Change, Fit, focal_changes, pose_change
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.noise import Noise, noise_of, robust_fit, with_design_effect
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


def recheck(prior: Prior, images: NewImages, smallest: Smallest | None = None) -> Recheck:
    """Check whether a camera has moved or a lens was refocused.

    Args:
        smallest: the smallest movement that matters; "same" is reported only if it would be seen.
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
    noise = replace(noise, design_effect=prior.design_effect)
    if len(blocks) == 1:
        whole = _parts(prior, images, None)
        noise, since = with_design_effect(prior, images, noise, whole), None
    else:
        noise, since = _settled(prior, images, noise)
    after, outlying = images, noise.outlying
    p_whole = _p_of_movement(prior, images, noise)
    if since is not None:
        later = np.arange(since.at, len(images.numbers))
        after, outlying = images.of_groups(later), noise.outlying[later]
        p_whole = since.candidates * noise.probability(since.gain, len(moved))
    pose = _pose_fit(prior, after, noise, outlying)
    both = Fit(prior, after, moved + focal, noise.counted_px)
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
    same = Fit(prior, images, NOTHING, noise.counted_px).minimise(noise.outlying)
    return noise.probability(same.cost - pose.cost, len(pose.change))


def _settled(prior: Prior, images: NewImages, noise: Noise) -> tuple[Noise, Since | None]:
    """The change point among many groups, if there is one, with the noise that goes with it.

    A run of bad detections looks like a movement that is taken back. So the groups before and
    after the change point are fitted again, each by a robust fit, until the outlying ones stay. The
    parts are fitted by themselves for the design effect too, of which a movement is no part.
    """
    for _ in range(ROUNDS):
        parts = _parts(prior, images, _since(prior, images, noise))
        outlying = _outlying(prior, images, parts, noise.sigma_px)
        settled = bool((outlying == noise.outlying).all())
        noise = with_design_effect(prior, images, replace(noise, outlying=outlying), parts)
        if settled:
            break
    return noise, _since(prior, images, noise)


def _since(prior: Prior, images: NewImages, noise: Noise) -> Since | None:
    """The change point, if a lasting movement explains the images better than one before them."""
    pose = _pose_fit(prior, images, noise, noise.outlying)
    found = since_when(prior, images, pose, noise.outlying)
    p_since = found.candidates * noise.probability(found.gain, len(pose.change))
    p_whole = _p_of_movement(prior, images, noise)
    among = found.lasts and found.low > images.numbers[0]
    return found if among and p_since < p_whole else None


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


def _pose_fit(prior: Prior, images: NewImages, noise: Noise, outlying: BoolArray) -> Fit:
    """The fit with the pose free, from the old pose and from an estimate without it."""
    change = pose_change(prior, images.bars > 0)
    fits = [Fit(prior, images, change, noise.counted_px).minimise(outlying)]
    rows = images.dataset.correspondences
    kept = np.isin(rows.frame, rows.frames[~outlying])
    start = robust_start(images.dataset, np.ascontiguousarray(images.dataset.rays[:, kept]))
    if start is not None:
        other = Fit(prior, images, change, noise.counted_px)
        other.start_at(start)
        fits.append(other.minimise(outlying))
    return min(fits, key=lambda fit: fit.cost)


def _blocks(images: NewImages) -> list[IntArray]:
    """The groups in blocks of neighbours; one block if there are few."""
    n, size = len(images.numbers), BLOCK[images.bars > 0]
    if n < 2 * size or images.numbers[0] == images.numbers[-1]:
        return [np.arange(n)]
    return list(np.array_split(np.arange(n), min(n // size, MOST_BLOCKS)))
