"""A rig with a known truth that is asymmetric in everything, so that no exchange goes unseen."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from stereocal.rig.camera import Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.geometry import Angles, Pose, stack_rays
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, Scene, observe
from stereocal.system.array_types import FloatArray

PRIMARY = Camera(
    K=np.array([[1480.3, 0.0, 811.4], [0.0, 1502.7, 577.2], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.21, 0.17, 0.0009, -0.0013, -0.06]),
    image_size=(1600, 1200),
)
SECONDARY = Camera(
    K=np.array([[1190.6, 2.3, 612.8], [0.0, 1171.9, 530.1], [0.0, 0.0, 1.0]]),
    distortion=np.array([0.08, -0.11, -0.0007, 0.0016]),
    image_size=(1280, 1024),
)
BASELINE_M = 2.37
BAR_M = 0.87
ANGLES = Angles(yaw=0.24, pitch=-0.07, roll=0.11, delta=0.13, epsilon=3.02)
RIG = Pose.from_angles(ANGLES, BASELINE_M)


def bar_ends(frames: int, seed: int = 7) -> FloatArray:
    """Ends of the bar in the primary's frame, (2 frames, 3): A and B of the first frame, and so on.

    The bar turns freely in the part of space that both cameras see.
    """
    rng = np.random.default_rng(seed)
    middle = rng.uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5], (frames, 3))
    along = rng.normal(size=(frames, 3))
    along *= BAR_M / 2 / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([middle - along, middle + along], axis=1).reshape(-1, 3)


def images(points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Raw pixels of points of the primary's frame in both cameras."""
    return PRIMARY.project(points), SECONDARY.project(RIG.apply(points))


def rays_of(pose: Pose, points: npt.ArrayLike) -> FloatArray:
    """Exact normalised points in both cameras, (4, n)."""
    points = np.asarray(points, dtype=np.float64)
    moved = pose.apply(points)
    return stack_rays(points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:])


def correspondences(
    frames: int, noise_px: float = 0.0, seed: int = 7, known_points: bool = False
) -> Correspondences:
    """The bar in so many frames, numbered from 1, with normal noise on every pixel coordinate."""
    return dataset(frames, noise_px, seed, known_points).correspondences


def dataset(
    frames: int = 20, noise_px: float = 0.0, seed: int = 7, known_points: bool = False
) -> Pair:
    """The rig's data set; exact for `noise_px=0`."""
    points, rng = bar_ends(frames, seed), np.random.default_rng([seed, 1])
    scene = Scene(Rig(PRIMARY, SECONDARY, RIG), points.reshape(-1, 2, 3))
    nominal = Nominal(PRIMARY, SECONDARY, BASELINE_M, BAR_M)
    data = observe(scene, rng, noise_px, "asymmetric rig", nominal)
    if not known_points:
        return data
    return data.changed(correspondences=replace(data.correspondences, known_points_m=points))


ANY_ANGLES = st.builds(
    Angles,
    yaw=st.floats(-3.1, 3.1),
    pitch=st.floats(-1.5, 1.5),
    roll=st.floats(-3.1, 3.1),
    delta=st.floats(-1.5, 1.5),
    epsilon=st.floats(-3.1, 3.1),
)
"""Away from +-pi, where an angle has two names, and from the degenerate pitch and delta."""

SEEDS = st.integers(0, 2**32 - 1)


def random_rig(seed: int, pairs: int) -> tuple[Pose, FloatArray]:
    """A rig, and so many points of the primary's frame that stand well in front of both cameras."""
    rng = np.random.default_rng(seed)
    low, high = [-0.5, -0.4, -3.0, -0.5, -3.1], [0.5, 0.4, 3.0, 0.5, 3.1]
    pose = Pose.from_angles(Angles(*rng.uniform(low, high).tolist()), rng.uniform(0.3, 3.0))
    depth = rng.uniform(4.0, 12.0, (pairs, 1))
    flat = rng.uniform(-0.35, 0.35, (pairs, 2))
    points = np.hstack([flat * depth, depth])
    # Points too near to the secondary, or behind it, are pushed away along their rays.
    while (near := pose.apply(points)[:, 2] < 1.0).any():
        points[near] *= 2.0
    return pose, points
