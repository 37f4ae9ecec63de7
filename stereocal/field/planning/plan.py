"""A plan of a field day: two cameras, their pose, the volume, the bar, and how well all is known.

A plan that exists can work: the numbers are possible, both cameras see a part of the volume in
common, and the bar fits into it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera, LensModel
from stereocal.rig.geometry import Pose
from stereocal.rig.measured_lengths import check_length, check_uncertainty
from stereocal.rig.rig import Rig
from stereocal.rig.window import GLASS, WATER, Window, moved_window, rays_through
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import rounded

FEWEST_FRAMES, MOST_FRAMES = 5, 2000
LARGEST_NOISE_PX = 20.0
LARGEST_TOE_IN_DEG = 80.0
SMALLEST_MM, LARGEST_MM = 0.01, 10_000.0
COLUMNS, ROWS, DEPTHS = 25, 19, 13
"""Grid in which a common view is looked for."""
KEPT_CAMERAS = 64
FOLD_MARGIN = 1.05
"""A ray farther from the axis than this many times the farthest ray of the image is not seen."""


@dataclass(frozen=True)
class SensorLens:
    """A camera without a lens calibration yet: no distortion, principal point in the middle.

    Sizes are (width, height), that of the sensor of the part that the image shows. A fisheye
    without coefficients has as many pixels per radian everywhere.
    """

    focal_mm: float
    sensor_mm: tuple[float, float]
    image_size: tuple[int, int]
    model: LensModel = "brown"

    def __post_init__(self) -> None:
        for what, value in (
            ("focal length", self.focal_mm),
            ("sensor's width", self.sensor_mm[0]),
            ("sensor's height", self.sensor_mm[1]),
        ):
            if not SMALLEST_MM <= value <= LARGEST_MM:
                raise StereocalError(f"The {what} is {value:g} mm: state it in mm, above 0.")
        across, down = (px / mm for px, mm in zip(self.image_size, self.sensor_mm, strict=True))
        if not 0.5 < across / down < 2.0:
            width, height = self.image_size
            raise StereocalError(
                f"A sensor of {self.sensor_mm[0]:g} x {self.sensor_mm[1]:g} mm and an image of "
                f"{width}x{height} px do not belong together: the pixels would not be square. "
                "State both as width and height."
            )
        _ = self.camera  # raises where K or the image size is impossible

    @cached_property
    def camera(self) -> Camera:
        """The camera, with fx and fy from focal length, sensor and pixels."""
        size = np.array(self.image_size, dtype=np.float64)
        fx, fy = self.focal_mm * size / np.array(self.sensor_mm)
        cx, cy = 0.5 * (size - 1.0)
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        none = np.zeros(4 if self.model == "fisheye" else 5)
        return Camera(K, none, self.image_size, model=self.model)


@dataclass(frozen=True)
class AimedPose:
    """The pose of two level cameras that are aimed at one point, the primary on the left.

    Args:
        baseline_m: distance of the two cameras.
        toe_in_deg: angle by which each camera is turned in from parallel; both axes meet at
            baseline / (2 tan(toe-in)) in front of the middle of the baseline.
        height_difference_m: by which the secondary is higher than the primary.
    """

    baseline_m: float
    toe_in_deg: float = 0.0
    height_difference_m: float = 0.0

    def __post_init__(self) -> None:
        check_length("baseline", self.baseline_m)
        if not abs(self.toe_in_deg) <= LARGEST_TOE_IN_DEG:
            raise StereocalError(
                f"The toe-in is {self.toe_in_deg:g} degrees: it must be from "
                f"-{LARGEST_TOE_IN_DEG:g} to {LARGEST_TOE_IN_DEG:g} for each camera."
            )
        if not abs(self.height_difference_m) <= 0.9 * self.baseline_m:
            raise StereocalError(
                f"The height difference is {self.height_difference_m:g} m, but the baseline, the "
                f"distance of the cameras, only {self.baseline_m:g} m."
            )

    @cached_property
    def pose(self) -> Pose:
        """`secondary_from_primary`."""
        primary, secondary = self._world_from_cameras
        return Pose(secondary.T @ primary, -self.baseline_m * secondary.T @ self._along)

    @property
    def world_from_primary(self) -> FloatArray:
        """(3, 3): to the axes of the field, x along the baseline but level, y down, z ahead."""
        return self._world_from_cameras[0]

    @property
    def _along(self) -> FloatArray:
        rise = np.arcsin(self.height_difference_m / self.baseline_m)
        return np.array([np.cos(rise), -np.sin(rise), 0.0])

    @cached_property
    def _world_from_cameras(self) -> list[FloatArray]:
        """(3, 3) each: of level cameras; the world's y axis points down."""
        toe, rotations = np.radians(self.toe_in_deg), []
        for inward in (np.sin(toe), -np.sin(toe)):
            axis = np.array([0.0, 0.0, np.cos(toe)]) + inward * self._along
            z = axis / np.linalg.norm(axis)
            x = np.cross([0.0, 1.0, 0.0], z)
            x /= np.linalg.norm(x)
            rotations.append(np.column_stack([x, np.cross(z, x), z]))
        return rotations


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of what is stated, as it will be when the recording is calibrated.

    Args:
        focal: of each focal length, as a fraction of it.
        centre_px: of each coordinate of a principal point.
        baseline_m, bar_m: of the two measured lengths.
    """

    focal: float = 0.003
    centre_px: float = 5.0
    baseline_m: float = 0.005
    bar_m: float = 0.0005

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise StereocalError(f"The uncertainty {name} is {value}: it must be 0 or more.")
        if self.focal > 0.2:
            raise StereocalError(
                f"The uncertainty of the focal length is {self.focal:g}, a fraction of it: "
                "0.003 stands for 0.3 %, and at most 0.2 makes sense."
            )


@dataclass(frozen=True)
class PlannedWindow:
    """A window that both cameras look through.

    Args:
        distance_m: from the primary camera to the dry face, along the normal.
        normal: towards the medium, in the primary's frame; None: along the mean of both axes.
    """

    distance_m: float
    thickness_m: float = 0.0
    medium: float = WATER
    glass: float = GLASS
    normal: tuple[float, float, float] | None = None

    def before(self, pose: Pose) -> Window:
        """The window as the primary sees it.

        Args:
            pose: `secondary_from_primary`.
        """
        x, y, z = self.normal or (pose.R[2] + np.eye(3)[2]).tolist()
        return Window((x, y, z), self.distance_m, self.thickness_m, self.glass, self.medium)


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan of a field day.

    Args:
        stated_primary, stated_secondary: calibrated cameras, or what the data sheets say.
        stated_pose: `secondary_from_primary`, or baseline, toe-in and height.
        near_m, far_m: depths along the primary's axis, between which will be measured.
        bar_m: distance of the two targets on the bar.
        frames: number of positions of the bar.
        noise_px: standard deviation of an image coordinate of a target.
        needed: relative error that 95 % of lengths have to be within; None if it is not stated.
        window: that both cameras look through; None in air.
    """

    name: str
    stated_primary: Camera | SensorLens
    stated_secondary: Camera | SensorLens
    stated_pose: Pose | AimedPose
    near_m: float
    far_m: float
    bar_m: float
    frames: int = 25
    noise_px: float = 0.2
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    needed: float | None = None
    window: PlannedWindow | None = None

    def __post_init__(self) -> None:
        self._check_numbers()
        largest = float(np.linalg.norm(np.ptp(self.common_points, axis=0)))
        if self.bar_m >= largest:
            raise StereocalError(
                f"The bar of {self.bar_m:g} m is larger than what both cameras see from "
                f"{self.near_m:g} to {self.far_m:g} m (about {rounded(largest)} m): take a shorter "
                "bar, or go farther away."
            )

    @cached_property
    def primary(self) -> Camera:
        camera = _camera(self.stated_primary)
        return camera if self.window is None else replace(camera, window=self._window)

    @cached_property
    def secondary(self) -> Camera:
        camera = _camera(self.stated_secondary)
        if self.window is None:
            return camera
        return replace(camera, window=moved_window(self._window, self.pose))

    @property
    def _window(self) -> Window:
        assert self.window is not None
        return self.window.before(self.pose)

    @property
    def pose(self) -> Pose:
        """`secondary_from_primary`."""
        stated = self.stated_pose
        return stated.pose if isinstance(stated, AimedPose) else stated

    @cached_property
    def rig(self) -> Rig:
        return Rig(self.primary, self.secondary, self.pose)

    @cached_property
    def common_points(self) -> FloatArray:
        """(n, 3): grid points of the volume that both cameras see, in the primary's frame."""
        return common_points(self.rig, np.linspace(self.near_m, self.far_m, DEPTHS))

    @property
    def baseline_m(self) -> float:
        return self.pose.baseline

    def _check_numbers(self) -> None:
        check_length("baseline", self.baseline_m)
        _ = self.pose.angles  # raises where they are undefined
        check_length("bar", self.bar_m)
        near, far = self.near_m, self.far_m
        if not (np.isfinite([near, far]).all() and near > 0):
            raise StereocalError(
                f"The volume reaches from {near:g} to {far:g} m along the primary's axis: a part "
                "of it is at or behind the camera; state near_m and far_m above 0."
            )
        if not near < far:
            raise StereocalError(
                f"The nearest distance (near_m) is {near:g} m, the farthest (far_m) {far:g} m: the "
                "nearest must be the smaller one."
            )
        check_length("volume's far end", far)
        if not FEWEST_FRAMES <= self.frames <= MOST_FRAMES:
            raise StereocalError(
                f"{self.frames} frames are planned: it must be from {FEWEST_FRAMES} to "
                f"{MOST_FRAMES}."
            )
        if not 0 < self.noise_px <= LARGEST_NOISE_PX:
            raise StereocalError(
                f"The noise is {self.noise_px:g} px: it must be above 0 and at most "
                f"{LARGEST_NOISE_PX:g}; 0.2 px is usual for a detected target."
            )
        if self.needed is not None and not 0 < self.needed < 1:
            raise StereocalError(
                f"The length error that is needed is {self.needed:g}, a fraction: it must be above "
                "0 and below 1; 0.01 stands for 1 %."
            )
        check_uncertainty("baseline", self.uncertainty.baseline_m or None, self.baseline_m)
        check_uncertainty("bar", self.uncertainty.bar_m or None, self.bar_m)
        smallest = min(*self.primary.image_size, *self.secondary.image_size)
        if self.uncertainty.centre_px > 0.2 * smallest:
            raise StereocalError(
                f"The uncertainty of the principal point is {self.uncertainty.centre_px:g} px, too "
                f"much for an image of {smallest} px; 5 px is usual."
            )


