"""Fit a fisheye to boards: least squares over the lens and the poses of all boards.

OpenCV's `fisheye.calibrate` works on the plane z = 1, which ends at 90 degrees from the axis, and
takes its poses from there: it found no lens for half of 40 simulated fisheyes of 175 to 220 degrees
from any of `STARTS`. Here points are rays, at any angle from the axis.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.rig.fisheye import image_radius
from stereocal.system.array_types import FloatArray

UNDETERMINED = (
    "The boards determine no lens: take photographs with the board tilted in different directions."
)
STARTS = np.geomspace(0.15, 0.7, 9)
"""Focal lengths over the longer side of the image from which a fisheye is fitted: lenses of 80 to
380 degrees."""
FINALISTS = 2
TRIAL_STEPS, STEPS = 12, 100
SETTLED = 1e-10
"""Relative change of the sum of squares at which a fit has converged."""
LOST = 0.02
"""RMS over the longer side of the image of a fit that found no lens. Fits of a real fisheye with
f = 337 px from wrong starts ended at 140 to 1300 px of 1032, right ones at 0.64."""
SAMPLES = 600
TINY = 1e-12
LARGEST_DAMPING = 1e9
SMALLEST_REST = 1e-6
"""Least part of a board that the others tell, by which its residuals are divided."""
LENS, POSE = 8, 6


class Boards:
    """Points (n, 3) on boards and their images (n, 2) px, of all views one after the other."""

    def __init__(self, points: Sequence[FloatArray], corners: Sequence[FloatArray]) -> None:
        self.starts = np.cumsum([0, *map(len, points)])[:-1]
        self.points, self.corners = np.concatenate(points), np.concatenate(corners)
        self.of = np.repeat(np.arange(len(points)), list(map(len, points)))


class FisheyeFit(NamedTuple):
    """A lens with the poses of the boards."""

    lens: FloatArray
    """(8,): fx, fy, cx, cy, k1 to k4."""
    R: FloatArray
    t: FloatArray
    """Rotations (b, 3, 3) and positions (b, 3) of the boards (`camera_from_board`)."""
    residuals: FloatArray
    """(n, 2): found minus projected points, px."""

    @property
    def error_px(self) -> float:
        """RMS of the residuals; infinite if there is none."""
        rms = float(np.sqrt(np.square(self.residuals).sum() / len(self.residuals)))
        return rms if np.isfinite(rms) else np.inf


def fit_fisheye(
    boards: Boards, image_size: tuple[int, int], start: FloatArray | None
) -> FloatArray:
    """(9,): fx, fy, cx, cy, k1 to k4 and 0, of the fit with the smallest error.

    Args:
        image_size: width and height.
        start: as returned; None: the best of `STARTS`.

    Raises:
        StereocalError: the boards determine no lens.
    """
    width, height = image_size
    side, rest = max(width, height), [0.5 * (width - 1), 0.5 * (height - 1), *[0.0] * 4]
    if start is None:
        tried = [_fit(boards, np.array([f, f, *rest]), TRIAL_STEPS) for f in STARTS * side]
        starts = [fit.lens for fit in sorted(tried, key=_error)[:FINALISTS]]
    else:
        starts = [start[:LENS]]
    best = min((_fit(boards, lens, STEPS) for lens in starts), key=_error)
    if not (best.error_px < LOST * side and min(best.lens[:2]) > 0):
        raise StereocalError(UNDETERMINED)
    return np.append(best.lens, 0.0)


def pose_boards(boards: Boards, lens: FloatArray) -> FisheyeFit:
    """The poses of boards before a known lens (8,)."""
    return _fit(boards, lens, STEPS, held=True)


def lens_information(boards: Boards, lens: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What each board, with its pose eliminated, adds to the normal matrix of a lens (b, 8, 8), for
    noise of 1 px, and to the gradient (b, 8)."""
    posed = pose_boards(boards, lens)
    residuals, J = _linearised(boards, posed.lens, posed.R, posed.t, held=False)
    N, g = _sums(boards, residuals, J)
    U, W, V = N[:, :LENS, :LENS], N[:, :LENS, LENS:], N[:, LENS:, LENS:]
    of_poses = np.linalg.solve(V, np.concatenate([W.transpose(0, 2, 1), g[:, LENS:, None]], axis=2))
    reduced = W @ of_poses
    return U - reduced[:, :, :LENS], g[:, :LENS] - reduced[:, :, LENS]


