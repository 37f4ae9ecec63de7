"""aniposelib's TOML: each camera's pose from the world; our world frame is the primary's."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import (
    ExchangeOptions,
    ReadRig,
    array_of,
    header,
    numbers,
    only_file,
    size_of,
)
from stereocal.formats.lens_model import check_lens_model
from stereocal.formats.yaml_text import check_length
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.json_text import check_depth

MOST_DOTS = 100
"""In one key. The parser keeps every beginning of a dotted key: 20,000 parts took 1.5 GB."""
BETWEEN_KEYS = re.compile(r"[,=\[\]{}\n]")


def write_aniposelib(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`calibration.toml`.

    Raises:
        StereocalError: a lens with more than five coefficients.
    """
    text = header(
        "#",
        "The world is the frame of the primary camera, cam_0. rotation: rotation vector, radians.",
        "size: width, height; the centre of the top-left pixel is (0, 0).",
    )
    turn, _jacobian = cv2.Rodrigues(rig.pose.R)
    for k, (which, camera, rotation, translation) in enumerate(
        (
            ("primary", rig.primary, np.zeros(3), np.zeros(3)),
            ("secondary", rig.secondary, np.asarray(turn, np.float64), rig.pose.T),
        )
    ):
        text += (
            f'\n[cam_{k}]\nname = "{which}"\n'
            f"size = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"matrix = [{', '.join(numbers(row) for row in camera.K)}]\n"
            f"distortions = {numbers(lens(camera, 5, which, 'aniposelib'))}\n"
            f"rotation = {numbers(rotation)}\ntranslation = {numbers(translation)}\n"
        )
    return {"calibration.toml": (text + "\n[metadata]\nadjusted = false\n").encode()}


def read_aniposelib(files: Mapping[str, bytes], options: ExchangeOptions, source: str) -> ReadRig:
    """Two cameras and their pose; the cameras are in the order of the section names.

    Raises:
        StereocalError: not two cameras, a fisheye lens, or a number is missing.
    """
    name, text = only_file(files, (".toml",), source)
    data = read_toml(text, name)
    sections = sorted(key for key in data if key != "metadata" and isinstance(data[key], dict))
    if len(sections) != 2:
        raise StereocalError(f"{name}: two cameras are expected; the file has {len(sections)}.")
    primary, secondary = (
        toml_camera(data[key], k, options, f"{name}, {key}") for k, key in enumerate(sections)
    )
    first, second = (toml_pose(data[key], f"{name}, {key}") for key in sections)
    return Rig(primary, secondary, second @ first.inverse()), None


def read_toml(text: str, name: str) -> dict[str, Any]:
    """The content of a TOML file.

    Raises:
        StereocalError: not TOML, too long, nested too deeply, or a key with too many parts.
    """
    check_length(text, name)
    check_depth(text, name)
    if any(piece.count(".") > MOST_DOTS for piece in BETWEEN_KEYS.split(text)):
        raise StereocalError(f"{name}: a key has more than {MOST_DOTS} parts; it is not read.")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of too many digits is a ValueError
        raise StereocalError(f"{name}: this is not valid TOML ({error}).") from error


def toml_camera(data: Mapping[str, Any], k: int, options: ExchangeOptions, source: str) -> Camera:
    """The camera of a section; `k` is 0 for the primary.

    Raises:
        StereocalError: a fisheye lens, or a number is missing.
    """
    coefficients = array_of(data.get("distortions"), (-1,), "distortions", source)
    check_lens_model(coefficients, data.get("fisheye"), options.lens_model, source)
    which = CAMERAS[k]
    size = size_of(data.get("size"), options.image_sizes[k], which, source)
    try:
        return Camera(
            array_of(data.get("matrix"), (3, 3), "matrix", source),
            coefficients,
            size,
        )
    except StereocalError as error:
        text = str(error)
        raise StereocalError(text if source in text else f"{source}: {text}") from error


def toml_pose(data: Mapping[str, Any], source: str) -> Pose:
    """The pose of a section, camera from world; a rotation vector, or Caliscope's matrix.

    Raises:
        StereocalError: a number is missing, or the matrix is not a rotation.
    """
    stated = array_of(data.get("rotation"), (-1,), "rotation", source)
    translation = array_of(data.get("translation"), (3,), "translation", source)
    if stated.size == 9:
        return Pose(stated.reshape(3, 3), translation)
    turn, _ = cv2.Rodrigues(array_of(stated, (3,), "rotation", source))
    return Pose(np.asarray(turn, dtype=np.float64), translation)
