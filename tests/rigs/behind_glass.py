"""Cameras in air, a bar in water: simulated recordings whose truth is known."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.window import GLASS, WATER, StatedWindow, Window, moved_window
from stereocal.simulation.rigs import looking, recording_of, seen_by
from stereocal.simulation.simulate import lens_off_by
from stereocal.system.array_types import FloatArray

SIZE = (1280, 1024)
LENS_ERRORS = 0.0005, 0.5
"""Of focal lengths, a fraction, and centres, px: as a good calibration in air has them."""
MARGIN_PX = 10.0


@dataclass(frozen=True)
class Tank:
    """A wall and cameras before it, which look at one place behind it."""

    wall_m: float = 0.4
    """From the cameras to the dry face."""
    turned_deg: float = 20.0
    """Of the outermost cameras, from the normal of the wall."""
    thickness_m: float = 0.01
    glass: float = GLASS
    medium: float = WATER
    tilt_deg: float = 0.0
    """Of the wall, about the horizontal, against the plane of the cameras."""
    cameras: int = 2
    each: bool = False
    """Whether each camera is in a housing of its own, with a port at `wall_m`."""
    near_m: float = 0.15
    far_m: float = 0.65
    """Depths of the bars behind the wall."""
    bar_m: float = 0.1
    noise_px: float = 0.2


@dataclass(frozen=True, eq=False)
class Submerged:
    """A recording through a window, and the truth."""

    tank: Tank
    recording: Recording
    """Without what is known of its window."""
    cameras: dict[str, Camera]
    """The true ones, with their windows."""
    poses: dict[str, Pose]
    """`camera_from_reference`."""
    ends_m: FloatArray
    """(frames, 2, 3): in the reference's frame."""
    world: dict[str, Pose]
    """`camera_from_world`: the wall's dry face is at z = 0."""
    settings: RefineSettings = field(default_factory=RefineSettings)

    @property
    def true_poses(self) -> list[Pose]:
        return list(self.poses.values())

    def asked(self, **stated: object) -> Recording:
        """The recording with its window stated, with other entries than the true ones."""
        names = tuple(self.cameras)
        groups = [(name,) for name in names] if self.tank.each else [names]
        known = {
            "thickness_m": self.tank.thickness_m,
            "glass": self.tank.glass,
            "medium": self.tank.medium,
            **stated,
        }
        windows = tuple(StatedWindow(group, **known) for group in groups)  # type: ignore[arg-type]
        return replace(self.recording, windows=windows)


def submerged(tank: Tank, rng: np.random.Generator, bars: int = 80) -> Submerged:
    """Draw cameras and bars, and what the cameras see of them."""
    middle = 0.5 * (tank.near_m + tank.far_m)
    names = [f"c{number + 1}" for number in range(tank.cameras)]
    wall = Window((0.0, 0.0, 1.0), 1.0, tank.thickness_m, tank.glass, tank.medium)
    tilted = Rotation.from_euler("x", tank.tilt_deg, degrees=True).as_matrix()
    cameras, world = dict[str, Camera](), dict[str, Pose]()
    for name, part in zip(names, np.linspace(-1.0, 1.0, tank.cameras), strict=True):
        angle = np.radians(part * tank.turned_deg)
        in_water = np.arcsin(np.sin(angle) / tank.medium)
        away = tank.wall_m * np.tan(angle) + middle * np.tan(in_water)
        side = away if tank.turned_deg >= 5.0 else part * 0.15
        centre = np.array([side, rng.normal(0.0, 0.02), -tank.wall_m * rng.uniform(0.95, 1.05)])
        look = np.array([np.sin(-angle), 0.0, np.cos(angle)])
        if tank.each:  # in the water itself: rays bend at its port only
            centre[2] = -0.3
            look = np.array([0.0, 0.0, middle]) - centre
        pose = looking(centre, centre + look)
        jitter = Rotation.from_rotvec(rng.normal(0.0, 0.02, 3)).as_matrix()
        pose = Pose(jitter @ pose.R, jitter @ pose.T)
        window = moved_window(replace(wall, distance_m=0.0 + 1e-9), _tilted(pose, tilted))
        if tank.each:
            turn = rng.normal(0.0, 0.05, 2).tolist()
            window = replace(wall, normal=(*turn, 1.0), distance_m=tank.wall_m)
        focal = 900.0 * rng.uniform(0.95, 1.1) * (1.0 + tank.wall_m)
        cx, cy = 0.5 * (np.array(SIZE) - 1.0) + rng.normal(0.0, 8.0, 2)
        K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
        cameras[name] = Camera(K, np.array([-0.1, 0.05, 0.0, 0.0]), SIZE, window=window)
        world[name] = pose
    ends, recording = _recorded(tank, cameras, world, None, rng, bars)
    reference = world[names[0]]
    if tank.cameras == 2:
        baseline = (world[names[1]] @ reference.inverse()).baseline
        stated = baseline + rng.normal(0.0, 0.002)
        recording = replace(
            recording, baselines_m={(names[0], names[1]): stated}, baseline_sigma_m=0.002
        )
    poses = {name: pose @ reference.inverse() for name, pose in world.items()}
    return Submerged(tank, recording, cameras, poses, ends, world)


