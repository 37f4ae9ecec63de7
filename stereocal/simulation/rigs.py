"""Simulated recordings of a wand by three cameras and more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.simulation.simulate import lens_off_by
from stereocal.system.array_types import FloatArray

WAND = RigidObject(("A", "M", "B"), np.array([[0.0, 0, 0], [0.2, 0, 0], [0.6, 0, 0]]))
IMAGE_SIZE = (1280, 1024)
DISTANCE_M = 6.0
NOISE_PX = 0.2
LENS_ERRORS = 0.003, 5.0
"""Standard deviations of the nominal focal lengths, as a fraction, and of the centres, in px."""
NEAR, FAR = 0.6, 0.9
"""Least and greatest share of what a camera could see that it saw."""


@dataclass(frozen=True, eq=False)
class SimulatedRig:
    """A rig, a recording with its nominal lenses, and the truth."""

    recording: Recording
    cameras: dict[str, Camera]
    """The true ones."""
    poses: dict[str, Pose]
    """`camera_from_reference`, true; the first camera is the reference."""
    points_m: FloatArray
    """(frames, targets, 3): true, in the reference's frame."""

    @property
    def settings(self) -> RefineSettings:
        """With the uncertainties of the nominal lenses."""
        return RefineSettings(lenses=dict.fromkeys(self.cameras, LensPrior(*LENS_ERRORS)))


def simulated_rig(
    rng: np.random.Generator,
    cameras: int = 3,
    frames: int = 150,
    neighbours_only: bool = False,
    arc_deg: float = 100.0,
) -> SimulatedRig:
    """Cameras on an arc about the volume where a wand is moved.

    Args:
        arc_deg: of the first and the last camera about the volume: at 180 they face each other.
        neighbours_only: whether each bar is seen by two neighbouring cameras only, as in a chain.
    """
    names = [f"c{number + 1}" for number in range(cameras)]
    world = [_camera_pose(rng, number, cameras, arc_deg) for number in range(cameras)]
    poses = {name: pose @ world[0].inverse() for name, pose in zip(names, world, strict=True)}
    true = {name: _camera(rng) for name in names}
    placed = _placed(rng, frames)
    points = world[0].apply(placed.reshape(-1, 3)).reshape(placed.shape)
    pixels: list[FloatArray] = []
    for number, (name, camera) in enumerate(true.items()):
        images = seen_by(camera, poses[name].apply(points.reshape(-1, 3)), NOISE_PX, rng)
        images = images.reshape(*points.shape[:2], 2)
        seen = rng.random(images.shape[:2]) < rng.uniform(NEAR, FAR)
        if neighbours_only:
            first = np.arange(frames) % (cameras - 1)
            seen &= np.isin(number - first, (0, 1))[:, None]
        pixels.append(np.where(seen[..., None], images, np.nan))
    recording = recording_of("simulated", nominal_of(true, rng), WAND, pixels)
    return SimulatedRig(recording, true, poses, points)


def seen_by(
    camera: Camera, points_m: FloatArray, noise_px: float, rng: np.random.Generator
) -> FloatArray:
    """Pixels (n, 2) with normal noise of points (n, 3) in the camera's frame; NaN outside."""
    pixels = camera.project(points_m) + rng.normal(0.0, noise_px, (len(points_m), 2))
    inside = ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=1)
    return np.where((camera.sees(points_m) & inside)[:, None], pixels, np.nan)


def nominal_of(true: Mapping[str, Camera], rng: np.random.Generator) -> dict[str, Camera]:
    """The lenses as a calibration finds them, off by `LENS_ERRORS`."""
    focal, centre = LENS_ERRORS
    off = {name: rng.normal(0.0, (focal, centre, centre)).tolist() for name in true}
    return {name: lens_off_by(true[name], f, (cx, cy)) for name, (f, cx, cy) in off.items()}


def recording_of(
    name: str, cameras: Mapping[str, Camera], held: RigidObject, pixels: Sequence[FloatArray]
) -> Recording:
    """The recording of what each camera sees in frames from 0.

    Args:
        pixels: of each camera (frames, targets, 2); NaN where it does not see a target.
    """
    images = np.stack(pixels)
    camera, frame, target = seen = np.nonzero(np.isfinite(images[..., 0]))
    unknown = np.full(len(frame), np.nan)
    return Recording(name, cameras, held, frame, camera, target, images[seen], unknown)


def looking(centre: FloatArray, target: FloatArray) -> Pose:
    """`camera_from_world` of a level camera at a place, which looks at another; y points down."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(forward, right), forward])
    return Pose(R, -R @ centre)


def _camera(rng: np.random.Generator) -> Camera:
    focal, centre = rng.uniform(1100, 1300), 0.5 * (np.array(IMAGE_SIZE) - 1)
    cx, cy = centre + rng.normal(0.0, 8.0, 2)
    K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    return Camera(K, np.array([-0.2, 0.08, 0.0, 0.0]), IMAGE_SIZE)


def _camera_pose(rng: np.random.Generator, number: int, cameras: int, arc_deg: float) -> Pose:
    """`camera_from_world`, of a camera that looks at the world's origin."""
    angle = np.radians(arc_deg) * (number / max(cameras - 1, 1) - 0.5) + rng.normal(0.0, 0.05)
    away = DISTANCE_M * rng.uniform(0.9, 1.1)
    centre = np.array([away * np.sin(angle), rng.uniform(-1.0, 0.3), -away * np.cos(angle)])
    return looking(centre, np.zeros(3))


def _placed(rng: np.random.Generator, frames: int) -> FloatArray:
    """(frames, targets, 3): the wand at random places and directions, in the world."""
    middle = rng.uniform([-1.2, -0.9, -1.2], [1.2, 0.9, 1.2], (frames, 3))
    along = rng.normal(size=(frames, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    offsets = WAND.points[:, 0] - WAND.points[:, 0].mean()
    return np.asarray(middle[:, None] + offsets[:, None] * along[:, None])
