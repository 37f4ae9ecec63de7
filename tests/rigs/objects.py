"""Simulated recordings of rigid objects, seen by the rig of `known_rig`."""

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.array_types import BoolArray
from tests.rigs import known_rig

WAND = RigidObject(("A", "M", "B"), np.array([[0.0, 0, 0], [0.25, 0, 0], [0.75, 0, 0]]), 2e-4)
BOARD = RigidObject.of_board(BoardPattern(7, 5, 0.1), 2e-4)


def recorded(
    true: RigidObject,
    frames: int = 24,
    noise_px: float = 0.1,
    seed: int = 3,
    stated: RigidObject | None = None,
    seen: BoolArray | None = None,
    bend_px: float = 0.0,
) -> Pair:
    """The object at random places of the rig's volume.

    Args:
        stated: the object as it is said to be; the true one if None.
        seen: (frames, k): which targets both cameras see; all if None.
        bend_px: standard deviation of an error that all points of a placing share.
    """
    rng = np.random.default_rng(seed)
    k = len(true.names)
    middle = rng.uniform([-1.0, -0.8, 6.0], [1.0, 0.7, 10.0], (frames, 3))
    turns = Rotation.random(frames, rng=rng).as_matrix()
    own = true.points - true.points.mean(axis=0)
    points = (np.einsum("fij,kj->fki", turns, own) + middle[:, None]).reshape(-1, 3)
    primary, secondary = (
        pixels + noise_px * rng.normal(size=pixels.shape) for pixels in known_rig.images(points)
    )
    secondary[:, 1] += np.repeat(bend_px * rng.normal(size=frames), k)
    stated = stated or true
    frame, target = np.repeat(np.arange(1, frames + 1), k), list(true.names) * frames
    rows = Correspondences.from_arrays(frame, target, primary, secondary, rigid_object=stated)
    rows = rows if seen is None else rows.where(np.asarray(seen).ravel())
    lengths = known_rig.BASELINE_M, stated.longest_m
    cameras = known_rig.PRIMARY, known_rig.SECONDARY
    known = Recording.of_two("object", *cameras, *lengths, 0.003, stated.sigma_m)
    return known.holding(rows).pair(*CAMERAS)