def further(scene: Submerged, rng: np.random.Generator, bars: int = 30) -> Submerged:
    """Further bars of the same cameras, and what they see of them; they may have been moved."""
    stated = scene.recording
    ends, new = _recorded(scene.tank, scene.cameras, scene.world, dict(stated.cameras), rng, bars)
    known = replace(new, baselines_m=stated.baselines_m, baseline_sigma_m=stated.baseline_sigma_m)
    return replace(scene, recording=known, ends_m=ends)


def _recorded(
    tank: Tank,
    cameras: dict[str, Camera],
    world: dict[str, Pose],
    nominal: dict[str, Camera] | None,
    rng: np.random.Generator,
    bars: int,
) -> tuple[FloatArray, Recording]:
    """The ends of bars in the reference's frame, and their recording; lenses that are not given are
    drawn."""
    ends = _bars(tank, cameras, world, rng, bars)
    flat = ends.reshape(-1, 3)
    pixels = [
        seen_by(camera, world[name].apply(flat), tank.noise_px, rng).reshape(-1, 2, 2)
        for name, camera in cameras.items()
    ]
    lenses = _nominal(cameras, rng) if nominal is None else nominal
    recording = recording_of("tank", lenses, RigidObject.bar(tank.bar_m, 2e-5), pixels)
    reference = next(iter(world.values()))
    return reference.apply(flat).reshape(ends.shape), recording


def _tilted(pose: Pose, tilted: FloatArray) -> Pose:
    """`camera_from_wall`, where the wall is tilted about the world's origin."""
    return Pose(pose.R @ tilted, pose.T)


def _bars(
    tank: Tank,
    cameras: dict[str, Camera],
    world: dict[str, Pose],
    rng: np.random.Generator,
    bars: int,
) -> FloatArray:
    """(bars, 2, 3): in the world, each in the view of two cameras at least."""
    found = np.empty((0, 2, 3))
    while len(found) < bars:
        middle = rng.uniform([-0.4, -0.3, tank.near_m], [0.4, 0.3, tank.far_m], (4 * bars, 3))
        along = rng.normal(size=middle.shape)
        along *= 0.5 * tank.bar_m / np.linalg.norm(along, axis=1, keepdims=True)
        ends = np.stack([middle - along, middle + along], axis=1)
        flat = ends.reshape(-1, 3)
        seen = [
            camera.sees(world[name].apply(flat), MARGIN_PX).reshape(-1, 2).all(axis=1)
            for name, camera in cameras.items()
        ]
        inside = (ends[..., 2] > tank.thickness_m + 0.02).all(axis=1)
        found = np.concatenate([found, ends[inside & (np.sum(seen, axis=0) >= 2)]])
    return found[:bars]


def _nominal(true: dict[str, Camera], rng: np.random.Generator) -> dict[str, Camera]:
    """The lenses as calibrated in air, with their standard errors, and no window."""
    focal, centre = LENS_ERRORS
    nominal = {}
    for name, camera in true.items():
        f, cx, cy = rng.normal(0.0, (focal, centre, centre)).tolist()
        lens = lens_off_by(replace(camera, window=None), f, (cx, cy))
        sigma = focal * lens.K[0, 0]
        known = LensUncertainty(sigma, sigma, centre, centre, np.zeros(4))
        nominal[name] = replace(lens, uncertainty=known)
    return nominal


FREE_LENS = LensPrior(0.05, 50.0, distortion=(0.5, 1.0, 0.02, 0.02))
