"""Simulate rigs, positions of the bar, and noisy data sets.

    scene = place_bars(field_rig(4.5), rng, frames=25, length_m=0.9)
    dataset = observe(scene, rng, noise_px=0.15, name="field")

`Scene` is the ground truth, `Nominal` the measured lenses, baseline and bar, which may be wrong.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.geometry import Angles, Pose, homogeneous
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray

Depths = tuple[float, float]
TRUTH_FORMAT = "stereocal-truth/1"
TRUTH = "truth.json"
FIELD_BASELINE_M = 4.5
FIELD_BAR_M = 0.9
FIELD_DEPTHS_M = (8.0, 25.0)
FIELD_FRAMES = 25
FIELD_NOISE_PX = 0.15
FIELD_LENS_ERRORS = ((0.004, (3.2, -2.4)), (0.002, (-2.8, 2.9)))
"""Errors of the nominal lenses as of a usual calibration, for `lens_off_by`: focal lengths 0.4 and
0.2 % too long, principal points 4 px off. The focal lengths alone matter little if both are off by
the same; here, with seed 0, the 2D set's lengths are 2.3 % wrong and the 3D set's 0.12 %."""

CROSSING_M = 12.5
"""Depth at which the optical axes cross: both images then show the same volume from 8 to 25 m."""

MARGIN_PX = 20.0
"""Least distance of a bar's end from the edge of an image: room for noise and a 10 px target."""

MAXIMUM_ROUNDS = 1000
"""Number of draws after which the rig is rejected; a field rig needs 2 or 3."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A rig and the true positions of the bar."""

    rig: Rig
    ends_m: FloatArray
    """(frames, 2, 3): targets A and B of each frame, in the primary camera's frame."""
    late_ends_m: FloatArray | None = None
    """Those of the moments at which the secondary camera sees them; None: the same."""

    def __post_init__(self) -> None:
        ends = np.array(self.ends_m, dtype=np.float64)
        if ends.ndim != 3 or ends.shape[1:] != (2, 3) or not len(ends):
            raise StereocalError(
                f"The ends of the bars must have shape (frames, 2, 3), not {ends.shape}."
            )
        ends.setflags(write=False)
        object.__setattr__(self, "ends_m", ends)

    @property
    def bar_length_m(self) -> float:
        """Distance of the targets A and B, in metres."""
        return float(np.linalg.norm(self.ends_m[0, 1] - self.ends_m[0, 0]))

    @property
    def points_m(self) -> tuple[FloatArray, FloatArray]:
        """The targets A, B of all frames, (2 frames, 3), in the primary's and secondary's frame."""
        late = self.ends_m if self.late_ends_m is None else self.late_ends_m
        return self.ends_m.reshape(-1, 3), self.rig.pose.apply(late.reshape(-1, 3))

    def in_view(self, depths_m: Depths, margin_px: float) -> BoolArray:
        """(frames,): whether both cameras see both ends in the depth range and in their images."""
        near, far = depths_m
        cameras = self.rig.primary, self.rig.secondary
        seen = [
            camera.sees(points, margin_px) & (points[:, 2] >= near) & (points[:, 2] <= far)
            for camera, points in zip(cameras, self.points_m, strict=True)
        ]
        return np.asarray(np.all(seen, axis=0).reshape(-1, 2).all(axis=1))


@dataclass(frozen=True, eq=False)
class Nominal:
    """The nominal rig: lenses and lengths as measured, possibly with errors."""

    primary: Camera
    secondary: Camera
    baseline_m: float
    target_distance_m: float

    @classmethod
    def exact(cls, scene: Scene) -> "Nominal":
        """The nominal rig without errors."""
        rig = scene.rig
        return cls(rig.primary, rig.secondary, rig.pose.baseline, scene.bar_length_m)


def place_bars(
    rig: Rig,
    rng: np.random.Generator,
    frames: int,
    length_m: float,
    depths_m: Depths = FIELD_DEPTHS_M,
    margin_px: float = MARGIN_PX,
) -> Scene:
    """Draw bars at random positions and in random directions, both ends in view of both cameras.

    The centre of a bar is uniform over the primary image and over the depth; its direction is
    uniform over the sphere. Bars that are not completely in view are drawn again.

    Args:
        depths_m: smallest and largest z of both ends, in the frames of both cameras.
        margin_px: least distance of each end from the edge of both images.
    """
    if frames < 1:
        raise StereocalError(f"The number of frames is {frames}: it must be at least 1.")
    bars = np.empty((0, 2, 3))
    for _ in range(MAXIMUM_ROUNDS):
        scene = Scene(rig, _random_bars(rig.primary, rng, 8 * frames, length_m, depths_m))
        bars = np.concatenate([bars, scene.ends_m[scene.in_view(depths_m, margin_px)]])
        if len(bars) >= frames:
            return Scene(rig, bars[:frames])
    raise StereocalError(
        f"The cameras share too little view from {depths_m[0]:g} to {depths_m[1]:g} m for a bar of "
        f"{length_m:g} m: {len(bars)} of {frames} frames found. Turn them towards each other."
    )


