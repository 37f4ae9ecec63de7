"""Windows among the unknowns of `views`: what is held of each, and derivatives, compiled.

Of each of c cameras stand after the 16 c unknowns of the cameras 5 of its window: a and b of the
normal (a, b, 1) / |(a, b, 1)|, the distance, and the indices of the medium and of the glass. They
are in the camera's frame; those of a window that cameras share are in the reference's, where `n x =
d`, the same for all of them and tied to each other (`Unknowns.M`). Without windows there is no such
part, and the functions here are the identity: what tells is the number of dimensions, which numba
knows when it compiles.
"""

import numpy as np

from stereocal.rig.compiled import compiled, inlined
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.rig.window import fill_refracted, ray_through
from stereocal.system.array_types import FloatArray

OF_WINDOW = 5
"""Unknowns of a window."""
NORMAL, DISTANCE, MEDIUM, GLASS = 0, 2, 3, 4
"""Where they begin."""
KIND, THICKNESS = 0, 1
"""Of the (c, 2) that is held of windows: one of the next three, and metres."""
NONE, OWN_FRAME, SHARED = 0.0, 1.0, 2.0
NO_WINDOWS = np.empty(0)
"""Of cameras without any."""


@compiled
def fill_plane(
    windows: FloatArray, q: FloatArray, R: FloatArray, c: int, first: int, plane: FloatArray
) -> None:
    """Write the window of a camera in its frame, as `window.Window.values` (7,).

    Args:
        first: where the unknowns of the camera begin in q.
    """
    place = len(q) - 1 - OF_WINDOW * (len(R) - c)
    a, b = q[place], q[place + 1]
    unit = 1.0 / np.sqrt(a * a + b * b + 1.0)
    x, y, z = a * unit, b * unit, unit
    distance = q[place + DISTANCE]
    if windows[c, KIND] == SHARED:
        for i in range(3):
            plane[i] = R[c, i, 0] * x + R[c, i, 1] * y + R[c, i, 2] * z
            distance += plane[i] * q[first + 3 + i]
    else:
        plane[0], plane[1], plane[2] = x, y, z
    plane[3], plane[4] = distance, windows[c, THICKNESS]
    plane[5], plane[6] = q[place + GLASS], q[place + MEDIUM]


@inlined
def seen_in_air(
    windows: FloatArray,
    q: FloatArray,
    R: FloatArray,
    c: int,
    first: int,
    x: float,
    y: float,
    z: float,
    work: FloatArray,
) -> tuple[float, float, float]:
    """The point (x, y, z) in a camera's frame, behind a window the direction in which it is seen;
    its last coordinate is NaN for a point before the window.

    Args:
        work: (2, 14): the first row is that of `fill_refracted`, the second the window.
    """
    if windows.ndim == 1:
        return x, y, z
    if windows[c, KIND] == NONE:
        return x, y, z
    fill_plane(windows, q, R, c, first, work[1])
    if not fill_refracted(work[1], x, y, z, work[0]):
        return x, y, np.nan
    return work[0, 0], work[0, 1], work[0, 2]


@inlined
def before_window(
    windows: FloatArray, c: int, x: float, y: float, z: float, work: FloatArray
) -> tuple[float, float, float]:
    """A row of derivatives by the direction of `seen_in_air`, as one by the point.

    dA = w (dP - (N dP) N) + L (F_h N dP + 2 F_q L dP), with the entries of `fill_refracted`.
    """
    if windows.ndim == 1:
        return x, y, z
    if windows[c, KIND] == NONE:
        return x, y, z
    bent, plane = work[0], work[1]
    w = bent[6]
    along = x * plane[0] + y * plane[1] + z * plane[2]
    across = x * bent[3] + y * bent[4] + z * bent[5]
    by_normal, by_off = across * bent[8] - w * along, 2.0 * across * bent[9]
    return (
        w * x + by_normal * plane[0] + by_off * bent[3],
        w * y + by_normal * plane[1] + by_off * bent[4],
        w * z + by_normal * plane[2] + by_off * bent[5],
    )


