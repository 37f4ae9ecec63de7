"""DLT coefficients for DLTdv, easyWand and Argus: 11 rows, one column per camera.

`u = (L1 X + L2 Y + L3 Z + L4) / (L9 X + L10 Y + L11 Z + 1)`, v with L5 to L8, for undistorted
points; the lens is not in the file. They are P = K [R | t] row by row, divided by its last entry.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
from scipy.linalg import rq

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import ExchangeOptions, Posed, number
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    array_of,
    camera_of,
    only_file,
    pose_of,
    size_of,
)
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.system.arrays import LARGEST

ORIGIN_BEHIND_M = 1e-6
"""DLT cannot represent a camera at the origin, where the last entry of P is 0. So without a world
frame of the user, the origin is put 0.001 mm in front of the primary camera."""


def write_dlt(cameras: Sequence[Posed], options: ExchangeOptions) -> dict[str, bytes]:
    """`dlt.csv`, a column a camera."""
    first = Pose(np.eye(3), np.array([0.0, 0.0, ORIGIN_BEHIND_M]))
    if options.world is not None:
        first = options.world.inverse()
    columns = [dlt_coefficients(camera, pose @ first, options) for _, camera, pose in cameras]
    rows = zip(*columns, strict=True)
    text = "".join(",".join(number(value) for value in row) + "\n" for row in rows)
    return {"dlt.csv": text.encode()}


def dlt_coefficients(
    camera: Camera, camera_from_world: Pose, options: ExchangeOptions
) -> FloatArray:
    """(11,): of a camera, for undistorted pixels with the origin of `options`."""
    origin = options.origin().matrix(camera.image_size[1])
    P = origin @ camera.K @ np.column_stack([camera_from_world.R, camera_from_world.T])
    if abs(P[2, 3]) < 1e-9:
        raise StereocalError(
            "The origin of the world lies in the plane of a camera's centre, where DLT "
            "coefficients do not exist: move the world's origin."
        )
    return np.asarray((P / P[2, 3]).ravel()[:11])


def read_dlt(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras without lens distortion, and their pose; the world frame is ignored."""
    file = only_file(files, (".csv", ".txt"), source)
    name, lines = file.name, io.StringIO(file.text)
    try:
        rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise StereocalError(f"{name}: this is not a CSV file ({error}).") from error
    table = array_of(rows, (-1,), "the table", name)
    if len(rows) != 11 or len(table) != 22:
        raise StereocalError(
            f"{name}: 11 rows with one column for each of two cameras are expected, without a "
            f"header; the file has {len(rows)} rows and {len(rows[0]) if rows else 0} columns."
        )
    cameras, poses = [], []
    for k, which in enumerate(CAMERAS):
        size = size_of(None, options, k, name)
        P = np.append(table.reshape(11, 2)[:, k], 1.0).reshape(3, 4)
        P = np.linalg.inv(options.origin().matrix(size[1])) @ P
        K, pose = _decomposed(P, f"{name}, {which}")
        cameras.append(camera_of(K, np.zeros(0), size, f"{name}, {which}"))
        poses.append(pose)
    # The file cannot state a unit; our files are recognised by their world origin.
    ours = np.allclose(poses[0].R, np.eye(3), rtol=0, atol=1e-6) and np.allclose(
        poses[0].T, [0.0, 0.0, ORIGIN_BEHIND_M], rtol=0, atol=1e-3 * ORIGIN_BEHIND_M
    )
    pose = poses[1] @ poses[0].inverse()
    return CameraPair(cameras[0], cameras[1], pose, stated="m" if ours else None)


def _decomposed(P: FloatArray, source: str) -> tuple[FloatArray, Pose]:
    """K and pose of a projection matrix of any scale and sign."""
    largest = float(np.abs(P).max())
    scale = float(np.linalg.norm(P[2, :3])) if largest < LARGEST else 0.0
    if largest >= LARGEST * scale or abs(np.linalg.det(P[:, :3] / scale)) < 1e-9:
        raise StereocalError(f"{source}: the coefficients are not those of a camera.")
    P = P / scale * np.sign(np.linalg.det(P[:, :3]))
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    if np.diag(K).min() < 1e-12 * np.abs(K).max():
        raise StereocalError(f"{source}: the coefficients are not those of a camera.")
    t = np.linalg.solve(K, P[:, 3])
    K /= K[2, 2]
    K[1, 0] = K[2, 0] = K[2, 1] = 0.0
    K[2, 2] = 1.0
    return K, pose_of(R, t, source)
