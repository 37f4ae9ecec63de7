"""The conventions of stereocal: poses, the five angles, residuals, triangulation.

- Camera axes as in OpenCV: x right, y down, z forward. Metres, radians.
- A pose named `b_from_a` maps coordinates: `x_b = R @ x_a + T`; names cancel when composed.
  The rig's pose is `secondary_from_primary`; its `|T|` is the baseline.
- Rays are normalised image points `(x, y)` on the plane z = 1 of their camera, undistorted.
  The compiled functions take the rays of n pairs as one array of shape (4, n), whose rows are
  x_primary, y_primary, x_secondary, y_secondary.
- `E = [t]x R` with `|t| = 1`; the residual of a pair is `q_secondary^T E q_primary`.
- `R = Ry(yaw) Rx(pitch) Rz(roll)`, `t = (cos d cos e, cos d sin e, sin d)`
  (paper, Section 3.1: alpha, beta, gamma, delta, epsilon).
- A reconstructed point is the midpoint of the shortest segment between the two rays (the paper's
  Q^R, Section 2.3). Parallel rays and points behind a camera give NaN, never 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.rig.compiled import compiled, contiguous, inlined
from stereocal.rig.fisheye import imaged_shift
from stereocal.system.array_types import FloatArray

EXACT_ROTATION = 1e-6
"""Largest entry of R R^T - I up to which R is kept as it is."""
ROTATION_TOLERANCE = 1e-4
"""The same up to which the nearest rotation is taken without a message: the product of two matrices
printed with five decimals has 2.8e-5 at most, with six 3e-6, with four 3e-4 (3000 random ones)."""
NEAREST_TOLERANCE = 5e-3
"""The same up to which `Pose.nearest` takes it: with three decimals 3e-3 at most, with two 3e-2."""
FARTHEST_M = 1e12
PARALLEL_SINE_SQUARED = 1e-14
"""Rays within 1e-7 rad of parallel are not triangulated: rounding dominates their depth."""


class Angles(NamedTuple):
    """The five angles of a rig, in radians (paper: alpha, beta, gamma, delta, epsilon)."""

    yaw: float
    pitch: float
    roll: float
    delta: float
    epsilon: float


@dataclass(frozen=True, eq=False)
class Pose:
    """`b_from_a`: `x_b = R @ x_a + T`. R is a (3, 3) rotation, T has shape (3,), in metres."""

    R: FloatArray
    T: FloatArray
    rounding: float = field(default=0.0, kw_only=True)
    """Largest entry of R R^T - I of the matrix that R is the nearest rotation to."""

    def __post_init__(self) -> None:
        R = np.array(self.R, dtype=np.float64)
        T = np.array(self.T, dtype=np.float64)
        if R.shape != (3, 3) or T.shape != (3,):
            raise StereocalError(
                f"A pose needs R of shape (3, 3) and T of shape (3,); got {R.shape} and {T.shape}."
            )
        if not (np.isfinite(R).all() and np.isfinite(T).all()):
            raise StereocalError("A pose has a number that is not finite (NaN or infinite).")
        if np.abs(T).max() > FARTHEST_M:
            raise StereocalError(
                f"A pose with a translation of {np.abs(T).max():g} m is impossible; "
                "T must be in metres."
            )
        error = rotation_error(R)
        if error > ROTATION_TOLERANCE:
            few = f" They are to {error:.1g}: write R with five decimals or more."
            raise StereocalError(
                "R is not a rotation: its rows must be orthonormal, with det +1."
                + few * (error <= NEAREST_TOLERANCE)
            )
        if error > EXACT_ROTATION:
            R = nearest_rotation(R)
        R.setflags(write=False)
        T.setflags(write=False)
        object.__setattr__(self, "R", R)
        object.__setattr__(self, "T", T)

    @classmethod
    def from_angles(cls, angles: Angles, baseline: float) -> "Pose":
        """The pose with these five angles and `|T| = baseline` in metres."""
        R, T = np.empty((3, 3)), np.empty(3)
        fill_pose(np.array(angles, dtype=np.float64), baseline, R, T)
        return cls(R, T)

    @classmethod
    def nearest(cls, R: FloatArray, T: FloatArray) -> "Pose":
        """The pose with the rotation nearest to a matrix that was printed with few decimals.

        Its `rounding` says how far the matrix was from a rotation.
        """
        error = rotation_error(np.asarray(R, dtype=np.float64))
        if not EXACT_ROTATION < error <= NEAREST_TOLERANCE:
            return cls(R, T)
        return cls(nearest_rotation(R), T, rounding=error)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Pose":
        """The inverse of `to_json`."""
        return cls(data["R"], data["T"])

    def to_json(self) -> dict[str, Any]:
        """R and T; not `rounding`."""
        return {"R": self.R.tolist(), "T": self.T.tolist()}

    @property
    def baseline(self) -> float:
        """Distance between the two origins, in metres."""
        return float(np.linalg.norm(self.T))

    @property
    def angles(self) -> Angles:
        """The five angles, in radians."""
        R, T = self.R, self.T
        if is_degenerate(R, T):
            raise StereocalError(
                "The rig cannot be described by the five angles: one camera is straight ahead of "
                "the other, or is pitched by 90 degrees. Move one camera aside."
            )
        return Angles(*angles_of(R, T))

    def __matmul__(self, other: "Pose") -> "Pose":
        """`c_from_b @ b_from_a` is `c_from_a`."""
        rounding = max(self.rounding, other.rounding)
        return Pose(self.R @ other.R, self.R @ other.T + self.T, rounding=rounding)

    def inverse(self) -> "Pose":
        """`a_from_b` of `b_from_a`."""
        return Pose(self.R.T, -self.R.T @ self.T, rounding=self.rounding)

    def apply(self, points: npt.ArrayLike) -> FloatArray:
        """Points of shape (n, 3) or (3,) in frame a, expressed in frame b."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) @ self.R.T + self.T
        return moved

    @property
    def essential(self) -> FloatArray:
        """`E = [t]x R` with `|t| = 1`, shape (3, 3) (paper, eq. 4)."""
        E = np.empty((3, 3))
        fill_essential(contiguous(self.R), contiguous(self.T), E)
        return E


