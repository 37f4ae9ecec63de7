"""Camera files: our JSON (`stereocal-camera/1`) and OpenCV FileStorage (YAML, XML, JSON).

Four coefficients may be OpenCV's standard lens model (k1 k2 p1 p2) or its fisheye model
(k1 k2 k3 k4); if the file does not state which, the user must.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError, naming
from stereocal.formats.described import only_camera, only_of
from stereocal.formats.file_storage import ForeignFile, Storage, find_node, matrix_of
from stereocal.formats.lens_nodes import (
    DISTORTION_NAMES,
    K_NAMES,
    as_lens,
    cameras_among,
    image_size_in,
    nodes_of_all,
    stated_lens_model,
    what_is_in,
)
from stereocal.formats.other_files import refuse_other_camera
from stereocal.rig.camera import Camera, LensModel, LensUncertainty
from stereocal.system.arguments import checked
from stereocal.system.array_types import FloatArray
from stereocal.system.dialect import encoding_of
from stereocal.system.zip_files import is_npz

CAMERA_FORMAT = "stereocal-camera/1"
EXPECTED = (
    "stereocal reads its own JSON, and OpenCV's YAML, XML or JSON with camera_matrix, "
    "distortion_coefficients, image_width and image_height"
)
BEGINS = re.compile(r"\{|<|%YAML|---|#|[\w\"'][\w \"'.-]*:(\s|$)", re.ASCII)
"""The first characters of a JSON, XML or YAML file."""


ImageSize = tuple[int, int]


class ImageSizeError(StereocalError):
    """A camera whose image size is not stated."""

    def __init__(self, source: str, of: str = "", sizes: Sequence[ImageSize] = ()) -> None:
        self.question = f"{source}: the file does not state the size of the images{of}."
        remedy, known = "Write image_width and image_height into the file.", ["1920x1080"]
        if sizes:
            known = [f"{width}x{height}" for width, height in sizes]
            self.question = f"{source}: the file has lenses for images of {' or '.join(known)} px."
            remedy = "State the size of yours."
        option = f"--image-size WxH, as --image-size {known[0]}"
        super().__init__(f"{self.question} {remedy}", option=option)


class FourCoefficientsError(StereocalError):
    """A lens with four coefficients whose model is not stated."""

    def __init__(self, source: str) -> None:
        self.question = (
            f"{source}: the lens has 4 distortion coefficients, and the file does not say whether "
            "they are k1 k2 p1 p2 (OpenCV's usual lens) or k1 k2 k3 k4 (its fisheye)."
        )
        super().__init__(
            f"{self.question} Write distortion_model: plumb_bob or equidistant into the file.",
            option="--lens-model brown or fisheye",
        )


def five_or_more(coefficients: FloatArray) -> FloatArray:
    """The coefficients with at least k3 = 0 appended, so that they do not look like a fisheye's."""
    return np.append(coefficients, np.zeros(max(5 - coefficients.size, 0)))


def lens_model_of(
    coefficients: FloatArray, is_fisheye: object, by_user: LensModel | None, source: str
) -> LensModel:
    """The model of a lens in a file.

    Args:
        is_fisheye: as the file states it; None if it does not.
        by_user: the model that the user states, which counts if the file states none.

    Raises:
        FourCoefficientsError: four coefficients of an unstated model.
    """
    if is_fisheye in (True, False):
        return "fisheye" if is_fisheye else "brown"
    if by_user is None and coefficients.size == 4 and coefficients.any():
        raise FourCoefficientsError(source)
    return by_user or "brown"


def agreed_size(
    stated: tuple[int, int] | None, by_user: tuple[int, int] | None, source: str, of: str = ""
) -> tuple[int, int]:
    """The image size as the file states it, or else the user.

    Args:
        of: whose images, as " of the primary camera".

    Raises:
        ImageSizeError: neither states it.
        StereocalError: they contradict each other.
    """
    if (size := stated or by_user) is None:
        raise ImageSizeError(source, of)
    if by_user is not None and by_user != size:
        raise StereocalError(
            f"the images{of} have {size[0]}x{size[1]} px in the file, but "
            f"{by_user[0]}x{by_user[1]} px were entered.",
            source,
        )
    return size


