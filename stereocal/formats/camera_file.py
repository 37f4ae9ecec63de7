"""Camera files: our JSON (`stereocal-camera/1`) and OpenCV FileStorage (YAML, XML, JSON)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2

from stereocal.errors import StereocalError, naming
from stereocal.formats.file_storage import (
    Storage,
    find_node,
    is_number,
    matrix_of,
    read_storage,
    stated_lens_model,
)
from stereocal.formats.lens_model import five_or_more, lens_model_of
from stereocal.formats.other_files import refuse_other_camera
from stereocal.rig.camera import Camera, LensModel

CAMERA_FORMAT = "stereocal-camera/1"
LARGEST_BYTES = 4_000_000
K_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M")
DISTORTION_NAMES = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "D",
)
SIZE_NAMES = ("image_size", "imageSize", "resolution")
WIDTH_NAMES = ("image_width", "image_Width", "width")
HEIGHT_NAMES = ("image_height", "image_Height", "height")
EXPECTED = (
    "stereocal reads its own JSON, and OpenCV's YAML, XML or JSON with camera_matrix, "
    "distortion_coefficients, image_width and image_height"
)


def read_camera(content: bytes, source: str, lens_model: LensModel | None = None) -> Camera:
    """The camera in a file; the format is determined from the content.

    Args:
        lens_model: meaning of four coefficients if the file does not state it.

    Raises:
        FourCoefficientsError: four coefficients that may be those of a fisheye.
        StereocalError: an empty file, an unknown format, or an invalid camera.
    """
    if not content.strip():
        raise StereocalError(f"{source}: the file is empty.")
    if len(content) > LARGEST_BYTES:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a camera file.")
    refuse_other_camera(content, source)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a camera file; {EXPECTED}.") from error
    start = text.lstrip()
    if not start.startswith(("{", "%YAML", "<?xml")):
        raise StereocalError(f"{source}: the format of the camera file is not known; {EXPECTED}.")
    storage = read_storage(text, source)
    if str(storage.get("format", "")).startswith("stereocal-camera"):
        if storage["format"] != CAMERA_FORMAT:
            raise StereocalError(
                f"{source}: the format {storage['format']!r} is not known; "
                f'this version reads "{CAMERA_FORMAT}".'
            )
        return Camera.from_json(storage, source)
    if start.startswith("{") and isinstance(find_node(storage, K_NAMES), list):
        return _read_nested_lists(storage, source, lens_model)
    return _read_matrices(storage, source, lens_model)


def write_camera(camera: Camera, about: Mapping[str, Any] | None = None) -> bytes:
    """Our JSON file of a camera, with its uncertainty if known.

    Args:
        about: how the camera was calibrated; readers ignore it.
    """
    content: dict[str, Any] = {"format": CAMERA_FORMAT, **camera.to_json()}
    if camera.uncertainty is not None:
        content["uncertainty"] = camera.uncertainty.to_json()
    if about:
        content["about"] = dict(about)
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def write_opencv_camera(camera: Camera) -> bytes:
    """OpenCV's YAML file of a camera, with the names of its calibration program.

    Uncertainties are not written. Four coefficients of a usual lens get a fifth, k3 = 0, since
    four alone might be those of a fisheye.
    """
    # OpenCV 5 writes YAML 1.2 by default; version 4 reads 1.0 only and has no such flag.
    yaml = getattr(cv2, "FILE_STORAGE_FORMAT_YAML_1_0", cv2.FILE_STORAGE_FORMAT_YAML)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | yaml)
    width, height = camera.image_size
    storage.write("image_width", width)
    storage.write("image_height", height)
    storage.write("camera_matrix", camera.K.copy())
    if camera.is_fisheye:
        storage.write("fisheye_model", 1)
    coefficients = camera.distortion if camera.is_fisheye else five_or_more(camera.distortion)
    storage.write("distortion_coefficients", coefficients.reshape(1, -1).copy())
    return str(storage.releaseAndGetString()).encode()


def _read_nested_lists(storage: Storage, source: str, lens_model: LensModel | None) -> Camera:
    """A camera given as nested lists, with our names or OpenCV's."""
    size = find_node(storage, SIZE_NAMES) or [
        find_node(storage, WIDTH_NAMES),
        find_node(storage, HEIGHT_NAMES),
    ]
    distortion = find_node(storage, ("distortion", *DISTORTION_NAMES))
    if distortion is None or (isinstance(size, list) and None in size):
        what = "distortion" if distortion is None else "image_size"
        raise StereocalError(f"{source}: {what} is missing; {EXPECTED}.")
    named = {"K": find_node(storage, K_NAMES), "distortion": distortion, "image_size": size}
    stated = storage.get("distortion_model", storage.get("fisheye_model", storage.get("model")))
    stated = bool(stated) if isinstance(stated, int) else stated
    camera = Camera.from_json({**storage, **named, "model": "brown"}, source)
    model = lens_model_of(camera.distortion, stated, lens_model, source)
    with naming(source):
        return replace(camera, model=model)


def _read_matrices(storage: Storage, source: str, lens_model: LensModel | None) -> Camera:
    """A camera given as OpenCV matrices."""
    K = matrix_of(_node(storage, K_NAMES, source), K_NAMES[0], source)
    distortion = matrix_of(_node(storage, DISTORTION_NAMES, source), DISTORTION_NAMES[0], source)
    size = [_node(storage, names, source) for names in (WIDTH_NAMES, HEIGHT_NAMES)]
    for side, names in zip(size, (WIDTH_NAMES, HEIGHT_NAMES), strict=True):
        if not is_number(side):
            raise StereocalError(f"{source}: {names[0]} is not a number.")
    K = K.reshape(3, 3) if K.size == 9 else K
    try:
        camera = Camera(K, distortion, (int(size[0]), int(size[1])))
    except (ValueError, OverflowError) as error:  # of a StereocalError too
        raise StereocalError(f"{source}: {error}") from error
    model = lens_model_of(camera.distortion, stated_lens_model(storage), lens_model, source)
    with naming(source):
        return replace(camera, model=model)


def _node(storage: Storage, names: tuple[str, ...], source: str) -> Any:
    node = find_node(storage, names)
    if node is None:
        raise StereocalError(f"{source}: {names[0]} is missing; {EXPECTED}.")
    return node
