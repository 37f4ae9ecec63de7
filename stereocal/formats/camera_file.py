"""Camera files: our JSON (`stereocal-camera/1`) and OpenCV FileStorage (YAML, XML, JSON)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from stereocal.camera import Camera
from stereocal.compiled import FloatArray
from stereocal.errors import StereocalError

CAMERA_FORMAT = "stereocal-camera/1"
LARGEST_BYTES = 4_000_000
MOST_VALUES = 100
DEEPEST = 50
"""OpenCV's parser calls itself for every level, and ends the whole program when there are many."""
K_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M")
DISTORTION_NAMES = (
    "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D",
)  # fmt: skip
WIDTH_NAMES = ("image_width", "image_Width", "width")
HEIGHT_NAMES = ("image_height", "image_Height", "height")
EXPECTED = (
    "stereocal reads its own JSON, and OpenCV's YAML, XML or JSON with camera_matrix, "
    "distortion_coefficients, image_width and image_height"
)


def read_camera(content: bytes, source: str) -> Camera:
    """The camera of a file, whose format is told by its content.

    Raises:
        StereocalError: an empty file, an unknown format, or a camera that cannot be.
    """
    if not content.strip():
        raise StereocalError(f"{source}: the file is empty.")
    if len(content) > LARGEST_BYTES:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a camera file.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a camera file; {EXPECTED}.") from error
    start = text.lstrip()
    if start.startswith("{"):
        data = _json_object(text, source)
        if str(data.get("format", "")).startswith("stereocal-camera"):
            if data["format"] != CAMERA_FORMAT:
                raise StereocalError(
                    f"{source}: the format {data['format']!r} is not known; "
                    f'this version reads "{CAMERA_FORMAT}".'
                )
            return Camera.from_json(data, source)
    elif not start.startswith(("%YAML", "<?xml")):
        raise StereocalError(f"{source}: the format of the camera file is not known; {EXPECTED}.")
    return _read_file_storage(start, source)


def write_camera(camera: Camera, about: Mapping[str, Any] | None = None) -> bytes:
    """Our JSON file of a camera, with its uncertainty if it has one.

    Args:
        about: how the camera was found; further keys of the file, which readers let pass.
    """
    content: dict[str, Any] = {"format": CAMERA_FORMAT, **camera.to_json()}
    if camera.uncertainty is not None:
        content["uncertainty"] = camera.uncertainty.to_json()
    if about:
        content["about"] = dict(about)
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def write_opencv_camera(camera: Camera) -> bytes:
    """OpenCV's YAML file of a camera, as its calibration program names things.

    Its format has no place for skew, which stays in the matrix, and none for uncertainties.
    """
    # OpenCV 5 writes YAML 1.2 unless asked; version 4 knows only the old header and cannot ask.
    yaml = getattr(cv2, "FILE_STORAGE_FORMAT_YAML_1_0", cv2.FILE_STORAGE_FORMAT_YAML)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | yaml)
    width, height = camera.image_size
    storage.write("image_width", width)
    storage.write("image_height", height)
    storage.write("camera_matrix", camera.K.copy())
    storage.write("distortion_coefficients", camera.distortion.reshape(1, -1).copy())
    return str(storage.releaseAndGetString()).encode()


def _json_object(text: str, source: str) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StereocalError(f"{source}: this is not valid JSON ({error}).") from error
    return dict(data)


def _read_file_storage(text: str, source: str) -> Camera:
    if _depth(text) > DEEPEST:
        raise StereocalError(f"{source}: this is not a camera file, it is nested too deeply.")
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise StereocalError(
            f"{source}: OpenCV cannot read this file; it is cut off or damaged."
        ) from error
    try:
        K = _matrix(storage, K_NAMES, source)
        distortion = _matrix(storage, DISTORTION_NAMES, source)
        width = _number(storage, WIDTH_NAMES, source)
        height = _number(storage, HEIGHT_NAMES, source)
    except cv2.error as error:
        raise StereocalError(f"{source}: a matrix in this file is damaged.") from error
    finally:
        storage.release()
    try:
        return Camera(K, distortion, (int(width), int(height)))
    except (StereocalError, ValueError, OverflowError) as error:
        raise StereocalError(f"{source}: {error}") from error


def _depth(text: str) -> int:
    """At least as many levels as the brackets, tags and dashes of a file are nested in."""
    depth = deepest = 0
    for mark in re.finditer(r"[\[{]|[\]}]|</|/>|<(?=\w)|(?:-[ \t]+){50}", text):
        depth += -1 if mark[0] in ("]", "}", "</", "/>") else 1
        depth += DEEPEST if mark[0].startswith("-") else 0
        deepest = max(deepest, depth)
    return deepest


def _node(storage: Any, names: tuple[str, ...], source: str) -> Any:
    for name in names:
        node = storage.getNode(name)
        if not node.empty():
            return node
    raise StereocalError(f"{source}: {names[0]} is missing; {EXPECTED}.")


def _matrix(storage: Any, names: tuple[str, ...], source: str) -> FloatArray:
    """The numbers of an OpenCV matrix, (rows, cols).

    Read one by one: `FileNode.mat()` of OpenCV 5.0 writes past its memory, and ends the whole
    program, where rows or cols are missing or negative.
    """
    node = _node(storage, names, source)
    rows, cols, data = (
        node.getNode(key) if node.isMap() else None for key in ("rows", "cols", "data")
    )
    if rows is None or cols is None or data is None or not (rows.isInt() and cols.isInt()):
        raise StereocalError(f"{source}: {names[0]} is not a matrix (!!opencv-matrix).")
    shape = (int(rows.real()), int(cols.real()))
    values = [data.at(i) for i in range(min(data.size(), MOST_VALUES))] if data.isSeq() else []
    if min(shape) < 0 or shape[0] * shape[1] != len(values):
        raise StereocalError(f"{source}: {names[0]} does not hold the numbers of a matrix.")
    if not all(value.isInt() or value.isReal() for value in values):
        raise StereocalError(f"{source}: {names[0]} holds something that is not a number.")
    return np.array([value.real() for value in values], dtype=np.float64).reshape(shape)


def _number(storage: Any, names: tuple[str, ...], source: str) -> float:
    node = _node(storage, names, source)
    if not (node.isInt() or node.isReal()):
        raise StereocalError(f"{source}: {names[0]} is not a number.")
    return float(node.real())