@checked
def read_camera(
    content: bytes | str | Path,
    source: str = "",
    lens_model: LensModel | None = None,
    image_size: tuple[int, int] | None = None,
) -> Camera:
    """The camera in a file; the format is determined from the content.

    Args:
        content: the file's bytes; or its path.
        source: what messages call the file; empty: its path.
        lens_model: meaning of four coefficients if the file does not state it.
        image_size: of its images if the file does not state it.

    Raises:
        FourCoefficientsError: four coefficients that may be those of a fisheye.
        ImageSizeError: the image size is not stated.
        StereocalError: an empty file, an unknown format, or an invalid camera.
    """
    if not isinstance(content, bytes):
        source = source or str(content)
        if not Path(content).is_file():
            raise StereocalError(f"{content}: there is no such file.")
        content = Path(content).read_bytes()
    file = ForeignFile(source, content)
    storage = only_camera(file)
    if storage is None:
        refuse_other_camera(content, source)
        start = content.decode(encoding_of(content), errors="replace").lstrip()
        if start and not BEGINS.match(start) and not is_npz(content):
            raise StereocalError(
                f"{source}: the format of the camera file is not known; {EXPECTED}."
            )
        storage = _only_lens(file.storage, source)
    if str(storage.get("format", "")).startswith("stereocal-camera"):
        if storage["format"] != CAMERA_FORMAT:
            raise StereocalError(
                f"{source}: the format {storage['format']!r} is not known; "
                f'this version reads "{CAMERA_FORMAT}".'
            )
        return Camera.from_json(storage, source)
    return camera_of(storage, source, lens_model, image_size)


def _only_lens(storage: Storage, source: str) -> Storage:
    """The nodes of the only camera in a file: the file's own, or those of a part of it."""
    if "format" in storage or "camera_matrix" in as_lens(storage):
        return storage
    if cameras := cameras_among(storage):
        return only_of(cameras, source)
    of_all = nodes_of_all(storage)
    return of_all if "camera_matrix" in as_lens(of_all) else storage


def camera_of(
    storage: Storage,
    source: str,
    lens_model: LensModel | None,
    image_size: ImageSize | None,
    whole: Storage | None = None,
) -> Camera:
    """The camera that nodes of a file describe; arguments as for `read_camera`.

    Args:
        whole: all nodes of the file, for errors.
    """
    storage = _of_size(storage, source, image_size)
    storage, whole = as_lens(storage), storage if whole is None else whole
    K = matrix_of(_node(storage, K_NAMES, source, whole), K_NAMES[0], source)
    lens = _node(storage, DISTORTION_NAMES, source, whole)
    distortion = matrix_of(lens, DISTORTION_NAMES[0], source)
    _refuse_part_of_sensor(storage, source)
    size = agreed_size(image_size_in(storage, source), image_size, source)
    stated = storage.get("uncertainty")
    K = K.reshape(3, 3) if K.size == 9 else K
    try:
        uncertainty = None if stated is None else LensUncertainty.from_json(stated)
        camera = Camera(K, distortion.ravel(), size, uncertainty)
    except (ValueError, OverflowError) as error:  # of a StereocalError too
        raise StereocalError(f"{source}: {error}") from error
    is_fisheye = stated_lens_model(storage, source)
    model = lens_model_of(camera.distortion, is_fisheye, lens_model, source)
    with naming(source):
        return replace(camera, model=model)


def _of_size(storage: Storage, source: str, image_size: ImageSize | None) -> Storage:
    """The nodes for images of this size, of a file that has several."""
    modes = storage.get("modes")
    if not isinstance(modes, dict) or not all(isinstance(size, tuple) for size in modes):
        return storage
    if image_size not in modes and (image_size is not None or len(modes) > 1):
        raise ImageSizeError(source, sizes=[*modes])
    chosen: Storage = modes[image_size or next(iter(modes))]
    return chosen


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


def refuse_window(camera: Camera, which: str, program: str) -> None:
    """Refuse to write a camera behind a window for a program: to it, it would be one in air."""
    if camera.window is not None:
        raise StereocalError(
            f"{which} looks through a window, which {program} does not know: its points would be "
            "wrong, and nothing is written. Use stereocal's own JSON files."
        )


def write_opencv_camera(camera: Camera) -> bytes:
    """OpenCV's YAML file of a camera, with the names of its calibration program.

    Uncertainties are not written. Four coefficients of a usual lens get a fifth, k3 = 0, since
    four alone might be those of a fisheye.
    """
    refuse_window(camera, "The camera", "OpenCV")
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


def _refuse_part_of_sensor(storage: Storage, source: str) -> None:
    """Refuse a ROS message whose matrix is not of the images, but of the whole sensor."""
    binned = [storage.get(f"binning_{axis}") for axis in "xy"]
    roi = storage.get("roi")
    cut = [roi.get(f"{axis}_offset") for axis in "xy"] if isinstance(roi, dict) else []
    if any(isinstance(factor, int) and factor > 1 for factor in binned) or any(cut):
        raise StereocalError(
            f"{source}: its numbers are of the whole sensor, but its images are binned or cut "
            "(binning_x, binning_y, roi): give those of the images, with binning 1 and without roi."
        )


def _node(storage: Storage, names: tuple[str, ...], source: str, whole: Storage) -> Any:
    node = find_node(storage, names)
    if node is None:
        raise StereocalError(f"{source}: {names[0]} is missing ({what_is_in(whole)}); {EXPECTED}.")
    return node
