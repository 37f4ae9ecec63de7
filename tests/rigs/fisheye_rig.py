"""Two cameras with fisheye lenses, and recordings with them whose truth is known."""

from dataclasses import replace

import numpy as np

from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, Scene, observe, place_bars
from stereocal.system.array_types import FloatArray

IMAGE_SIZE = (1920, 1440)
COEFFICIENTS = np.array([0.04, -0.012, 0.006, -0.0018])
NOISE_PX = 0.3


def fisheye(field_of_view_deg: float, turned: float = 1.0) -> Camera:
    """A fisheye with this field of view across the image; `turned`: of the coefficients."""
    k = COEFFICIENTS * turned
    half = np.radians(field_of_view_deg / 2)
    radius = half * (1 + sum(k[i] * half ** (2 * i + 2) for i in range(4)))
    f = 0.5 * IMAGE_SIZE[0] / radius
    K = np.array([[f, 0.0, 953.2], [0.0, 1.003 * f, 728.9], [0.0, 0.0, 1.0]])
    return Camera(K, k, IMAGE_SIZE, model="fisheye")


def fisheye_rig(field_of_view_deg: float) -> Rig:
    """Two cameras 1 m apart that look at a point 3 m away."""
    toe = float(np.arctan2(0.5, 3.0))
    angles = Angles(2 * toe - 0.01, -0.02, 0.03, toe - 0.01, 3.11)
    lenses = fisheye(field_of_view_deg), fisheye(field_of_view_deg, 0.9)
    return Rig(*lenses, Pose.from_angles(angles, 1.0))


def recording(
    field_of_view_deg: float, seed: int, frames: int = 40, exact: bool = False
) -> tuple[Pair, Scene]:
    """A recording of a bar of 0.4 m from 0.7 to 4 m, with lenses off by their standard errors.

    Args:
        exact: with the true lenses and lengths.
    """
    rng = np.random.default_rng(seed)
    scene = within_74_degrees(
        place_bars(fisheye_rig(field_of_view_deg), rng, 2 * frames, 0.4, (0.7, 4.0)), frames
    )
    cameras = [off(camera, rng) for camera in (scene.rig.primary, scene.rig.secondary)]
    baseline, bar = 1.0 + 0.002 * rng.standard_normal(), 0.4 * (1 + 5e-4 * rng.standard_normal())
    nominal = None if exact else Nominal(cameras[0], cameras[1], baseline, bar)
    found = observe(scene, rng, NOISE_PX, f"fisheye {field_of_view_deg:g}", nominal)
    found = found.changed(baseline_sigma_m=0.002, target_distance_sigma_m=0.0002)
    return found, scene


def within_74_degrees(scene: Scene, frames: int) -> Scene:
    """The first frames whose targets noise does not move beyond 75 degrees from an axis."""
    usable = np.ones(len(scene.ends_m), dtype=bool)
    for points in scene.points_m:
        away = np.hypot(points[:, 0], points[:, 1]) < np.tan(np.radians(74.0)) * points[:, 2]
        usable &= away.reshape(-1, 2).all(axis=1)
    return replace(scene, ends_m=scene.ends_m[usable][:frames])


def off(camera: Camera, rng: np.random.Generator) -> Camera:
    """A lens with errors of the size that it states, correlated as those of a calibration.

    The images of points move by 0.15 px in root mean square.
    """
    u, v = np.meshgrid(np.linspace(0, IMAGE_SIZE[0], 40), np.linspace(0, IMAGE_SIZE[1], 30))
    rays = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    rays = rays[np.isfinite(rays).all(axis=1)]
    steps = 1e-4 * np.array([*4 * [1.0], *4 * [1e-2]])
    columns = [
        (_lens(camera, +step).distort(rays) - _lens(camera, -step).distort(rays)).ravel() / 2
        for step in np.diag(steps)
    ]
    J = np.column_stack(columns) / steps
    covariance = 0.15**2 * len(rays) / 8 * np.linalg.inv(J.T @ J)
    sigma = np.sqrt(np.diag(covariance))
    fx, fy, cx, cy = sigma[:4].tolist()
    known = LensUncertainty(fx, fy, cx, cy, sigma[4:], covariance / np.outer(sigma, sigma))
    errors = np.linalg.cholesky(covariance) @ rng.standard_normal(8)
    return replace(_lens(camera, errors), uncertainty=known)


def _lens(camera: Camera, change: FloatArray) -> Camera:
    """A lens with other fx, fy, cx, cy and k1 to k4."""
    K = camera.K + np.array(
        [[change[0], 0.0, change[2]], [0.0, change[1], change[3]], [0.0, 0.0, 0.0]]
    )
    return replace(camera, K=K, distortion=camera.distortion + change[4:])
