"""Camera files: our JSON (`stereocal-camera/1`) and OpenCV FileStorage (YAML, XML, JSON).

Four coefficients may be OpenCV's standard lens model (k1 k2 p1 p2) or its fisheye model
(k1 k2 k3 k4); if the file does not state which, the user must.
"""

import json
from codecs import BOM_UTF8
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError, naming
from stereocal.formats.file_storage import (
    ForeignFile,
    Storage,
    find_node,
    is_number,
    matrix_of,
    stated_lens_model,
)
from stereocal.formats.other_files import refuse_other_camera
from stereocal.rig.camera import Camera, LensModel, LensUncertainty
from stereocal.rig.compiled import FloatArray

CAMERA_FORMAT = "stereocal-camera/1"
K_NAMES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M")
DISTORTION_NAMES = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "D",
    "distortion",
)
SIZE_NAMES = ("image_size", "imageSize", "resolution")
WIDTH_NAMES = ("image_width", "image_Width", "width")
HEIGHT_NAMES = ("image_height", "image_Height", "height")
EXPECTED = (
    "stereocal reads its own JSON, and OpenCV's YAML, XML or JSON with camera_matrix, "
    "distortion_coefficients, image_width and image_height"
)
USUAL = ("brown", "plumb_bob", "radtan", "rational_polynomial", "pinhole", "opencv")
FISHEYE = ("fisheye", "equidistant", "equi", "kannala_brandt", "kannala_brandt4", "kb4")


class FourCoefficientsError(StereocalError):
    """A lens with four coefficients whose model is not stated."""

    def __init__(self, source: str) -> None:
        self.question = (
            f"{source}: the lens has 4 distortion coefficients, and the file does not say whether "
            "they are k1 k2 p1 p2 (OpenCV's usual lens) or k1 k2 k3 k4 (its fisheye)."
        )
        super().__init__(
            f"{self.question} Use --lens-model brown or fisheye, or write "
            "distortion_model: plumb_bob or equidistant into the file."
        )


def five_or_more(coefficients: FloatArray) -> FloatArray:
    """The coefficients with at least k3 = 0 appended, so that they do not look like a fisheye's."""
    return np.append(coefficients, np.zeros(max(5 - coefficients.size, 0)))


def lens_model_of(
    coefficients: FloatArray, stated: object, by_user: LensModel | None, source: str
) -> LensModel:
    """The model of a lens in a file.

    Args:
        stated: the file's name of its lens model, or whether it is a fisheye; None if not stated.
        by_user: the model that the user states, which counts if the file states none.

    Raises:
        FourCoefficientsError: four coefficients of an unstated model.
    """
    name = str(stated).strip().lower() if isinstance(stated, str) else ""
    if name in FISHEYE or stated is True:
        return "fisheye"
    if name in USUAL or stated is False:
        return "brown"
    if by_user is None and coefficients.size == 4 and coefficients.any():
        raise FourCoefficientsError(source)
    return by_user or "brown"


def read_camera(content: bytes, source: str, lens_model: LensModel | None = None) -> Camera:
    """The camera in a file; the format is determined from the content.

    Args:
        lens_model: meaning of four coefficients if the file does not state it.

    Raises:
        FourCoefficientsError: four coefficients that may be those of a fisheye.
        StereocalError: an empty file, an unknown format, or an invalid camera.
    """
    refuse_other_camera(content, source)
    file, start = ForeignFile(source, content), content.removeprefix(BOM_UTF8).lstrip()
    if start and not start.startswith((b"{", b"%YAML", b"<?xml")):
        raise StereocalError(f"{source}: the format of the camera file is not known; {EXPECTED}.")
    storage = file.storage
    if str(storage.get("format", "")).startswith("stereocal-camera"):
        if storage["format"] != CAMERA_FORMAT:
            raise StereocalError(
                f"{source}: the format {storage['format']!r} is not known; "
                f'this version reads "{CAMERA_FORMAT}".'
            )
        return Camera.from_json(storage, source)
    K = matrix_of(_node(storage, K_NAMES, source), K_NAMES[0], source)
    distortion = matrix_of(_node(storage, DISTORTION_NAMES, source), DISTORTION_NAMES[0], source)
    size = [find_node(storage, names) for names in (WIDTH_NAMES, HEIGHT_NAMES)]
    if None in size:
        size = _node(storage, SIZE_NAMES, source)
    if not isinstance(size, list) or len(size) != 2 or not all(map(is_number, size)):
        raise StereocalError(
            f"{source}: the image size, {str(size)[:60]}, is not a number for each side."
        )
    stated = storage.get("uncertainty")
    K = K.reshape(3, 3) if K.size == 9 else K
    try:
        uncertainty = None if stated is None else LensUncertainty.from_json(stated)
        camera = Camera(K, distortion.ravel(), (int(size[0]), int(size[1])), uncertainty)
    except (ValueError, OverflowError) as error:  # of a StereocalError too
        raise StereocalError(f"{source}: {error}") from error
    model = lens_model_of(camera.distortion, stated_lens_model(storage), lens_model, source)
    with naming(source):
        return replace(camera, model=model)


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


def _node(storage: Storage, names: tuple[str, ...], source: str) -> Any:
    node = find_node(storage, names)
    if node is None:
        raise StereocalError(f"{source}: {names[0]} is missing; {EXPECTED}.")
    return node
