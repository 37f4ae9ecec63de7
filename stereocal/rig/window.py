"""A flat window between a camera in air and the medium that it looks into.

A pixel is a ray in the medium: Snell's law twice, in closed form. The image of a point is found by
Newton's method on one number. In the camera's frame, with the unit normal N towards the medium, the
distance D of the dry face, the thickness t and the indices g of the glass and m of the medium, a
point P at the height h = N P - D - t above the wet face and at L = P - (N P) N from the axis is
imaged as a point on the ray A = N + w L in air, where

    w (D + t / s(g) + h / s(m)) = 1,   s(k)^2 = k^2 + (k^2 - 1) w^2 |L|^2.

Its left side grows and is concave in w, so that Newton's steps from 1 / (D + t / g + h / m) come
nearer from one side. Without glass and with m = 1, w is 1 / (N P) and A is P / (N P).
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stereocal.errors import StereocalError, refuse
from stereocal.rig.compiled import compiled, contiguous
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from stereocal.system.records import of_plain

GLASS, WATER = 1.52, 1.333
SMALLEST_INDEX, LARGEST_INDEX = 1.0, 2.5
LARGEST_M = 1000.0
"""Of a window's distance and thickness."""
THICKNESS_M, THICKEST_M = 0.01, 1.0
"""Of a window that a person states: where the thickness is not known yet, and at most."""
MOST_STEPS, ROUNDING = 30, 1e-12
TURNED_AWAY = "a window's normal must point away from its camera, within 85 degrees of its axis."
NOT_BEFORE = "a window's distance must be above 0 m, and its thickness 0 m or more."
LEAST_COSINE = float(np.cos(np.radians(85.0)))


@dataclass(frozen=True)
class Window:
    """A window where a camera sees it, in the camera's frame."""

    normal: tuple[float, float, float]
    """Towards the medium; a unit vector."""
    distance_m: float
    """From the camera's centre to the dry face, along the normal."""
    thickness_m: float = 0.0
    glass: float = GLASS
    medium: float = WATER

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.normal)) if len(self.normal) == 3 else 0.0
        values = [*self.normal, self.distance_m, self.thickness_m, self.glass, self.medium]
        refuse(
            (
                not (np.isfinite(values).all() and length > 0.0),
                "a window has a normal of three numbers, a distance, a thickness and two indices.",
            ),
            (not self.normal[-1] > LEAST_COSINE * length, TURNED_AWAY),
            (
                not (0.0 < self.distance_m < LARGEST_M and 0.0 <= self.thickness_m < LARGEST_M),
                NOT_BEFORE,
            ),
            *(
                (
                    not SMALLEST_INDEX <= index <= LARGEST_INDEX,
                    f"a window's index of refraction is {index:g}: it must be between "
                    f"{SMALLEST_INDEX:g} and {LARGEST_INDEX:g} (water 1.333, glass 1.52).",
                )
                for index in (self.glass, self.medium)
            ),
        )
        if abs(length - 1.0) > ROUNDING:  # else a file that is read and written again changes
            x, y, z = (float(part) / length for part in self.normal)
            object.__setattr__(self, "normal", (x, y, z))

    @property
    def values(self) -> FloatArray:
        """(7,): as the compiled functions take it."""
        return np.array([*self.normal, self.distance_m, self.thickness_m, self.glass, self.medium])

    def to_json(self) -> dict[str, Any]:
        """The entries by name."""
        return {**vars(self), "normal": list(self.normal)}

    @classmethod
    def from_json(cls, data: Any) -> "Window":
        """The inverse of `to_json`."""
        try:
            return of_plain(data, cls)
        except ValueError as error:
            raise StereocalError(
                "a window must have a normal [x, y, z], distance_m, thickness_m, glass and medium."
            ) from error


