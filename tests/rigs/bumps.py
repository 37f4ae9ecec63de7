"""Calibrated rigs, then new images after one of their cameras moved."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.field.checking.fits import Fit, information_of, pose_change, power_of
from stereocal.field.checking.new_images import NewImages, images_of_bars, images_of_matches
from stereocal.field.checking.prior import Prior, prior_of
from stereocal.fit.least_squares.small_steps import rig_at, step_between
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, Scene, observe, place_bars
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, FRAMES, Misjudged, random_scene, stated

OFF = Misjudged()
NEW_BARS = 5


@dataclass(frozen=True, eq=False)
class Case:
    """A calibrated rig."""

    truth: Rig
    dataset: Pair
    prior: Prior
    rng: np.random.Generator


def cases(trials: int, seed: int) -> Iterator[Case]:
    """Calibrated rigs, each with its own random stream."""
    for k in range(trials):
        rng = np.random.default_rng([seed, k])
        scene = random_scene(rng, FRAMES)
        dataset = stated(scene, rng, OFF)
        fit = refine(dataset, OFF.settings())
        yield Case(scene.rig, dataset, prior_of(refined_parameters(fit)), rng)


def new_bars(case: Case, rig: Rig) -> NewImages:
    """New bars as a rig sees them, with the lenses and lengths stated for the calibration."""
    scene = place_bars(rig, case.rng, NEW_BARS, BAR_M, DEPTHS_M)
    return images_of_bars(seen_by(case, scene), case.prior.rig)


def seen_by(case: Case, scene: Scene) -> Pair:
    """A scene as data set with the stated lenses and lengths."""
    data = case.dataset
    nominal = Nominal(data.primary, data.secondary, data.baseline_m, data.target_distance_m)
    return observe(scene, case.rng, OFF.noise_px, "new", nominal)


def bumped(case: Case, angle_rad: float) -> Rig:
    """The rig after one of its cameras turned in place about a random axis."""
    axis, pose = case.rng.standard_normal(3), case.truth.pose
    D = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis)).as_matrix()
    of_secondary = case.rng.integers(2)
    after = Pose(D @ pose.R, D @ pose.T) if of_secondary else Pose(pose.R @ D.T, pose.T)
    return replace(case.truth, pose=after)


def bound(case: Case, images: NewImages, rig: Rig) -> float:
    """Probability that an ideal test at 1 % finds the movement, with the true noise.

    The old parameters have the covariance of the file, with its estimated noise.
    """
    fit = true_fit(case, images)
    step = step_between(rig_at(rig), rig_at(case.truth))
    change = np.linalg.lstsq(fit.change.directions, step, rcond=None)[0]
    return power_of(information_of(fit), np.asarray(change, dtype=np.float64))


def true_fit(case: Case, images: NewImages) -> Fit:
    """The images fitted with the pose free and the true noise."""
    change = pose_change(case.prior, images.bars > 0)
    fit = Fit(case.prior, images, change, OFF.noise_px)
    return fit.minimise(np.zeros(len(images.numbers), dtype=np.bool_))


def matched(case: Case, rig: Rig, pairs: int) -> NewImages:
    """Matched points without lengths, anywhere where both cameras look."""
    scene = place_bars(rig, case.rng, pairs // 2, BAR_M, DEPTHS_M)
    rows = seen_by(case, scene).correspondences
    return images_of_matches(rows.frame, rows.primary, rows.secondary, case.prior.rig, "points")


def joined(case: Case, *scenes: Scene) -> Pair:
    """The bars of several rigs, one after the other."""
    seen = [seen_by(case, scene) for scene in scenes]
    rows = [part.correspondences for part in seen]
    first, second = (np.concatenate([getattr(own, which) for own in rows]) for which in CAMERAS)
    frames = np.repeat(np.arange(1, len(first) // 2 + 1), 2)
    whole = Correspondences.from_arrays(frames, "AB" * (len(first) // 2), first, second)
    return seen[0].changed(correspondences=whole)