def lenses_without_each(boards: Boards, lens: FloatArray) -> FloatArray:
    """(b, 8): the lens without each board, with changes whose squares add up to its covariance.

    The fit of the others itself changes by 1 / sqrt(1 - h) more, where a board has the leverage h.
    Where one board alone tells what the lens does at its rim (h = 0.9999), the errors of a pair
    stated from 20 boards were 40 times too large with that (CR2 instead of CR3: Bell & McCaffrey
    2002, Survey Methodology 28, 169).
    """
    information, gradients = lens_information(boards, lens)
    unit = np.sqrt(np.diag(information.sum(axis=0)))
    root = np.linalg.cholesky(information.sum(axis=0) / np.outer(unit, unit))
    L = np.linalg.inv(root).T / unit[:, None]
    leverages, axes = np.linalg.eigh(L.T @ information @ L)
    along = np.einsum("bji,bj->bi", axes, gradients @ L)
    along /= np.sqrt(np.maximum(1.0 - leverages, SMALLEST_REST))
    return np.asarray(lens - np.einsum("bij,bj->bi", axes, along) @ L.T)


def _error(fit: FisheyeFit) -> float:
    return fit.error_px


def _fit(boards: Boards, lens: FloatArray, steps: int, held: bool = False) -> FisheyeFit:
    """The fit from a lens, by Levenberg and Marquardt's method.

    Args:
        held: whether the lens stays.
    """
    R, t = poses_of_rays(boards, rays_of(lens, boards.corners))
    linearised, damping = partial(_linearised, boards, held=held), 1e-3
    with np.errstate(all="ignore"):  # far from the lens; such steps are not taken
        residuals, J = linearised(lens, R, t)
        cost = float(np.square(residuals).sum())
        for _ in range(steps):
            try:
                step, turns, shifts = _step(boards, residuals, J, damping)
            except np.linalg.LinAlgError:
                break
            trial = lens + step, Rotation.from_rotvec(turns).as_matrix() @ R, t + shifts
            new, new_J = linearised(*trial)
            new_cost = float(np.square(new).sum())
            if new_cost < cost:
                settled = cost - new_cost < SETTLED * cost
                (lens, R, t), residuals, J, cost = trial, new, new_J, new_cost
                damping = max(0.2 * damping, 1e-9)
                if settled:
                    break
            elif (damping := 5.0 * damping) > LARGEST_DAMPING:
                break
    return FisheyeFit(lens, R, t, residuals)


def rays_of(lens: FloatArray, corners: FloatArray) -> FloatArray:
    """(n, 3): unit rays of pixels (n, 2), to the angle at which the radius in the image ends to
    increase."""
    x, y = ((corners - lens[2:4]) / lens[:2]).T
    radius, angles = np.hypot(x, y), np.linspace(0.0, np.pi, SAMPLES)
    of_angles = image_radius(angles, *lens[4:])[0]
    rising = np.flatnonzero(np.diff(of_angles) <= 0.0)
    end = rising[0] + 1 if len(rising) else SAMPLES
    angle = np.interp(radius, of_angles[:end], angles[:end])
    across = np.sin(angle) / np.maximum(radius, TINY)
    return np.column_stack([across * x, across * y, np.cos(angle)])