@dataclass(frozen=True)
class StatedWindow:
    """What is measured of a window that one or several cameras look through."""

    cameras: tuple[str, ...]
    thickness_m: float = 0.0
    glass: float = GLASS
    medium: float = WATER
    distance_m: float | None = None
    """From the first of its cameras; None: to be found."""
    normal: tuple[float, float, float] | None = None
    """In the frame of the first of its cameras; None: to be found."""
    distance_sigma_m: float | None = None
    normal_sigma_deg: float | None = None
    medium_sigma: float = 0.0
    """Standard error of the index of the medium; 0 holds it."""
    glass_sigma: float = 0.0

    def __post_init__(self) -> None:
        sigmas = self.distance_sigma_m, self.normal_sigma_deg, self.medium_sigma, self.glass_sigma
        refuse(
            (not self.cameras, "a window must name its cameras."),
            (
                not all(sigma is None or 0.0 <= sigma < np.inf for sigma in sigmas),
                "a standard error of a window must be 0 or more.",
            ),
        )
        away, thick = self.distance_m, self.thickness_m
        seen = self.at(self.normal or (0.0, 0.0, 1.0), 1.0 if away is None else away)
        refuse(
            (
                thick > THICKEST_M,
                f"a window's thickness is {thick:g} m: it must be in metres, and at most "
                f"{THICKEST_M:g} m.",
            ),
            (
                away is None and self.distance_sigma_m is not None,
                "a window has a distance_sigma_m, but no distance_m: state both, or neither.",
            ),
            (
                self.normal is None and self.normal_sigma_deg is not None,
                "a window has a normal_sigma_deg, but no normal: state both, or neither.",
            ),
        )
        if self.normal is not None and abs(np.linalg.norm(self.normal) - 1.0) > ROUNDING:
            object.__setattr__(self, "normal", seen.normal)

    def at(self, normal: tuple[float, float, float], distance_m: float) -> Window:
        """The window where its first camera sees it."""
        return Window(normal, distance_m, self.thickness_m, self.glass, self.medium)

    def of_some(self, names: Collection[str]) -> "StatedWindow":
        """The window of those of its cameras that are among some.

        What is stated from its first camera is not known without that one.
        """
        kept = tuple(name for name in self.cameras if name in names)
        if self.cameras[0] in names:
            return replace(self, cameras=kept)
        return StatedWindow(
            kept,
            self.thickness_m,
            self.glass,
            self.medium,
            medium_sigma=self.medium_sigma,
            glass_sigma=self.glass_sigma,
        )

    def to_json(self) -> dict[str, Any]:
        """The entries of `dataset.json` that are not as usual."""
        usual = StatedWindow(self.cameras)
        known = {name: value for name, value in vars(self).items() if value != getattr(usual, name)}
        return {"cameras": list(self.cameras), **known}


def windows_of_some(
    windows: Iterable[StatedWindow], names: Collection[str]
) -> tuple[StatedWindow, ...]:
    """The windows of some cameras."""
    return tuple(it.of_some(names) for it in windows if {*it.cameras} & {*names})


def check_windows(
    windows: Sequence[StatedWindow], cameras: Sequence[str] | Mapping[str, Any]
) -> None:
    """Check that windows name cameras that there are, each once, in their order.

    Raises:
        StereocalError: which one is wrong.
    """
    order, seen = [*cameras], list[str]()
    for window in windows:
        for name in window.cameras:
            refuse(
                (name not in order, f'a window names "{name[:40]}": there are {", ".join(order)}.'),
                (name in seen, f"two windows name the camera {name}."),
            )
            seen.append(name)
        refuse(
            (
                [*window.cameras] != sorted(window.cameras, key=order.index),
                "a window names its cameras in another order than the data set.",
            )
        )


def moved_window(window: Window, other_from_this: Pose) -> Window:
    """A window as another camera sees it."""
    normal = other_from_this.R @ np.array(window.normal)
    x, y, z = normal.tolist()
    away = window.distance_m + float(normal @ other_from_this.T)
    return replace(window, normal=(x, y, z), distance_m=away)


