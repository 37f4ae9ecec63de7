"""A pair of ROS camera_info files; R and T are recovered from the rectification matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.opencv_stereo import rectification
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, numbers, rig_of
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_of,
    pose_of,
    size_of,
)
from stereocal.formats.lens_model import FISHEYE, lens_model_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose

ONE_LENS, PRIMARY_FIRST = "one lens for both cameras", "primary first"
SINGLE_FILES = "camera files"
"""Program and words of cameras that were calibrated one by one."""


def write_ros(two: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`primary.yaml` and `secondary.yaml`."""
    R1, R2, P1, P2, _Q = rectification(rig_of(two))
    files = {}
    for (which, camera, _pose), R, P in zip(two, (R1, R2), (P1, P2), strict=True):
        model, coefficients = _distortion(camera, which)
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
            + f"distortion_model: {model}\n"
            + _matrix("distortion_coefficients", coefficients[None])
            + _matrix("rectification_matrix", R)
            + _matrix("projection_matrix", P)
        )
        files[f"{which}.yaml"] = text.encode()
    return files


def is_ros(file: ForeignFile) -> bool:
    """Whether it is a camera_info file."""
    keys = {"camera_matrix", "projection_matrix", "distortion_model"}
    return file.ends_with(".yaml", ".yml") and keys <= set(file.storage)


def read_ros(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """The cameras of two camera_info files, or one lens for both; their pose if it is in them."""
    fitting = [file for file in files if file.ends_with(".yaml", ".yml")]
    expected = (
        f"{source}: two camera_info files are expected, there are {len(fitting)}: use their folder."
    )
    if not 1 <= len(fitting) <= 2:
        raise StereocalError(expected)
    pose, no_pose = None, expected
    if len(fitting) == 2:
        try:
            pose, fitting = _rectified_pair(fitting, source)
        except StereocalError as error:  # cameras that were calibrated one by one
            no_pose = str(error)
    cameras = [_camera(file, k, options) for k, file in enumerate(fitting)]
    if pose is not None:
        return CameraPair(cameras[0], cameras[1], pose)
    words = ONE_LENS if len(cameras) == 1 else PRIMARY_FIRST
    return CameraPair(cameras[0], cameras[-1], None, no_pose, SINGLE_FILES, words)


def _rectified_pair(files: Files, source: str) -> tuple[Pose, list[ForeignFile]]:
    """The pose, and the files with the primary's first: its last column of P has zeros."""
    projections = [_numbers_of(file, "projection_matrix", (3, 4)) for file in files]
    shifts = [float(np.abs(P[:2, 3]).max()) for P in projections]
    if min(shifts) > 0 or max(shifts) == 0:
        raise StereocalError(
            f"{source}: the projection matrices are not those of a stereo pair: one must have a "
            "last column of zeros, the other the baseline."
        )
    first, second = (0, 1) if shifts[0] == 0 else (1, 0)
    turns = [_numbers_of(file, "rectification_matrix", (3, 3)) for file in files]
    R1, R2, P2 = turns[first], turns[second], projections[second]
    if not (P2[0, 0] > 0 and P2[1, 1] > 0):
        raise StereocalError(f"{source}: the focal lengths of a projection matrix are not above 0.")
    T = R2.T @ np.array([P2[0, 3] / P2[0, 0], P2[1, 3] / P2[1, 1], 0.0])
    return pose_of(R2.T @ R1, T, source), [files[first], files[second]]


def _camera(file: ForeignFile, k: int, options: ExchangeOptions) -> Camera:
    data, name = file.storage, file.name
    model = data.get("distortion_model")
    coefficients = _numbers_of(file, "distortion_coefficients", (-1,))
    if model not in (None, "plumb_bob", "rational_polynomial", *FISHEYE):
        raise StereocalError(
            f"{name}: the lens model {model} is not supported; use plumb_bob, "
            "rational_polynomial or equidistant."
        )
    lens_model = lens_model_of(coefficients, model, options.lens_model, name)
    size = [data.get("image_width"), data.get("image_height")]
    K = _numbers_of(file, "camera_matrix", (3, 3))
    known_size = size_of(None if None in size else size, options, k, name)
    return camera_of(K, coefficients, known_size, name, lens_model)


def _distortion(camera: Camera, which: str) -> tuple[str, FloatArray]:
    """The name of the lens model, and its coefficients."""
    if camera.is_fisheye:
        return "equidistant", camera.distortion
    eight = lens(camera, 8, which, "A ROS camera_info")
    return ("rational_polynomial", eight) if eight[5:].any() else ("plumb_bob", eight[:5])


def _numbers_of(file: ForeignFile, key: str, shape: tuple[int, ...]) -> FloatArray:
    table = file.storage.get(key)
    values = table.get("data") if isinstance(table, dict) else table
    return array_of(values, shape, key, file.name)


def _matrix(name: str, values: FloatArray) -> str:
    rows, columns = values.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {numbers(values)}\n"