def poses_of_rays(boards: Boards, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (b, 3, 3) and positions (b, 3) of boards (`camera_from_board`) from the rays (n, 3)
    of their points, at any angle from the axis.

    The homography that takes the points of a plane to vectors parallel to the rays.
    """
    plane = boards.points / np.abs(boards.points).max()
    plane[:, 2] = 1.0
    x, y, z = rays.T
    none = np.zeros(len(x))
    crosses = np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)
    rows = (crosses[:, :, :, None] * plane[:, None, None, :]).reshape(len(x), 3, 9)
    sums = np.add.reduceat(rows.transpose(0, 2, 1) @ rows, boards.starts)
    H = np.linalg.eigh(sums)[1][:, :, 0].reshape(-1, 3, 3)
    along = np.add.reduceat(np.einsum("ni,nij,nj->n", rays, H[boards.of], plane), boards.starts)
    size = np.linalg.norm(H[:, :, :2], axis=1).mean(axis=1)
    H *= (np.where(along < 0.0, -1.0, 1.0) / size)[:, None, None]
    third = np.cross(H[:, :, 0], H[:, :, 1])
    left, _, right = np.linalg.svd(np.dstack([H[:, :, :2], third]))
    # Its determinant is positive, so the nearest orthogonal matrix is a rotation.
    return left @ right, H[:, :, 2] * np.abs(boards.points).max()


def _linearised(
    boards: Boards, lens: FloatArray, R: FloatArray, t: FloatArray, held: bool
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, 2) in px, found minus projected, and the derivatives (n, 2, 14) of the
    projected points by the lens (0 if it is held), a turn of the board about the camera's axes,
    and its position.

    A point (x, y, z) at the angle theta = atan2(r, z) from the axis, r = |(x, y)|, is imaged at
    f rho(theta) (x, y) / r + c, with rho = theta + k1 theta^3 + ... + k4 theta^9. `along` is (x, y)
    / r (2, n); the derivatives of theta by the point are (z x / r, z y / r, -r) / (r^2 + z^2), and
    those of `along` 1 / r across it.
    """
    turned = np.einsum("nij,nj->ni", R[boards.of], boards.points)
    x, y, z = (turned + t[boards.of]).T
    r = np.maximum(np.hypot(x, y), TINY)
    angle, far, f = np.arctan2(r, z), r * r + z * z, lens[:2]
    radius, slope = image_radius(angle, *lens[4:])
    along = np.array([x, y]) / r
    of_angle = np.array([z * along[0], z * along[1], -r]) / far
    of_along = np.array([[y * y, -x * y], [-x * y, x * x]]) / r**3
    J = np.zeros((len(r), 2, LENS + POSE))
    by_point = slope * along[:, None] * of_angle
    by_point[:, :2] += radius * of_along
    by_point = np.moveaxis(f[:, None, None] * by_point, 2, 0)
    imaged = radius * along
    J[:, [0, 1], [0, 1]], J[:, [0, 1], [2, 3]] = imaged.T, 1.0
    powers = angle ** np.array([[3], [5], [7], [9]])
    J[:, :, 4:8] = np.einsum("i,in,kn->nik", f, along, powers)
    J[:, :, :LENS] *= not held
    J[:, :, 8:11] = np.cross(turned[:, None], by_point)
    J[:, :, 11:] = by_point
    return boards.corners - (f[:, None] * imaged).T - lens[2:4], J


def _step(
    boards: Boards, residuals: FloatArray, J: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The step of the lens (8,), turns (boards, 3) and shifts (boards, 3).

    The poses are eliminated board by board (Schur complement): with the blocks U of the lens, V of
    a pose and W between them, the lens is that of sum(U - W V^-1 W'), with damped diagonals.
    """
    N, g = _sums(boards, residuals, J)
    diagonal = np.einsum("bii->bi", N)
    U, W, V = N[:, :LENS, :LENS].sum(axis=0), N[:, :LENS, LENS:], N[:, LENS:, LENS:]
    of_lens = np.diag(U)
    # A lens that is held takes no step.
    U = U + np.diag(np.where(of_lens > 0.0, damping * of_lens, 1.0))
    V = V + damping * diagonal[:, LENS:, None] * np.eye(POSE)
    solved = np.linalg.solve(V, np.concatenate([W.transpose(0, 2, 1), g[:, LENS:, None]], axis=2))
    reduced = U - (W @ solved[:, :, :LENS]).sum(axis=0)
    lens = np.linalg.solve(
        reduced, g[:, :LENS].sum(axis=0) - (W @ solved[:, :, LENS:])[:, :, 0].sum(axis=0)
    )
    poses = solved[:, :, LENS] - solved[:, :, :LENS] @ lens
    return lens, poses[:, :3], poses[:, 3:]


def _sums(boards: Boards, residuals: FloatArray, J: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The normal matrix (b, 14, 14) and the gradient (b, 14) of each board."""
    N = np.add.reduceat(J.transpose(0, 2, 1) @ J, boards.starts)
    return N, np.add.reduceat((J * residuals[:, :, None]).sum(axis=1), boards.starts)
