"""A pair of ROS camera_info files; R and T are recovered from the rectification matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.opencv_stereo import rectification
from stereocal.formats.exchange.options import (
    ExchangeOptions,
    ReadRig,
    array_of,
    header,
    numbers,
    size_of,
    text_of,
)
from stereocal.formats.lens_model import check_lens_model
from stereocal.formats.yaml_text import read_yaml
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig


def write_ros(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`primary.yaml` and `secondary.yaml`.

    Raises:
        StereocalError: a lens with more than eight coefficients.
    """
    R1, R2, P1, P2, _Q = rectification(rig)
    files = {}
    for which, camera, R, P in (
        ("primary", rig.primary, R1, P1),
        ("secondary", rig.secondary, R2, P2),
    ):
        eight = lens(camera, 8, which, "A ROS camera_info")
        rational = bool(eight[5:].any())
        coefficients = eight if rational else eight[:5]
        width, height = camera.image_size
        text = header(
            "#",
            f"The {which} camera of the pair. The centre of the top-left pixel is (0, 0).",
            "The pair's R and T are not in it as such: R = R2^T R1 and",
            "T = R2^T (P2[0,3] / P2[0,0], P2[1,3] / P2[1,1], 0) from the rectification matrices.",
        )
        text += (
            f"image_width: {width}\nimage_height: {height}\ncamera_name: {which}\n"
            + _matrix("camera_matrix", camera.K)
            + f"distortion_model: {'rational_polynomial' if rational else 'plumb_bob'}\n"
            + _matrix("distortion_coefficients", coefficients[None])
            + _matrix("rectification_matrix", R)
            + _matrix("projection_matrix", P)
        )
        files[f"{which}.yaml"] = text.encode()
    return files


def read_ros(files: Mapping[str, bytes], options: ExchangeOptions, source: str) -> ReadRig:
    """Two cameras and their pose; the primary's projection matrix has a last column of zeros.

    Raises:
        StereocalError: not two files, or not a rectified pair.
    """
    fitting = {n: c for n, c in files.items() if n.lower().endswith((".yaml", ".yml"))}
    if len(fitting) != 2:
        raise StereocalError(
            f"{source}: two camera_info files are expected, there are {len(fitting)}: use their "
            "folder."
        )
    read = [(name, read_yaml(text_of(content, name), name)) for name, content in fitting.items()]
    projections = [_numbers_of(data, "projection_matrix", (3, 4), name) for name, data in read]
    shifts = [float(np.abs(P[:2, 3]).max()) for P in projections]
    if min(shifts) > 0 or max(shifts) == 0:
        raise StereocalError(
            f"{source}: the projection matrices are not those of a stereo pair: one must have a "
            "last column of zeros, the other the baseline."
        )
    first, second = (0, 1) if shifts[0] == 0 else (1, 0)
    turns = [_numbers_of(data, "rectification_matrix", (3, 3), name) for name, data in read]
    R1, R2, P2 = turns[first], turns[second], projections[second]
    if not (P2[0, 0] > 0 and P2[1, 1] > 0):
        raise StereocalError(f"{source}: the focal lengths of a projection matrix are not above 0.")
    T = R2.T @ np.array([P2[0, 3] / P2[0, 0], P2[1, 3] / P2[1, 1], 0.0])
    cameras = [ros_camera(*read[k], which, options) for which, k in enumerate((first, second))]
    return Rig(cameras[0], cameras[1], Pose(R2.T @ R1, T)), None


def ros_camera(name: str, data: Mapping[str, Any], k: int, options: ExchangeOptions) -> Camera:
    """The camera of a camera_info file; `k` is 0 for the primary.

    Raises:
        StereocalError: another lens model, or a number is missing.
    """
    model = data.get("distortion_model")
    coefficients = _numbers_of(data, "distortion_coefficients", (-1,), name)
    check_lens_model(coefficients, model, options.lens_model, name)
    if model not in (None, "plumb_bob", "rational_polynomial"):
        raise StereocalError(
            f"{name}: the lens model {model} is not supported; use plumb_bob or "
            "rational_polynomial."
        )
    size = [data.get("image_width"), data.get("image_height")]
    which = CAMERAS[k]
    return Camera(
        _numbers_of(data, "camera_matrix", (3, 3), name),
        coefficients,
        size_of(None if None in size else size, options.image_sizes[k], which, name),
    )


def _numbers_of(data: Mapping[str, Any], key: str, shape: tuple[int, ...], name: str) -> FloatArray:
    table = data.get(key)
    values = table.get("data") if isinstance(table, dict) else table
    return array_of(values, shape, key, name)


def _matrix(name: str, values: FloatArray) -> str:
    rows, columns = values.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {numbers(values)}\n"
