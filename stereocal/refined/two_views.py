"""The shared unknowns of a pair, the two views that they describe, and finite steps of them.

`q` (25,): the five angles, the baseline in metres, the factor of the bar's length, fx, fy, cx, cy
of the primary and of the secondary camera, k1, k2, p1, p2 of the primary and of the secondary
camera, and the time by which the secondary camera is late, in frames, with its drift in frames per
frame.

Delta and epsilon have no direction where the baseline lies along an optical axis, yaw and roll none
where the pitch is 90 degrees: there a rotation of 0.3 degrees is an angle of 12. Derivatives are
exact all the same, but a step of the size of a standard error is not linear in the angles. Near
these poles it is taken as a small rotation of the camera and of the baseline instead.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.refined import views
from stereocal.refined.distortion import distort
from stereocal.refined.views import EACH, LENS, TRANSLATION
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import compiled, contiguous
from stereocal.rig.geometry import Angles, Pose, angles_of, fill_pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

YAW, PITCH, ROLL, DELTA, EPSILON, BASELINE, BAR, PRIMARY, SECONDARY = 0, 1, 2, 3, 4, 5, 6, 7, 11
DISTORTION = 15
"""The first of k1, k2, p1, p2 of the primary; those of the secondary follow."""
TIME, DRIFT = 23, 24
SHARED = 25
OF_VIEWS = 2 * EACH + 1


@compiled
def unknowns_of_views(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The unknowns v of `views` (33,), the rotations (2, 3, 3), and B (25, 33), the derivatives of
    v by q.

    R is a product of rotations about y, x and z; the derivative by an angle is a rotation about its
    axis, rotated by the factors to its left.
    """
    v, R, B = np.zeros(OF_VIEWS), np.zeros((2, 3, 3)), np.zeros((SHARED, OF_VIEWS))
    R[0, 0, 0] = R[0, 1, 1] = R[0, 2, 2] = 1.0
    fill_pose(q, q[BASELINE], R[1], v[EACH + TRANSLATION : EACH + LENS])
    cy, sy = np.cos(q[YAW]), np.sin(q[YAW])
    cd, sd = np.cos(q[DELTA]), np.sin(q[DELTA])
    ce, se = np.cos(q[EPSILON]), np.sin(q[EPSILON])
    b, at = q[BASELINE], EACH + TRANSLATION
    B[YAW, EACH + 1], B[PITCH, EACH], B[PITCH, EACH + 2] = 1.0, cy, -sy
    for i in range(3):
        B[ROLL, EACH + i] = R[1, i, 2]
    B[DELTA, at], B[DELTA, at + 1], B[DELTA, at + 2] = -b * sd * ce, -b * sd * se, b * cd
    B[EPSILON, at], B[EPSILON, at + 1] = -b * cd * se, b * cd * ce
    B[BASELINE, at], B[BASELINE, at + 1], B[BASELINE, at + 2] = cd * ce, cd * se, sd
    for camera in range(2):
        for i in range(4):
            at = EACH * camera + LENS + i
            v[at], B[PRIMARY + 4 * camera + i, at] = q[PRIMARY + 4 * camera + i], 1.0
            at += 4
            v[at], B[DISTORTION + 4 * camera + i, at] = q[DISTORTION + 4 * camera + i], 1.0
    for i in range(2):
        v[EACH + views.TIME + i], B[TIME + i, EACH + views.TIME + i] = q[TIME + i], 1.0
    v[OF_VIEWS - 1], B[BAR, OF_VIEWS - 1] = q[BAR], 1.0
    return v, R, B


def shared_lens_places(number: int) -> list[int]:
    """(8,): the indices in q of the lens unknowns of the primary (0) or the secondary (1)."""
    first, distortion = (PRIMARY, SECONDARY)[number], DISTORTION + 4 * number
    return [*range(first, first + 4), *range(distortion, distortion + 4)]


def shared_unknowns(rig: Rig) -> FloatArray:
    """(25,): the shared unknowns of a rig, with a bar factor of 1."""
    first, second = rig.primary.lens_values, rig.secondary.lens_values
    return np.concatenate(
        [
            [*rig.pose.angles, rig.pose.baseline, 1.0],
            *(first[:4], second[:4], first[4:], second[4:], np.zeros(2)),
        ]
    )


def pose_of(q: FloatArray) -> Pose:
    """The pose of the shared unknowns."""
    return Pose.from_angles(Angles(*q[: EPSILON + 1].tolist()), float(q[BASELINE]))


def rig_of(primary: Camera, secondary: Camera, q: FloatArray) -> Rig:
    """The rig with the shared unknowns q instead of the stated lenses and pose."""
    cameras = primary, secondary
    first, second = (with_lens(cameras[k], q[shared_lens_places(k)]) for k in range(2))
    return Rig(first, second, pose_of(q))


def with_lens(stated: Camera, lens: FloatArray) -> Camera:
    """The stated camera with the fx, fy, cx, cy, k1, k2, p1, p2 of a lens, (8,)."""
    fx, fy, cx, cy, *distortion = lens.tolist()
    K = stated.K.copy()
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = fx, fy, cx, cy
    whole = stated.distortion.copy()
    if not len(whole) and any(distortion):
        whole = np.zeros(4)
    whole[:4] = distortion[: len(whole)]
    return Camera(K, whole, stated.image_size, model=stated.model)


SMALLEST_COSINE = 0.5
"""Of delta and pitch: 60 degrees from the pole of an ordinary rig. Measured: 6 degrees from the
pole the stated 95 % of the lengths are twice the true ones, 10 degrees from it they are right."""