@compiled
def fill_by_window(
    windows: FloatArray,
    q: FloatArray,
    R: FloatArray,
    lenses: FloatArray,
    c: int,
    first: int,
    weight: float,
    slopes: tuple[float, float, float, float, float, float, float],
    work: FloatArray,
    columns: FloatArray,
) -> None:
    """Write the derivatives of both residuals by the unknowns of a window, and add those by the
    pose, on which the plane of a shared window in the camera's frame depends.

    With a row r by A: by N, for a change dN across it, (1 - w N P) r - (w r N - r L (F_h - 2 N P
    F_q)) P, by D r L (F_D - F_h), by an index r L times its entry. In the reference's frame N = R n
    and D = d + N T: turning by u moves N by u x N.

    Args:
        weight: of a pixel.
        slopes: one over the last coordinate of the direction in air; the derivatives of the
            distorted point by the normalised one, as of `distort`; and that.
        work: as `seen_in_air` left it.
        columns: (2, 21): of the camera in `Work.Js`.
    """
    if windows.ndim == 1:
        return
    last = columns.shape[1] - OF_WINDOW
    if windows[c, KIND] == NONE:
        columns[:, last:] = 0.0
        return
    bent, plane = work[0], work[1]
    w, height = bent[6], bent[7]
    place = len(q) - 1 - OF_WINDOW * (len(R) - c)
    a, b = q[place], q[place + 1]
    unit = 1.0 / np.sqrt(a * a + b * b + 1.0)
    near, xx, xy, yx, yy, nx, ny = slopes
    fx, fy, skew = weight * q[first + 6], weight * q[first + 7], weight * lenses[c, 0]
    by_plane, row = np.empty(3), np.empty(3)
    for k in range(2):
        into = columns[k]
        row[0] = near * (fy * yx if k else fx * xx + skew * yx)
        row[1] = near * (fy * yy if k else fx * xy + skew * yy)
        row[2] = -(row[0] * nx + row[1] * ny)
        along = row[0] * plane[0] + row[1] * plane[1] + row[2] * plane[2]
        across = row[0] * bent[3] + row[1] * bent[4] + row[2] * bent[5]
        by_distance = across * (bent[10] - bent[8])
        of_point = across * (bent[8] - 2.0 * height * bent[9]) - w * along
        for i in range(3):
            point = bent[3 + i] + height * plane[i]
            by_plane[i] = (1.0 - w * height) * row[i] + of_point * point
        if windows[c, KIND] == SHARED:
            for i in range(3):
                by_plane[i] += by_distance * q[first + 3 + i]
                into[3 + i] += by_distance * plane[i]
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                into[i] += plane[j] * by_plane[m] - plane[m] * by_plane[j]
            x, y, z = (
                R[c, 0, 0] * by_plane[0] + R[c, 1, 0] * by_plane[1] + R[c, 2, 0] * by_plane[2],
                R[c, 0, 1] * by_plane[0] + R[c, 1, 1] * by_plane[1] + R[c, 2, 1] * by_plane[2],
                R[c, 0, 2] * by_plane[0] + R[c, 1, 2] * by_plane[1] + R[c, 2, 2] * by_plane[2],
            )
        else:
            x, y, z = by_plane[0], by_plane[1], by_plane[2]
        inner = unit * unit * (a * x + b * y + z)  # by (a, b, 1) / |(a, b, 1)|
        into[last] = unit * (x - inner * a)
        into[last + 1] = unit * (y - inner * b)
        into[last + DISTANCE] = by_distance
        into[last + MEDIUM] = across * bent[12]
        into[last + GLASS] = across * bent[11]


@compiled
def nearest_behind_windows(
    windows: FloatArray,
    q: FloatArray,
    R: FloatArray,
    rays: FloatArray,
    b: FloatArray,
    V: FloatArray,
) -> bool:
    """Write the point nearest to the rays (c, 2) in the medium to b (3,), in the reference's frame;
    1 m in front where there is none.

    Returns:
        False without windows.
    """
    if windows.ndim == 1:
        return False
    each = (len(q) - 1) // len(R) - OF_WINDOW
    seen, plane = 0, np.empty(7)
    b[:] = 0.0
    V[:] = 0.0
    for c in range(len(R)):
        x, y = rays[c, 0], rays[c, 1]
        if np.isnan(x):
            continue
        if windows[c, KIND] == NONE:
            norm = 1.0 / np.sqrt(x * x + y * y + 1.0)
            ray = 0.0, 0.0, 0.0, x * norm, y * norm, norm
        else:
            fill_plane(windows, q, R, c, each * c, plane)
            ray = ray_through(plane, x, y, 1.0)
        if np.isnan(ray[0]):
            continue
        seen += 1
        o = ray[0] - q[each * c + 3], ray[1] - q[each * c + 4], ray[2] - q[each * c + 5]
        for i in range(3):
            along = R[c, 0, i] * ray[3] + R[c, 1, i] * ray[4] + R[c, 2, i] * ray[5]
            V[i, i] += 1.0
            b[i] += R[c, 0, i] * o[0] + R[c, 1, i] * o[1] + R[c, 2, i] * o[2]
            b[i] -= along * (ray[3] * o[0] + ray[4] * o[1] + ray[5] * o[2])
            for j in range(3):
                V[i, j] -= along * (R[c, 0, j] * ray[3] + R[c, 1, j] * ray[4] + R[c, 2, j] * ray[5])
    if seen > 1 and factor(V, 1e-12):
        forward(V, b)
        backward(V, b)
    else:
        b[0], b[1], b[2] = 0.0, 0.0, 1.0
    return True