def rays_through(window: Window, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Origins (n, 3) on the wet face, and unit directions (n, 3) in the medium, of rays from the
    camera with directions (n, 3) of any length; NaN where they do not reach the window."""
    rays = np.empty((2, len(directions), 3))
    _fill_rays(window.values, contiguous(np.asarray(directions, dtype=np.float64)), rays)
    return rays[0], rays[1]


def seen_through(window: Window, points: FloatArray) -> FloatArray:
    """(n, 3): the directions in air in which points (n, 3) in the medium are seen, of any length;
    NaN for points that are not behind the window."""
    directions = np.empty((len(points), 3))
    _fill_directions(window.values, contiguous(np.asarray(points, dtype=np.float64)), directions)
    return directions


@compiled
def ray_through(
    values: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float]:
    """Origin and unit direction in the medium of a ray in air; NaN if it misses the window."""
    nx, ny, nz, distance, thickness = values[0], values[1], values[2], values[3], values[4]
    glass, medium = values[5], values[6]
    norm = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / norm, y / norm, z / norm
    cosine = x * nx + y * ny + z * nz
    if not cosine > 0.0:
        return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan
    ax, ay, az = x - cosine * nx, y - cosine * ny, z - cosine * nz
    sine2 = ax * ax + ay * ay + az * az
    in_glass = thickness / np.sqrt(glass * glass - sine2)
    along = distance + thickness
    out = distance / cosine + in_glass
    rest = np.sqrt(1.0 - sine2 / (medium * medium))
    return (
        out * ax + along * nx,
        out * ay + along * ny,
        out * az + along * nz,
        ax / medium + rest * nx,
        ay / medium + rest * ny,
        az / medium + rest * nz,
    )


@compiled
def _fill_rays(values: FloatArray, directions: FloatArray, rays: FloatArray) -> None:
    for k in range(len(directions)):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        ray = ray_through(values, x, y, z)
        for i in range(3):
            rays[0, k, i], rays[1, k, i] = ray[i], ray[3 + i]


@compiled
def air_factor(values: FloatArray, height: float, square: float) -> float:
    """The w of the module of a point at a height above the wet face, |L|^2 from the axis."""
    distance, thickness, glass, medium = values[3], values[4], values[5], values[6]
    of_glass, of_medium = glass * glass, medium * medium
    w: float = 1.0 / (distance + thickness / glass + height / medium)
    for _ in range(MOST_STEPS):
        q = w * w * square
        in_glass = 1.0 / np.sqrt(of_glass + (of_glass - 1.0) * q)
        in_medium = 1.0 / np.sqrt(of_medium + (of_medium - 1.0) * q)
        glass_part, medium_part = thickness * in_glass, height * in_medium
        off = w * (distance + glass_part + medium_part) - 1.0
        # d (w / s(k)) / dw = k^2 / s(k)^3
        slope = (
            distance
            + glass_part * of_glass * in_glass * in_glass
            + medium_part * of_medium * in_medium * in_medium
        )
        w -= off / slope
        if abs(off) < 1e-14:
            break
    return w


@compiled
def _fill_directions(values: FloatArray, points: FloatArray, directions: FloatArray) -> None:
    nx, ny, nz, distance, thickness = values[0], values[1], values[2], values[3], values[4]
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        along = x * nx + y * ny + z * nz
        height = along - distance - thickness
        if not height > 0.0:
            directions[k, 0] = directions[k, 1] = directions[k, 2] = np.nan
            continue
        lx, ly, lz = x - along * nx, y - along * ny, z - along * nz
        w = air_factor(values, height, lx * lx + ly * ly + lz * lz)
        directions[k, 0], directions[k, 1] = nx + w * lx, ny + w * ly
        directions[k, 2] = nz + w * lz


@compiled
def fill_refracted(values: FloatArray, x: float, y: float, z: float, into: FloatArray) -> bool:
    """Write where a point (x, y, z) in the medium is seen, and what its derivatives need.

    With F the left side of the equation of `w` minus 1 and a = w^2 |L|^2, `dw = -(F_h dh + F_q dq +
    ...) / F_w` gives the derivatives of A = N + w L, see `by_refraction`.

    Args:
        into: (14,): A (3), L (3), w, N P, and -1 / F_w times the derivatives of F by h, |L|^2, D
            (and so by t), g and m; one is free.

    Returns:
        False for a point that is not behind the window.
    """
    nx, ny, nz, distance, thickness = values[0], values[1], values[2], values[3], values[4]
    glass, medium = values[5], values[6]
    along = x * nx + y * ny + z * nz
    height = along - distance - thickness
    if not (height > 0.0 and distance > 0.0):
        return False
    lx, ly, lz = x - along * nx, y - along * ny, z - along * nz
    square = lx * lx + ly * ly + lz * lz
    w = air_factor(values, height, square)
    q, of_glass, of_medium = w * w * square, glass * glass, medium * medium
    in_glass = 1.0 / np.sqrt(of_glass + (of_glass - 1.0) * q)
    in_medium = 1.0 / np.sqrt(of_medium + (of_medium - 1.0) * q)
    glass3, medium3 = thickness * in_glass**3, height * in_medium**3
    slope = distance + glass3 * of_glass + medium3 * of_medium
    into[0], into[1], into[2] = nx + w * lx, ny + w * ly, nz + w * lz
    into[3], into[4], into[5], into[6], into[7] = lx, ly, lz, w, along
    into[8] = -w * in_medium / slope
    into[9] = 0.5 * w**3 * (glass3 * (of_glass - 1.0) + medium3 * (of_medium - 1.0)) / slope
    into[10] = -w / slope
    into[11] = w * glass * (1.0 + q) * glass3 / slope
    into[12] = w * medium * (1.0 + q) * medium3 / slope
    return True