def _camera(stated: Camera | SensorLens) -> Camera:
    return stated.camera if isinstance(stated, SensorLens) else stated


@lru_cache(KEPT_CAMERAS)
def rays_of_image(camera: Camera) -> FloatArray:
    """(n, 3): rays with z = 1 through a grid of pixels that spans the image."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, COLUMNS), np.linspace(0, height - 1, ROWS))
    rays = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    known = camera.uses(rays)
    if known.mean() < 0.5:
        raise StereocalError(
            "The lens model of a camera cannot be inverted in most of its image: check its focal "
            "length and distortion."
        )
    return np.column_stack([rays, np.ones(len(rays))])[known]


def sees(camera: Camera, points_m: FloatArray, margin_px: float = 0.0) -> BoolArray:
    """(n,): whether points (n, 3) in the camera's frame are in its image.

    Far outside the view a distortion polynomial can fold back and map points into the image; such
    points are farther from the axis than all rays of the image, and do not count.
    """
    points = np.asarray(points_m, dtype=np.float64)
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= margin_px) & (pixels <= np.array(camera.image_size) - 1.0 - margin_px)
    in_image = np.asarray(inside.all(axis=1))
    if camera.distortion.any():
        points = camera.seen_in_air(points)
        most = FOLD_MARGIN**2 * np.square(rays_of_image(camera)[:, :2]).sum(axis=1).max()
        in_image &= np.square(points[:, :2]).sum(axis=1) <= most * points[:, 2] ** 2
    return in_image


def common_points(rig: Rig, depths_m: FloatArray) -> FloatArray:
    """(n, 3): grid points of the primary's view at some depths that the secondary sees too."""
    depths, rays = np.asarray(depths_m)[:, None, None], rays_of_image(rig.primary)
    if rig.primary.window is None:
        points = (depths * rays).reshape(-1, 3)
    else:
        origins, along = rays_through(rig.primary.window, rays)
        away = (depths - origins[:, 2:]) / along[:, 2:]
        points = (origins + away * along)[away[..., 0] > 0.0]  # behind the window
    seen = rig.pose.apply(points)
    near, far = float(depths_m[0]), float(depths_m[-1])
    if not (seen[:, 2] > 0).any():
        raise StereocalError(
            f"The volume from {near:g} to {far:g} m in front of the primary is behind the "
            "secondary camera: check R and T, or the toe-in."
        )
    common = points[sees(rig.secondary, seen)]
    if not len(common):
        raise StereocalError(
            f"The cameras see nothing in common from {near:g} to {far:g} m: turn them towards each "
            "other or bring them closer together, or choose another range."
        )
    return np.asarray(common)
