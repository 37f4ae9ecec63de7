"""Has a camera moved, or was a lens refocused, since the parameters were found?

New bars, or matched points alone, are fitted with the old parameters as prior: with nothing
changed, with the pose free, and with the focal lengths free. Nested hypotheses are compared by F
tests. A lens that shifted sideways cannot be distinguished from a turn, and counts as one.
"""

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from scipy.special import fdtrc

from stereocal.errors import StereocalError
from stereocal.field.checking.cropped import uncropped
from stereocal.field.checking.findings import CONSISTENT, Recheck
from stereocal.field.checking.fits import (
    NOTHING,
    Change,
    Fit,
    ImageNoise,
    Smallest,
    focal_changes,
    pose_change,
    power,
)
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.field.checking.since import Since, since_when
from stereocal.fit.least_squares.design_effect import clusters_in, design_effect
from stereocal.fit.least_squares.small_steps import pose_at, rig_of
from stereocal.fit.start.first_poses import robust_start
from stereocal.rig.clusters import in_runs
from stereocal.system.array_types import BoolArray, IntArray

BLOCK = {True: 8, False: 24}
"""Groups whose noise is estimated together: bars, and matched points alone."""
MOST_BLOCKS = 40
ROUNDS = 4
MAXIMUM_OUTLYING = 1 / 3
HIGHER_NOISE, LOWER_NOISE = 0.005, 1e-6
"""Probabilities of residuals by the file's noise below which the noise has changed."""
NOISE_STEP, LARGEST_NOISE = 2.0, 30.0
"""Where more groups than a third contradict the others, the noise is assumed larger by a factor,
up to a limit, px."""
OTHER_BAR = 0.01
"""Relative difference of lengths from which on a bar may be another one."""
CROP_GAIN = 1.3
"""How many times the noise of images that are no crops must be larger."""
EFFECT_DEGREES = 24.0
"""Degrees of freedom of a design effect: of 300 simulated recordings of runs it scattered by a
quarter."""
Part = tuple[IntArray, Change]
"""Groups, and what may have changed for them."""


def recheck(prior: Prior, images: NewImages, smallest: Smallest | None = None) -> Recheck:
    """Check whether a camera has moved or a lens was refocused.

    Where nothing has changed if the bar is longer by a factor than is stated, it is another bar: a
    camera that moves along the baseline alone, without the least turn, is far less likely. So is it
    a crop where the points fit so much better from another corner of the images.

    Args:
        smallest: the smallest movement that matters; "same" is reported only if it would be seen.
    """
    found = _recheck(prior, images, smallest)
    as_before = found.usable and not found.changed
    if as_before or found.since is not None or not images.bars:
        return found
    factor = images.times_as_long(prior.rig) if images.is_of_bar else 1.0
    of_bar = [images.with_bar(factor)] if abs(np.log(factor)) > OTHER_BAR else []
    likely = (
        (it, _recheck(prior, it, smallest)) for it in chain(of_bar, uncropped(images, prior.rig))
    )
    for otherwise, checked in likely:
        explains = checked.usable and not checked.changed and checked.p_pose > CONSISTENT
        better = found.noise.sigma_px > CROP_GAIN * checked.noise.sigma_px
        if explains and (otherwise in of_bar or better):
            return checked
    return found


def _recheck(prior: Prior, images: NewImages, smallest: Smallest | None) -> Recheck:
    """The check, with the bar as it is stated."""
    prior = prior.with_bar_of(images.dataset) if images.bars else prior
    prior = prior.with_lens_errors(images.dataset)
    smallest = smallest or Smallest()
    check, focal = _Check(prior, images), focal_changes(prior)
    blocks = check.blocks
    noise = check.noise([(block, check.moved + focal) for block in blocks])
    if noise.outlying.all():
        raise StereocalError(
            f"{images.dataset.name}: no pose of these cameras fits the points. Are they of the "
            "same cameras, with primary and secondary not exchanged, and are the pairs right?"
        )
    if len(blocks) == 1:
        noise, since = check.with_design_effect(noise, check.parts(None)), None
    else:
        noise, since = check.settled(check.with_least_effect(noise))
    after, outlying = images, noise.outlying
    if since is None:
        p_whole = check.p_of_movement(noise)
    else:
        later = np.arange(since.at, len(images.numbers))
        after, outlying = images.of_groups(later), noise.outlying[later]
        # Before and after, a bar is at other places: lenses that are off look like a movement then.
        p_after = _Check(prior, after).p_of_movement(replace(noise, outlying=outlying))
        p_since = since.candidates * noise.probability(since.gain, len(check.moved))
        p_whole = max(p_since, p_after)
    pose = _Check(prior, after).pose_fit(noise.counted_px, outlying)
    both = Fit(prior, after, check.moved + focal, noise.counted_px)
    both.minimise(outlying, pose_at(pose.at))
    p_pose = min((2 if len(blocks) > 1 else 1) * p_whole, 1.0)
    p_focal = noise.probability(pose.cost - both.cost, len(focal))
    power_of_pose = power(pose, smallest)
    return Recheck(
        prior,
        images,
        after,
        outlying,
        noise,
        since,
        pose,
        both,
        power_of_pose,
        smallest,
        p_pose,
        p_focal,
    )