def observe(
    scene: Scene,
    rng: np.random.Generator,
    noise_px: float,
    name: str,
    nominal: Nominal | None = None,
    notes: str = "",
) -> Pair:
    """Simulate the data set of a scene: projection with the full lens model, then pixel noise.

    Args:
        noise_px: standard deviation of the Gaussian noise on each coordinate, in pixels.
        nominal: lenses and lengths of the data set; the true ones if None.
    """
    nominal = nominal or Nominal.exact(scene)
    cameras = scene.rig.primary, scene.rig.secondary
    primary, secondary = (
        camera.project(points) + noise_px * rng.standard_normal((len(points), 2))
        for camera, points in zip(cameras, scene.points_m, strict=True)
    )
    frames = len(scene.ends_m)
    rows = Correspondences.from_arrays(
        np.repeat(np.arange(1, frames + 1), 2), "AB" * frames, primary, secondary
    )
    baseline_m, distance_m = nominal.baseline_m, nominal.target_distance_m
    recording = Recording.of_two(
        name, nominal.primary, nominal.secondary, baseline_m, distance_m, notes=notes
    )
    return recording.holding(rows).pair(*CAMERAS)


def lens_off_by(camera: Camera, focal: float, centre_px: tuple[float, float]) -> Camera:
    """The lens with an error of its focal lengths and principal point.

    Args:
        focal: relative error of both focal lengths: 0.003 makes them 0.3 % too long.
        centre_px: shift of the principal point.
    """
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= 1.0 + focal
    K[:2, 2] += centre_px
    return replace(camera, K=K)


def field_rig(baseline_m: float = FIELD_BASELINE_M) -> Rig:
    """Two converging cameras as in the paper (IDT-M5, 50 mm lenses), with different lenses.

    With 7 um pixels, 50 mm are 7143 px. The secondary is on the right, so T points to the left.
    """
    toe = float(np.arctan2(0.5 * baseline_m, CROSSING_M))
    angles = Angles(
        yaw=2.0 * toe - 0.008, pitch=-0.021, roll=0.034, delta=toe - 0.012, epsilon=3.108
    )
    return Rig(
        primary=Camera(
            np.array([[7121.4, 0.0, 1143.7], [0.0, 7126.9, 891.2], [0.0, 0.0, 1.0]]),
            np.array([-0.12, 0.31, 4e-4, -7e-4, -0.2]),
            (2336, 1728),
        ),
        secondary=Camera(
            np.array([[7196.8, 0.0, 1201.5], [0.0, 7190.2, 838.6], [0.0, 0.0, 1.0]]),
            np.array([-0.07, 0.18, -6e-4, 3e-4, 0.1]),
            (2336, 1728),
        ),
        pose=Pose.from_angles(angles, baseline_m),
    )


def simulate_field(seed: int) -> tuple[Scene, Pair]:
    """The sample data set: 25 frames of a 0.9 m bar at 8 to 25 m, noise 0.15 px.

    The lengths are exact, the lenses off by `FIELD_LENS_ERRORS`.
    """
    rng = np.random.default_rng(seed)
    scene = place_bars(field_rig(), rng, FIELD_FRAMES, FIELD_BAR_M)
    lenses = zip((scene.rig.primary, scene.rig.secondary), FIELD_LENS_ERRORS, strict=True)
    wrong = [lens_off_by(lens, *error) for lens, error in lenses]
    primary, secondary = (replace(lens, K=lens.K.round(2)) for lens in wrong)
    nominal = Nominal(primary, secondary, FIELD_BASELINE_M, FIELD_BAR_M)
    notes = f"Synthetic, seed {seed}; the truth is in {TRUTH}."
    return scene, observe(scene, rng, FIELD_NOISE_PX, "field", nominal, notes)


def truth_of(scene: Scene, noise_px: float, seed: int) -> dict[str, Any]:
    """The ground truth of a scene, for JSON."""
    rig, pose, ends = scene.rig, scene.rig.pose, scene.ends_m.tolist()
    return {
        "format": TRUTH_FORMAT,
        "convention": "x_secondary = R @ x_primary + T; metres, radians",
        **pose.to_json(),
        "angles": pose.angles._asdict(),
        "baseline_m": pose.baseline,
        "target_distance_m": scene.bar_length_m,
        "cameras": {"primary": rig.primary.to_json(), "secondary": rig.secondary.to_json()},
        "noise_px": noise_px,
        "seed": seed,
        "frames": [{"frame": i, "A": a, "B": b} for i, (a, b) in enumerate(ends, start=1)],
    }


def _random_bars(
    camera: Camera, rng: np.random.Generator, count: int, length_m: float, depths_m: Depths
) -> FloatArray:
    """Ends (count, 2, 3) of bars whose centres are in the image of `camera`, in its frame."""
    pixels = rng.uniform(0.0, 1.0, (count, 2)) * (np.array(camera.image_size) - 1.0)
    depths = rng.uniform(*depths_m, (count, 1))
    middles = homogeneous(camera.undistort(pixels)) * depths
    along = rng.standard_normal((count, 3))
    half = 0.5 * length_m * along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([middles - half, middles + half], axis=1)
