"""Reconstruction of matched pairs: places, errors, standard errors, and the world's frame."""

from dataclasses import replace

import numpy as np

from stereocal.fit.parameter_file import covariance_names
from stereocal.matching.reconstruction import Points3D, midpoints
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import ANGLES, BASELINE_M, PRIMARY, RIG, SECONDARY, bar_ends, images

RIG_3D = RigParameters(PRIMARY, SECONDARY, RIG, "3d", 1.0, {}, {})
POINTS = bar_ends(10)
PIXELS = images(POINTS)
PAIRS = np.stack(PIXELS, axis=1)
BEHIND = np.stack([PIXELS[0][::-1], PIXELS[1] + [600.0, 0.0]], axis=1)
WORLD = Pose.from_angles(Angles(0.3, -0.4, 1.2, 0.1, 0.2), 5.0)


def measured(
    rig: RigParameters, pairs: FloatArray = PAIRS, world: Pose | None = None, sigma_px: float = 0.3
) -> Points3D:
    return midpoints(rig, pairs, sigma_px).in_frame(world, rig.volume, with_errors=True)


def test_points_behind_are_nan() -> None:
    found = measured(RIG_3D, BEHIND)
    behind = np.isnan(found.xyz).any(axis=1)
    assert behind.any() and np.isnan(found.error_px[behind]).all()


def test_the_world_frame_turns_points_and_their_errors() -> None:
    plain = measured(RIG_3D)
    turned = measured(RIG_3D, world=WORLD)
    np.testing.assert_allclose(turned.xyz, WORLD.apply(POINTS), rtol=0, atol=1e-10)
    assert plain.sigma_m is not None and turned.sigma_m is not None
    np.testing.assert_allclose(
        np.linalg.norm(turned.sigma_m, axis=1), np.linalg.norm(plain.sigma_m, axis=1), rtol=1e-9
    )
    assert not np.allclose(turned.sigma_m, plain.sigma_m, rtol=0.15)


def test_points_outside_the_volume_of_the_bars_in_any_frame() -> None:
    """Of the points, those to 8 m deep are inside, also after the world has turned them."""
    volume = Volume((-1.0, 1.0), (-1.0, 1.0), (5.0, 8.0))
    rig = replace(RIG_3D, volume=volume)
    far = POINTS[:, 2] > 8.0
    assert 0 < far.sum() < len(far)
    for world in (None, WORLD):
        found = measured(rig, world=world)
        np.testing.assert_array_equal(found.outside_volume, far)
    assert measured(RIG_3D).outside_volume is None
    lost = measured(rig, BEHIND)
    assert lost.outside_volume is not None and lost.outside_volume[np.isnan(lost.error_px)].all()


def noisy(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    first, second = (p + 0.3 * rng.standard_normal(p.shape) for p in PIXELS)
    return first, second


def test_standard_errors_are_the_scatter_of_repeated_images() -> None:
    sigma = measured(RIG_3D).sigma_m
    rng = np.random.default_rng(0)
    repeated = np.array([RIG_3D.reconstruct(*noisy(rng)) for _ in range(300)])
    # 300 repeats fix a standard deviation to 4.1 %, and the raw image's noise is a few percent
    # larger or smaller in the undistorted one; measured: within 8 %.
    np.testing.assert_allclose(repeated.std(axis=0), np.asarray(sigma), rtol=0.15)


def with_covariance(covariance: FloatArray) -> RigParameters:
    """The rig with a covariance (6, 6) of its pose."""
    entry = {"of": covariance_names((PRIMARY, SECONDARY))[:6], "matrix": covariance.tolist()}
    return replace(RIG_3D, uncertainties={"covariance": entry, "sigma_px": {"value": 0.0}})


def test_a_covariance_is_symmetric_within_its_standard_errors() -> None:
    """An entry near 0 has no digits of its own: a sound file of a wrong bar was refused."""
    nearly = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-4])
    nearly[0, 1] = 1e-17
    sigma = measured(with_covariance(nearly), sigma_px=0.0).sigma_m
    assert sigma is not None and np.isfinite(sigma).all()
    nearly[0, 1] = 1e-7
    with refused("symmetric"):
        measured(with_covariance(nearly), sigma_px=0.0)


def test_the_covariance_of_the_pose_adds() -> None:
    scatter = np.array([2e-4, 3e-4, 1e-4, 2e-4, 3e-4, 2e-3])
    mixing = np.eye(6) + 0.5 * np.random.default_rng(1).standard_normal((6, 6))
    root = scatter[:, None] * mixing
    sigma = measured(with_covariance(root @ root.T), sigma_px=0.0).sigma_m
    rng = np.random.default_rng(2)
    here = np.array([*ANGLES, BASELINE_M])
    repeated = []
    for _ in range(300):
        there = here + root @ rng.standard_normal(6)
        pose = Pose.from_angles(Angles(*there[:5].tolist()), there[5])
        moved = RigParameters(PRIMARY, SECONDARY, pose, "3d", 1.0, {}, {})
        repeated.append(measured(moved).xyz)
    # Measured: within 8 %.
    np.testing.assert_allclose(np.array(repeated).std(axis=0), np.asarray(sigma), rtol=0.15)
