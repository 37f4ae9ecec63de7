"""Sound rigs of three cameras and more that are unlike in everything."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.simulation.rigs import (
    IMAGE_SIZE,
    NOISE_PX,
    WAND,
    SimulatedRig,
    looking,
    nominal_of,
    recording_of,
    seen_by,
)
from stereocal.system.array_types import FloatArray

BAR = RigidObject.bar(0.6)
BOARD = RigidObject.of_board(BoardPattern(7, 5, 0.1))


@dataclass(frozen=True)
class Kind:
    """A kind of rig, and how its object is moved."""

    cameras: int
    object: RigidObject
    frames: int
    waved: bool = False
    """Whether frames follow each other."""
    arc_deg: float = 100.0
    seen_by: int | None = None
    """How many neighbouring cameras see a frame; None: all."""


KINDS: Mapping[str, Kind] = {
    "3 cameras": Kind(3, BAR, 120),
    "3 cameras, waved wand": Kind(3, WAND, 150, waved=True),
    "4 cameras": Kind(4, WAND, 100),
    "5 cameras, waved bar": Kind(5, BAR, 150, waved=True),
    "3 cameras, board": Kind(3, BOARD, 30, arc_deg=50.0),
    "9 cameras, few common frames": Kind(9, BAR, 240, arc_deg=240.0, seen_by=3),
}


def sound(kind: str, number: int) -> tuple[SimulatedRig, np.random.Generator]:
    """A rig of a kind with its recording, and more randomness."""
    rng = _draws(kind, number)
    return _recorded(KINDS[kind], rng, np.zeros(KINDS[kind].cameras)), rng


def late(kind: str, number: int, offset: float) -> SimulatedRig:
    """The same rig, whose second camera takes its frames later by a part of a frame."""
    offsets = np.where(np.arange(KINDS[kind].cameras) == 1, offset, 0.0)
    return _recorded(KINDS[kind], _draws(kind, number), offsets)


def _draws(kind: str, number: int) -> np.random.Generator:
    return np.random.default_rng([number, 40, [*KINDS].index(kind)])


def _recorded(it: Kind, rng: np.random.Generator, offsets: FloatArray) -> SimulatedRig:
    names = [f"c{number + 1}" for number in range(it.cameras)]
    world = [_pose(rng, number, it) for number in range(it.cameras)]
    true = {name: _camera(rng) for name in names}
    poses = {name: pose @ world[0].inverse() for name, pose in zip(names, world, strict=True)}
    placed = _waved(it, rng) if it.waved else _random(it, rng)
    times, pixels = np.arange(it.frames, dtype=np.float64), []
    middle = rng.integers(0, it.cameras, it.frames)
    for number, (pose, camera) in enumerate(zip(world, true.values(), strict=True)):
        points = pose.apply(placed(times + offsets[number]).reshape(-1, 3))
        images = seen_by(camera, points, NOISE_PX, rng).reshape(it.frames, -1, 2)
        seen = np.isfinite(images[..., 0])
        seen &= rng.random((it.frames, 1)) < rng.uniform(0.65, 0.95)
        if it.seen_by is not None:
            seen &= (np.abs(middle - number) <= it.seen_by // 2)[:, None]
        if it.object.board is not None:
            seen &= np.all(seen, axis=1, keepdims=True)
        pixels.append(np.where(seen[..., None], images, np.nan))
    recording = recording_of("spoiled", nominal_of(true, rng), it.object, pixels)
    recording = recording.counted_from(dict.fromkeys(names, 1))
    points_m = world[0].apply(placed(times).reshape(-1, 3)).reshape(it.frames, -1, 3)
    return SimulatedRig(recording, true, poses, points_m)


def _camera(rng: np.random.Generator) -> Camera:
    focal = rng.uniform(900, 1500)
    cx, cy = 0.5 * (np.array(IMAGE_SIZE) - 1) + rng.normal(0.0, 25.0, 2)
    K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    k1 = rng.uniform(-0.25, -0.05)
    return Camera(K, np.array([k1, -0.4 * k1, 5e-4, -4e-4]), IMAGE_SIZE)


def _pose(rng: np.random.Generator, number: int, it: Kind) -> Pose:
    """`camera_from_world`, of a camera that looks at about the world's origin, a little rolled."""
    angle = np.radians(it.arc_deg) * (number / (it.cameras - 1) - 0.5) + rng.normal(0.0, 0.05)
    away = 6.0 * rng.uniform(0.8, 1.2)
    centre = np.array([away * np.sin(angle), rng.uniform(-1.5, 0.3), -away * np.cos(angle)])
    level = looking(centre, rng.normal(0.0, 0.2, 3))
    roll = Rotation.from_rotvec([0.0, 0.0, rng.normal(0.0, 0.1)]).as_matrix()
    return Pose(roll, np.zeros(3)) @ level


Placed = Callable[[FloatArray], FloatArray]
"""The targets (f, k, 3) of the object, in the world, at times (f,)."""


def _random(it: Kind, rng: np.random.Generator) -> Placed:
    """At random places, in random directions; a board faces the cameras more or less."""
    middle = rng.uniform([-1.2, -0.9, -1.2], [1.2, 0.9, 1.2], (it.frames, 3))
    turns = Rotation.random(it.frames, rng).as_matrix()
    if it.object.board is not None:
        turns = Rotation.from_euler(
            "xyz", rng.uniform([-0.6, -0.6, -0.5], [0.6, 0.6, 0.5], (it.frames, 3))
        ).as_matrix()
    own = it.object.points - it.object.points.mean(axis=0)
    placed = middle[:, None] + np.einsum("fij,kj->fki", turns, own)
    return lambda times: placed[times.astype(int)]


def _waved(it: Kind, rng: np.random.Generator) -> Placed:
    """Along a smooth path."""
    period, phase = rng.uniform(15.0, 40.0, 7), rng.uniform(0.0, 6.0, 7)
    own = it.object.points[:, 0] - it.object.points[:, 0].mean()

    def placed(times: FloatArray) -> FloatArray:
        wave = np.sin(2 * np.pi * times[:, None] / period / 2 + phase)
        along = np.column_stack([wave[:, 3] + 0.3, wave[:, 4], wave[:, 5] * wave[:, 6]])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        middle = wave[:, :3] * [1.2, 0.9, 1.2]
        return np.asarray(middle[:, None] + own[:, None] * along[:, None])

    return placed