@dataclass(frozen=True, eq=False)
class _Check:
    """New images under the prior of a parameter file."""

    prior: Prior
    images: NewImages

    @property
    def moved(self) -> Change:
        return pose_change(self.prior, self.images.bars > 0)

    @property
    def blocks(self) -> list[IntArray]:
        """The groups in blocks of neighbours; one block if there are few."""
        numbers, size = self.images.numbers, BLOCK[self.images.bars > 0]
        n = len(numbers)
        few = n < 2 * size or numbers[0] == numbers[-1]
        return list(np.array_split(np.arange(n), 1 if few else min(n // size, MOST_BLOCKS)))

    def parts(self, since: Since | None) -> list[Part]:
        """The groups before and after the change point."""
        index = np.arange(len(self.images.numbers))
        if since is None:
            return [(index, self.moved)]
        return [(index[: since.at], NOTHING), (index[since.at :], self.moved)]

    def noise(self, parts: list[Part]) -> ImageNoise:
        """The noise by fits with everything free that may have changed, part by part: a movement
        between parts then neither counts as noise nor makes groups outlying.

        The residuals and the file's noise are pooled unless theirs is larger. It is never smaller
        than the file's, which holds what the lenses do not explain. In neighbours, which are in one
        part of the images, that is alike: what their residuals lack is an error of whole blocks.
        """
        sigma, known = self.prior.sigma_px, self.prior.degrees
        total, degrees, outlying = self._robust(parts, sigma)
        while outlying.mean() > MAXIMUM_OUTLYING and sigma < LARGEST_NOISE:
            sigma *= NOISE_STEP
            total, degrees, outlying = self._robust(parts, sigma)
        as_before = sigma == self.prior.sigma_px
        if degrees < 1:
            return ImageNoise(sigma, known, as_before, outlying)
        above = float(fdtrc(degrees, known, total / degrees))
        if as_before and above > HIGHER_NOISE:
            pooled = float(sigma * np.sqrt(max((known + total) / (known + degrees), 1.0)))
            lacking = (above > 1 - LOWER_NOISE) * (1.0 - total / degrees)
            alike = 1.0 + (BLOCK[self.images.bars > 0] - 1) * lacking
            return ImageNoise(pooled, known + degrees, True, outlying, least_effect=alike)
        for _ in range(5):
            sigma *= float(np.sqrt(max(total / degrees, 1e-4)))
            total, degrees, outlying = self._robust(parts, sigma)
            if degrees < 1 or abs(total / degrees - 1.0) < 0.02:
                break
        return ImageNoise(sigma, max(float(degrees), 1.0), False, outlying)

    def _robust(self, parts: list[Part], sigma_px: float) -> tuple[float, int, BoolArray]:
        """Sum of the costs, degrees of freedom, and outlying groups, of robust fits of all parts.

        Each from the old pose or, where it leaves groups out, from another estimate.
        """
        total, degrees = 0.0, 0
        outlying = np.ones(len(self.images.numbers), dtype=np.bool_)
        for groups, change in parts:
            images = self.images.of_groups(groups)
            fit = Fit(self.prior, images, change, sigma_px)
            fits = [fit] * fit.run()
            if not fits or fit.outlying.any():
                fit = Fit(self.prior, images, change, sigma_px)
                if pose := robust_start(images.dataset, images.dataset.rays):
                    fit.start_from(pose)
                    fits += [fit] * fit.run()
            if fits:
                best = min(fits, key=lambda fit: fit.outlying.sum())
                total, degrees = total + best.cost, degrees + best.degrees
                outlying[groups] = best.outlying
        return total, degrees, outlying

    def with_least_effect(self, noise: ImageNoise) -> ImageNoise:
        """The noise with the least design effect that it may have."""
        return replace(noise, design_effect=max(self.prior.design_effect, noise.least_effect))

    def with_design_effect(self, noise: ImageNoise, parts: list[Part]) -> ImageNoise:
        """The noise with the design effect: the file's or, if larger, that of a part of the images.
        Errors of a lens or of a detector are alike in bars that lie close together."""
        of_file, widened = self.prior.design_effect, self.with_least_effect(noise)
        for groups, change in parts:
            fit = Fit(self.prior, self.images.of_groups(groups), change, noise.sigma_px)
            fit.minimise(noise.outlying[groups])
            effect, clusters = _design_effect(fit, of_file > 1 or self.images.follow_each_other)
            if effect > widened.design_effect:
                degrees = min(noise.degrees, float(clusters * max(len(change), 1)))
                widened = replace(widened, design_effect=effect, degrees=degrees)
        if widened.design_effect > 1:
            widened = replace(widened, degrees=min(widened.degrees, EFFECT_DEGREES))
        return widened

    def settled(self, noise: ImageNoise) -> tuple[ImageNoise, Since | None]:
        """The change point among many groups, if there is one, with the noise that goes with it.

        A run of bad detections looks like a movement that is taken back. So the groups before and
        after the change point are fitted again, each by a robust fit, until the outlying ones stay.
        The parts are fitted by themselves for the design effect too, of which a movement is no
        part.
        """
        for _ in range(ROUNDS):
            parts = self.parts(self._since(noise))
            outlying = self._robust(parts, noise.sigma_px)[2]
            settled = bool((outlying == noise.outlying).all())
            noise = self.with_design_effect(replace(noise, outlying=outlying), parts)
            if settled:
                break
        return noise, self._since(noise)

    def _since(self, noise: ImageNoise) -> Since | None:
        """The change point, if a lasting movement explains the images better than one before."""
        pose = self.pose_fit(noise.counted_px, noise.outlying)
        since = since_when(self.prior, self.images, pose, noise.outlying)
        p_since = since.candidates * noise.probability(since.gain, len(pose.change))
        among = since.lasts and since.low > self.images.numbers[0]
        return since if among and p_since < self.p_of_movement(noise) else None

    def p_of_movement(self, noise: ImageNoise) -> float:
        """Probability that an unmoved rig prefers a movement by so much."""
        pose = self.pose_fit(noise.counted_px, noise.outlying)
        same = Fit(self.prior, self.images, NOTHING, noise.counted_px).minimise(noise.outlying)
        return noise.probability(same.cost - pose.cost, len(pose.change))

    def pose_fit(self, sigma_px: float, outlying: BoolArray) -> Fit:
        """The fit with the pose free, from the old pose and from an estimate without it."""
        data = self.images.dataset
        kept = np.isin(data.correspondences.frame, data.correspondences.frames[~outlying])
        start = robust_start(data, np.ascontiguousarray(data.rays[:, kept]))
        fits = (
            Fit(self.prior, self.images, self.moved, sigma_px).minimise(outlying, pose)
            for pose in ((None, start) if start is not None else (None,))
        )
        return min(fits, key=lambda fit: fit.cost)


def _design_effect(fit: Fit, runs: bool) -> tuple[float, int]:
    """The design effect of the groups of a fit, and the number of clusters; with `runs`, they count
    in runs also where too few show that their errors are alike."""
    used = np.flatnonzero(~fit.outlying)
    if len(used) < 2 or not np.isfinite(fit.cost):
        return 1.0, len(used)
    data, frames = fit.images.dataset, fit.frames[used]
    rig = rig_of(data.primary, data.secondary, fit.at)
    clusters = clusters_in(data.correspondences.of_frames(frames), rig, frames)
    clusters = in_runs(clusters) if runs else clusters
    return design_effect(fit, used, clusters), clusters.count