def rotation_error(R: FloatArray) -> float:
    """Largest entry of R R^T - I; infinite if det R is below 0 or the shape is wrong."""
    # Entries are checked first, because their squares may overflow.
    if R.shape != (3, 3) or not np.abs(R).max() < 2 or np.linalg.det(R) < 0:
        return np.inf
    return float(np.abs(R @ R.T - np.eye(3)).max())


def nearest_rotation(R: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix, by the sum of squares of their difference."""
    U, _, V = np.linalg.svd(R)
    return np.asarray(U @ V, dtype=np.float64)


AT_ORIGIN = Pose(np.eye(3), np.zeros(3))


@compiled
def fill_pose(angles: FloatArray, baseline: float, R: FloatArray, T: FloatArray) -> None:
    """Write `R = Ry Rx Rz` and `T = baseline t` of the five angles (paper, Section 3.2, Step 4)."""
    cy, sy = np.cos(angles[0]), np.sin(angles[0])
    cx, sx = np.cos(angles[1]), np.sin(angles[1])
    cz, sz = np.cos(angles[2]), np.sin(angles[2])
    R[0, 0], R[0, 1], R[0, 2] = cy * cz + sy * sx * sz, -cy * sz + sy * sx * cz, sy * cx
    R[1, 0], R[1, 1], R[1, 2] = cx * sz, cx * cz, -sx
    R[2, 0], R[2, 1], R[2, 2] = -sy * cz + cy * sx * sz, sy * sz + cy * sx * cz, cy * cx
    cos_delta = np.cos(angles[3])
    T[0] = baseline * cos_delta * np.cos(angles[4])
    T[1] = baseline * cos_delta * np.sin(angles[4])
    T[2] = baseline * np.sin(angles[3])


def is_degenerate(R: FloatArray, T: FloatArray) -> bool:
    """Whether the five angles are undefined: a pitch of +-90 degrees, or T along z."""
    cos_pitch, in_plane = np.hypot(R[1, 0], R[1, 1]), np.hypot(T[0], T[1])
    return bool(cos_pitch < 1e-9 or in_plane <= 1e-9 * np.hypot(in_plane, T[2]))


def angles_of(R: FloatArray, T: FloatArray) -> tuple[float, float, float, float, float]:
    """The five angles of a pose: the inverse of `fill_pose`."""
    return (
        np.arctan2(R[0, 2], R[2, 2]),
        np.arctan2(-R[1, 2], np.hypot(R[1, 0], R[1, 1])),
        np.arctan2(R[1, 0], R[1, 1]),
        np.arctan2(T[2], np.hypot(T[0], T[1])),
        np.arctan2(T[1], T[0]),
    )


@compiled
def fill_essential(R: FloatArray, T: FloatArray, E: FloatArray) -> None:
    """Write `E = [t]x R`, t = T / |T| (paper, eq. 4)."""
    length = np.sqrt(T[0] * T[0] + T[1] * T[1] + T[2] * T[2])
    x, y, z = T[0] / length, T[1] / length, T[2] / length
    for j in range(3):
        E[0, j] = y * R[2, j] - z * R[1, j]
        E[1, j] = z * R[0, j] - x * R[2, j]
        E[2, j] = x * R[1, j] - y * R[0, j]


@inlined
def midpoint(
    R: FloatArray, T: FloatArray, xp: float, yp: float, xs: float, ys: float
) -> tuple[float, float, float, float, float, float]:
    """Midpoint of the shortest segment between two rays, in both camera frames (paper's Q^R).

    Returns (X, Y, Z) in the primary frame, then in the secondary frame; all NaN where the rays are
    parallel or the point is behind a camera.

    In the secondary frame, the primary's ray is `T + s d` with `d = R p`, the secondary's is `r q`.
    Setting the derivatives of `|T + s d - r q|^2` to zero gives s and r.
    """
    dx = R[0, 0] * xp + R[0, 1] * yp + R[0, 2]
    dy = R[1, 0] * xp + R[1, 1] * yp + R[1, 2]
    dz = R[2, 0] * xp + R[2, 1] * yp + R[2, 2]
    pp = xp * xp + yp * yp + 1.0
    qq = xs * xs + ys * ys + 1.0
    pq = dx * xs + dy * ys + dz
    pt = dx * T[0] + dy * T[1] + dz * T[2]
    qt = xs * T[0] + ys * T[1] + T[2]
    sine_squared = pp * qq - pq * pq
    scale = 1.0 / sine_squared
    s = (pq * qt - qq * pt) * scale
    r = (pp * qt - pq * pt) * scale
    # The midpoint of r q on the secondary's ray and T + s d on the primary's.
    x2 = 0.5 * (T[0] + s * dx + r * xs)
    y2 = 0.5 * (T[1] + s * dy + r * ys)
    z2 = 0.5 * (T[2] + s * dz + r)
    ux, uy, uz = x2 - T[0], y2 - T[1], z2 - T[2]
    z1 = R[0, 2] * ux + R[1, 2] * uy + R[2, 2] * uz
    # A factor instead of an early return: a branch would prevent vectorisation of the loops over
    # points (measured: 72 ns per pair with it).
    usable = (sine_squared > PARALLEL_SINE_SQUARED * pp * qq) & (z1 > 0.0) & (z2 > 0.0)
    keep = 1.0 if usable else np.nan
    x1 = (R[0, 0] * ux + R[1, 0] * uy + R[2, 0] * uz) * keep
    y1 = (R[0, 1] * ux + R[1, 1] * uy + R[2, 1] * uz) * keep
    z1 *= keep
    x2 *= keep
    y2 *= keep
    z2 *= keep
    return x1, y1, z1, x2, y2, z2


@inlined
def bar_length(R: FloatArray, T: FloatArray, rays: FloatArray, a: int, b: int) -> float:
    """Distance between the midpoints of pairs a and b of `rays` (4, n); NaN if one has none."""
    ax, ay, az, _, _, _ = midpoint(R, T, rays[0, a], rays[1, a], rays[2, a], rays[3, a])
    bx, by, bz, _, _, _ = midpoint(R, T, rays[0, b], rays[1, b], rays[2, b], rays[3, b])
    length: float = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2)
    return length


def triangulate_rays(R: FloatArray, T: FloatArray, rays: FloatArray) -> FloatArray:
    """Midpoints of n pairs in the primary frame, (n, 3) in metres; NaN as in `midpoint`."""
    points = np.empty((rays.shape[1], 3))
    _fill_points(contiguous(R), contiguous(T), contiguous(rays), points)
    return points


@compiled
def _fill_points(R: FloatArray, T: FloatArray, rays: FloatArray, points: FloatArray) -> None:
    for k in range(rays.shape[1]):
        x, y, z, _, _, _ = midpoint(R, T, rays[0, k], rays[1, k], rays[2, k], rays[3, k])
        points[k, 0], points[k, 1], points[k, 2] = x, y, z


@inlined
def reprojection_shift(
    R: FloatArray,
    T: FloatArray,
    xp: float,
    yp: float,
    xs: float,
    ys: float,
    pixel_scale: FloatArray,
) -> tuple[float, float, float]:
    """Reprojection errors E2D(1), E2D(2) of one pair in pixels (paper, eq. 6), and the depth.

    The depth is that of the midpoint, Z in the primary frame. `pixel_scale` has a row
    (fx, skew, fy) for each camera: the part of K that acts on differences. With a fisheye it has
    three dimensions (`camera.pixel_scales`): errors are differences in the recorded image.
    """
    x1, y1, z1, x2, y2, z2 = midpoint(R, T, xp, yp, xs, ys)
    if pixel_scale.ndim == 3:  # decided when compiled: a branch in the loop costs a factor of 9
        first = imaged_shift(x1 / z1, y1 / z1, xp, yp, pixel_scale, 0)
        return first, imaged_shift(x2 / z2, y2 / z2, xs, ys, pixel_scale, 1), z1
    dx, dy = x1 / z1 - xp, y1 / z1 - yp
    u, v = pixel_scale[0, 0] * dx + pixel_scale[0, 1] * dy, pixel_scale[0, 2] * dy
    first = np.sqrt(u * u + v * v)
    dx, dy = x2 / z2 - xs, y2 / z2 - ys
    u, v = pixel_scale[1, 0] * dx + pixel_scale[1, 1] * dy, pixel_scale[1, 2] * dy
    return first, np.sqrt(u * u + v * v), z1


def reprojection_errors_of_rays(
    R: FloatArray, T: FloatArray, rays: FloatArray, pixel_scale: FloatArray
) -> FloatArray:
    """E2D(1) and E2D(2) of n pairs in pixels, shape (n, 2); NaN as in `midpoint`."""
    errors = np.empty((rays.shape[1], 2))
    _fill_errors(contiguous(R), contiguous(T), contiguous(rays), contiguous(pixel_scale), errors)
    return errors


@compiled
def _fill_errors(
    R: FloatArray, T: FloatArray, rays: FloatArray, pixel_scale: FloatArray, errors: FloatArray
) -> None:
    for k in range(rays.shape[1]):
        errors[k, 0], errors[k, 1], _ = reprojection_shift(
            R, T, rays[0, k], rays[1, k], rays[2, k], rays[3, k], pixel_scale
        )


def stack_rays(primary: npt.ArrayLike, secondary: npt.ArrayLike) -> FloatArray:
    """Normalised points of both cameras, each (n, 2), as the (4, n) array of compiled functions."""
    both = np.column_stack([np.asarray(primary), np.asarray(secondary)])
    return np.ascontiguousarray(both.T, dtype=np.float64)


def triangulate(pose: Pose, primary: npt.ArrayLike, secondary: npt.ArrayLike) -> FloatArray:
    """3D points (n, 3) in the primary frame, from normalised points (n, 2) of each camera."""
    return triangulate_rays(pose.R, pose.T, stack_rays(primary, secondary))


def midpoints(
    origins: FloatArray, directions: FloatArray, others: FloatArray, other_directions: FloatArray
) -> FloatArray:
    """Midpoints (n, 3) of the shortest segments between rays with origins and unit directions (n,
    3) in one frame; NaN where they are parallel or the point is behind an origin."""
    between = others - origins
    one, two = (np.sum(between * way, axis=1) for way in (directions, other_directions))
    cosine = np.sum(directions * other_directions, axis=1)
    sine_squared = 1.0 - cosine**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (one - cosine * two) / sine_squared
        r = (cosine * one - two) / sine_squared
    usable = (sine_squared > PARALLEL_SINE_SQUARED) & (s > 0.0) & (r > 0.0)
    points = 0.5 * (origins + s[:, None] * directions + others + r[:, None] * other_directions)
    return np.where(usable[:, None], points, np.nan)


def apart_m(
    origins: FloatArray, directions: FloatArray, others: FloatArray, other_directions: FloatArray
) -> FloatArray:
    """Signed distances (n,) of the lines of rays as of `midpoints`."""
    across = np.cross(directions, other_directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(np.sum((others - origins) * across, axis=1))


def residuals(E: FloatArray, primary: npt.ArrayLike, secondary: npt.ArrayLike) -> FloatArray:
    """`q_secondary^T E q_primary` of n pairs of normalised points, shape (n,) (paper, eq. 3)."""
    values: FloatArray = np.einsum("ni,ij,nj->n", homogeneous(secondary), E, homogeneous(primary))
    return values


def homogeneous(points: npt.ArrayLike) -> FloatArray:
    """(n, 3): points (n, 2) of a plane with a third coordinate of 1."""
    points = np.asarray(points, dtype=np.float64)
    return np.column_stack([points, np.ones(len(points))])


def sampson(E: FloatArray, rays: FloatArray) -> FloatArray:
    """Signed Sampson distances of pairs (..., 4), x and y of both cameras, in their units.

    Hartley and Zisserman (2004), Multiple View Geometry, equation 11.9.

    Args:
        E: (3, 3), or (k, 3, 3) for distances (k, ...) with each of k matrices.
    """
    flat = rays.reshape(-1, 4)
    p, q = homogeneous(flat[:, :2]), homogeneous(flat[:, 2:])
    lines, back = p @ E.swapaxes(-1, -2), q @ E
    squared = (lines[..., :2] ** 2).sum(axis=-1) + (back[..., :2] ** 2).sum(axis=-1)
    distances = (q * lines).sum(axis=-1) / np.sqrt(squared)
    return np.asarray(distances.reshape(*E.shape[:-2], *rays.shape[:-1]))


def on_their_heads(poses: Sequence[Pose], upright: float = 0.0) -> list[int]:
    """Numbers of the cameras that stand on their heads beside the others.

    The vertical is the direction to which the rows of all images and the ways from camera to camera
    are most perpendicular, and the columns most parallel: cameras are tilted more than rolled, and
    stand more beside than above each other.

    Args:
        poses: of the cameras in any common frame, `camera_from_common`.
        upright: least cosine between the vertical and the columns of every image; else none is.
    """
    rows, columns = np.array([pose.R[:2] for pose in poses]).transpose(1, 0, 2)
    away = np.array([pose.inverse().T for pose in poses])
    away -= away.mean(axis=0)
    away /= np.linalg.norm(away, axis=1, keepdims=True).max()
    vertical = np.linalg.eigh(columns.T @ columns - rows.T @ rows - away.T @ away / 2.0)[1][:, -1]
    down = columns @ vertical
    down *= np.sign(down.sum())
    return np.flatnonzero(down < 0.0).tolist() if np.abs(down).min() > upright else []