def is_near_pole(q: FloatArray) -> bool:
    """Whether the five angles of the shared unknowns (25,) are poor coordinates."""
    return bool(np.abs(np.cos(q[[PITCH, DELTA]])).min() < SMALLEST_COSINE)


def turns_of(q: FloatArray) -> FloatArray:
    """(6, 5): derivatives by the five angles of the rotation vector of the secondary camera about
    its own axes, and of the direction of T."""
    B = unknowns_of_views(q)[2][:BASELINE, EACH : EACH + LENS].T
    return np.asarray(B / np.array([1.0, 1.0, 1.0, *np.full(3, q[BASELINE])])[:, None])


def pose_directions(q: FloatArray) -> FloatArray:
    """(5, 5): steps of the five angles in independent directions, as columns; near a pole those of
    small rotations."""
    if not is_near_pole(q):
        return np.eye(BASELINE)
    _, sizes, Vt = np.linalg.svd(turns_of(q), full_matrices=False)
    return np.asarray(Vt.T / sizes)


def moved(q: FloatArray, step: FloatArray) -> FloatArray:
    """(25,): shared unknowns after a step (25,) of finite size."""
    found = q + step
    if is_near_pole(q):
        v, R, _ = unknowns_of_views(q)
        turn = turns_of(q) @ step[:BASELINE]
        T = v[EACH + TRANSLATION : EACH + LENS]
        rotation = Rotation.from_rotvec(turn[:3]).as_matrix() @ R[1]
        to = Rotation.from_rotvec(np.cross(T, turn[3:]) / q[BASELINE]).apply(T)
        found[:BASELINE] = angles_of(contiguous(rotation), contiguous(to))
    return found


def step_between(other: FloatArray, q: FloatArray) -> FloatArray:
    """(25,): the step from shared unknowns q to others, so that `moved` of it gives those; angles
    within half a revolution."""
    found = other - q
    found[:BASELINE] = (found[:BASELINE] + np.pi) % (2 * np.pi) - np.pi
    if is_near_pole(q):
        v, R, _ = unknowns_of_views(q)
        its_v, its_R, _ = unknowns_of_views(other)
        T, its_T = (each[EACH + TRANSLATION : EACH + LENS] for each in (v, its_v))
        turn = Rotation.from_matrix(its_R[1] @ R[1].T).as_rotvec()
        normal = np.cross(T, its_T)
        sine = np.linalg.norm(normal)
        normal *= np.arctan2(sine, T @ its_T) / max(sine, 1e-300)
        along = np.concatenate([turn, np.cross(normal, T) / q[BASELINE]])
        found[:BASELINE] = np.linalg.lstsq(turns_of(q), along, rcond=None)[0]
    return found


def carried(covariance: FloatArray, q: FloatArray, to: FloatArray) -> FloatArray:
    """(25, 25): a covariance of the shared unknowns about q in the angles of others nearby."""
    if not is_near_pole(q):
        return covariance
    A = np.eye(SHARED)
    A[:BASELINE, :BASELINE] = np.linalg.lstsq(turns_of(to), turns_of(q), rcond=None)[0]
    return np.asarray(A @ covariance @ A.T)


def largest_turn_sigma(q: FloatArray, covariance: FloatArray) -> float:
    """The largest standard error of an angle, in radians; near a pole of a small rotation of the
    camera or of the baseline."""
    C = covariance[:BASELINE, :BASELINE]
    if is_near_pole(q):
        C = turns_of(q) @ C @ turns_of(q).T
    return float(np.sqrt(np.diag(C).max()))


def derivatives_by_rig(
    errors: Callable[[Rig], FloatArray], rig: Rig, spread: FloatArray
) -> FloatArray:
    """(n, r): derivatives of n errors that are computed with a rig, by central differences.

    Args:
        spread: (25, r): steps of the shared unknowns, by whose factors the derivatives are.
    """
    q = shared_unknowns(rig)

    def at(unknowns: FloatArray) -> FloatArray:
        return errors(rig_of(rig.primary, rig.secondary, unknowns))

    columns = [0.5 * (at(moved(q, along)) - at(moved(q, -along))) for along in spread.T]
    return np.stack(columns, axis=1) if columns else np.zeros((len(errors(rig)), 0))


MAXIMUM_ITERATIONS = 20


@compiled
def undistort_rays(q: FloatArray, lenses: FloatArray, pixels: FloatArray, rays: FloatArray) -> bool:
    """Undistort pixels with the lenses of q, by Newton's method.

    Args:
        q: (25,), the shared unknowns; the distortion is that of `lenses`.
        lenses: (2, 23), as in `views.fill_residuals`.
        pixels: (n, 4): u, v of the primary and of the secondary.
        rays: (4, n), updated; the initial values are used as the start.

    Returns:
        False if it does not converge.
    """
    for camera in range(2):
        at = PRIMARY if camera == 0 else SECONDARY
        fx, fy, cx, cy = q[at], q[at + 1], q[at + 2], q[at + 3]
        skew = lenses[camera, 0]
        for k in range(len(pixels)):
            by = (pixels[k, 2 * camera + 1] - cy) / fy
            bx = (pixels[k, 2 * camera] - cx - skew * by) / fx
            x, y = rays[2 * camera, k], rays[2 * camera + 1, k]
            error = np.inf
            for _ in range(MAXIMUM_ITERATIONS):
                u, v, xx, xy, yx, yy = distort(x, y, lenses, camera)
                scale = 1.0 / (xx * yy - xy * yx)
                du, dv = u - bx, v - by
                x -= scale * (yy * du - xy * dv)
                y -= scale * (xx * dv - yx * du)
                error = abs(du) + abs(dv)
                if error < 1e-12:
                    break
            if not error < 1e-9:
                return False
            rays[2 * camera, k], rays[2 * camera + 1, k] = x, y
    return True
