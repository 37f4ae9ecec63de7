"""Cameras by their unknowns, and steps from there.

The unknowns are those of `views`: of each camera a small rotation about its own axes, T, and its
lens. Rotations have no poles: a step of any size is one rotation, wherever the cameras look and
stand.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.fit.least_squares.distortion import distort, lenses_of_cameras
from stereocal.fit.least_squares.views import DISTORTION, EACH, LENS, TRANSLATION, Cameras
from stereocal.fit.least_squares.windows import (
    KIND,
    NO_WINDOWS,
    NONE,
    OF_WINDOW,
    OWN_FRAME,
    SHARED,
    THICKNESS,
    fill_plane,
)
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.rig import Rig
from stereocal.rig.window import Window
from stereocal.system.array_types import FloatArray

STEP = 1e-6
"""Of differences, in radians and metres."""
FACTOR = -1
"""The place of the factor of the lengths in q: the last."""
OF_PAIR = 2 * EACH + 1
"""How many unknowns two cameras have in air."""
OF_PAIR_BEHIND_WINDOWS = OF_PAIR + 2 * OF_WINDOW


def pose_places(number: int) -> slice:
    """The places in q of the rotation and T of a camera."""
    return slice(EACH * number, EACH * number + LENS)


def lens_places(number: int) -> list[int]:
    """The places in q of fx, fy, cx, cy, k1, k2, p1, p2 of a camera."""
    first, distortion = EACH * number + LENS, EACH * number + DISTORTION
    return [*range(first, first + 4), *range(distortion, distortion + 4)]


def window_places(number: int, cameras: int) -> slice:
    """The places in q of the window of one of some cameras, where there are windows."""
    first = EACH * cameras + OF_WINDOW * number
    return slice(first, first + OF_WINDOW)


def cameras_at(cameras: Sequence[Camera], poses: Sequence[Pose]) -> Cameras:
    """Cameras where they are, with a factor of the lengths of 1; each with its own window.

    Args:
        poses: `camera_from_reference` of each.
    """
    windows = windows_of(cameras)
    q = np.zeros((EACH + OF_WINDOW * (len(windows) > 0)) * len(cameras) + 1)
    q[FACTOR] = 1.0
    for number, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
        q[pose_places(number)][TRANSLATION:] = pose.T
        q[lens_places(number)] = camera.lens_values
        if camera.window is not None:
            q[window_places(number, len(cameras))] = window_values(camera.window)
    R = np.array([pose.R for pose in poses])
    return Cameras(q, R, lenses_of_cameras(*cameras), windows)


def windows_of(cameras: Sequence[Camera]) -> FloatArray:
    """(c, 2): what is held of the window of each camera (`windows`); empty without any."""
    if all(camera.window is None for camera in cameras):
        return NO_WINDOWS
    held = np.full((len(cameras), 2), NONE)
    for row, camera in zip(held, cameras, strict=True):
        if camera.window is not None:
            row[KIND], row[THICKNESS] = OWN_FRAME, camera.window.thickness_m
    return held


def window_values(window: Window) -> FloatArray:
    """(5,): the unknowns of a window in the frame in which it is stated."""
    x, y, z = window.normal
    return np.array([x / z, y / z, window.distance_m, window.medium, window.glass])


def window_at(cameras: Cameras, number: int) -> Window | None:
    """The window of a camera in its own frame; None if it has none."""
    if not len(cameras.windows) or cameras.windows[number, KIND] == NONE:
        return None
    plane = np.empty(7)
    fill_plane(cameras.windows, cameras.q, cameras.R, number, EACH * number, plane)
    x, y, z, distance, thickness, glass, medium = plane.tolist()
    return Window((x, y, z), distance, thickness, glass, medium)


def with_own_windows(cameras: Cameras) -> tuple[Cameras, FloatArray]:
    """The cameras with the windows that they share in the frame of each, and the derivatives (Q, Q)
    of these unknowns by the others."""
    J, count = np.eye(len(cameras.q)), len(cameras.R)
    if not (cameras.windows == SHARED).any():
        return cameras, J
    q, held = cameras.q.copy(), cameras.windows.copy()
    held[held[:, KIND] == SHARED, KIND] = OWN_FRAME
    for number in np.flatnonzero(cameras.windows[:, KIND] == SHARED).tolist():
        places = window_places(number, count)
        q[places] = _own_values(cameras, number)
        J[places] = 0.0
        for i in (*range(*pose_places(number).indices(len(q))), *range(places.start, places.stop)):
            step = STEP * np.eye(len(q))[i]
            ends = (_own_values(moved(cameras, way * step), number) for way in (1.0, -1.0))
            J[places, i] = np.subtract(*ends) / (2.0 * STEP)
    return cameras._replace(q=q, windows=held), J


def _own_values(cameras: Cameras, number: int) -> FloatArray:
    window = window_at(cameras, number)
    assert window is not None, "a window that is shared"
    return window_values(window)


def rig_at(rig: Rig) -> Cameras:
    """The two cameras of a rig where they are."""
    return cameras_at((rig.primary, rig.secondary), (AT_ORIGIN, rig.pose))


@compiled
def turned(R: FloatArray, q: FloatArray) -> FloatArray:
    """(c, 3, 3): the rotations R after the small ones of q (Rodrigues)."""
    rotations, K = R.copy(), np.zeros((3, 3))
    for c in range(len(R)):
        x, y, z = q[EACH * c], q[EACH * c + 1], q[EACH * c + 2]
        angle = np.sqrt(x * x + y * y + z * z)
        if angle > 0.0:
            K[0, 1], K[0, 2], K[1, 0], K[1, 2], K[2, 0], K[2, 1] = -z, y, z, -x, -y, x
            across = K @ R[c]
            rotations[c] += np.sin(angle) / angle * across
            rotations[c] += 2.0 * (np.sin(0.5 * angle) / angle) ** 2 * (K @ across)
    return rotations


def poses_in(q: FloatArray, cameras: int) -> FloatArray:
    """(c, 6): a view on the rotation and T of each of some cameras in q (Q,)."""
    return q[: EACH * cameras].reshape(-1, EACH)[:, :LENS]


def moved(cameras: Cameras, step: FloatArray) -> Cameras:
    """The cameras after a step (Q,) of any size."""
    q = cameras.q + step
    poses_in(q, len(cameras.R))[:, :TRANSLATION] = 0.0
    return cameras._replace(q=q, R=turned(cameras.R, step))


def step_between(other: Cameras, cameras: Cameras) -> FloatArray:
    """(Q,): the step from cameras to others, so that `moved` of it gives those."""
    step = other.q - cameras.q
    turns = Rotation.from_matrix(other.R @ cameras.R.transpose(0, 2, 1)).as_rotvec()
    poses_in(step, len(cameras.R))[:, :TRANSLATION] = turns
    return np.asarray(step)


def pose_at(cameras: Cameras, number: int = 1) -> Pose:
    """`camera_from_reference` of a camera."""
    return Pose(cameras.R[number], cameras.q[pose_places(number)][TRANSLATION:])


def rig_of(primary: Camera, secondary: Camera, cameras: Cameras) -> Rig:
    """The rig of two cameras with the unknowns instead of their stated lenses."""
    first, second = (camera_at(camera, cameras, k) for k, camera in enumerate((primary, secondary)))
    return Rig(first, second, pose_at(cameras))


def camera_at(stated: Camera, cameras: Cameras, number: int) -> Camera:
    """The stated camera with the fx, fy, cx, cy, k1, k2, p1, p2 and the window of one of some."""
    fx, fy, cx, cy, *distortion = cameras.q[lens_places(number)].tolist()
    K = stated.K.copy()
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = fx, fy, cx, cy
    whole = stated.distortion.copy()
    if not len(whole) and any(distortion):
        whole = np.zeros(4)
    whole[:4] = distortion[: len(whole)]
    window = window_at(cameras, number)
    return Camera(K, whole, stated.image_size, model=stated.model, window=window)


def baseline_direction(cameras: Cameras) -> FloatArray:
    """(Q,): the derivative of the distance between two cameras, the first of which is the
    reference."""
    direction, T = np.zeros(len(cameras.q)), cameras.q[pose_places(1)][TRANSLATION:]
    direction[pose_places(1)][TRANSLATION:] = T / np.linalg.norm(T)
    return direction


def largest_turn_sigma(cameras: Cameras, covariance: FloatArray) -> float:
    """The largest standard error, in radians, of a rotation of the second of two cameras about an
    axis of its own, or of the direction of the baseline."""
    C, t = covariance[pose_places(1), pose_places(1)], baseline_direction(cameras)[pose_places(1)]
    along = np.outer(t, t)
    along[:TRANSLATION, :TRANSLATION] = 0.0
    across = np.eye(len(C)) - along
    across[TRANSLATION:] /= np.linalg.norm(cameras.q[pose_places(1)][TRANSLATION:])
    return float(np.sqrt(np.diag(across @ C @ across.T).max()))


def derivatives_by_rig(
    errors: Callable[[Rig], FloatArray], rig: Rig, spread: FloatArray
) -> FloatArray:
    """(n, r): derivatives of n errors that are computed with a rig, by central differences.

    Args:
        spread: (Q, r): steps of the unknowns, by whose factors the derivatives are.
    """
    cameras = rig_at(rig)

    def after(step: FloatArray) -> FloatArray:
        return errors(rig_of(rig.primary, rig.secondary, moved(cameras, step)))

    columns = [0.5 * (after(along) - after(-along)) for along in spread.T]
    return np.stack(columns, axis=1) if columns else np.zeros((len(errors(rig)), 0))


MAXIMUM_ITERATIONS = 20


@compiled
def undistort_rays(q: FloatArray, lenses: FloatArray, pixels: FloatArray, rays: FloatArray) -> bool:
    """Undistort pixels with the lenses of q, by Newton's method.

    Args:
        q: (Q,); the distortion is that of `lenses`.
        lenses: (c, 23), as in `views.Cameras`.
        pixels: (n, 2 c): u, v of each camera.
        rays: (2 c, n), updated; the initial values are used as the start.

    Returns:
        False if it does not converge.
    """
    for camera in range(len(lenses)):
        first = EACH * camera + LENS
        fx, fy, cx, cy = q[first], q[first + 1], q[first + 2], q[first + 3]
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
