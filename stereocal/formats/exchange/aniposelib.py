"""aniposelib's TOML: each camera's pose from the world; our world frame is the primary's."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, numbers
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_of,
    chosen_pair,
    only_file,
    pose_of,
    size_of,
)
from stereocal.formats.lens_model import lens_model_of
from stereocal.formats.yaml_text import check_length
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.json_text import check_depth

MOST_DOTS = 100
"""In one key. The parser keeps every beginning of a dotted key: 20,000 parts took 1.5 GB."""
BETWEEN_KEYS = re.compile(r"[,=\[\]{}\n]")


def write_aniposelib(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`calibration.toml`."""
    still = Pose(np.eye(3), np.zeros(3))
    posed = (("primary", rig.primary, still), ("secondary", rig.secondary, rig.pose))
    return write_aniposelib_rig(posed, _)


def write_aniposelib_rig(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """The same of any number of cameras, with their poses from the first."""
    first = cameras[0][0]
    text = header(
        "#",
        f"The world is the frame of the {first} camera, cam_0. rotation: rotation vector, radians.",
        "size: width, height; the centre of the top-left pixel is (0, 0).",
    )
    for k, (which, camera, pose) in enumerate(cameras):
        turn, _jacobian = cv2.Rodrigues(pose.R)
        rotation, translation = np.asarray(turn, np.float64), pose.T
        text += (
            f"\n[cam_{k}]\nname = {json.dumps(which)}\n"
            f"size = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"matrix = [{', '.join(numbers(row) for row in camera.K)}]\n"
            f"distortions = {numbers(_distortion(camera, which))}\n"
            + "fisheye = true\n" * camera.is_fisheye
            + f"rotation = {numbers(rotation)}\ntranslation = {numbers(translation)}\n"
        )
    return {"calibration.toml": (text + "\n[metadata]\nadjusted = false\n").encode()}


def read_aniposelib(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras of aniposelib's or Caliscope's file; the pose is known if both have one."""
    file = only_file(files, (".toml",), source)
    data = read_toml(file.text, file.name)
    sections = _sections(data)
    if not sections:
        raise StereocalError(
            "this TOML file has no cameras, as aniposelib's calibration.toml or Caliscope's "
            "camera_array.toml.",
            file.name,
        )
    chosen = chosen_pair(tuple(sections), options.cameras, file.name)
    taken = [(sections[name], f"{file.name}, {name}") for name in chosen.names]
    primary, secondary = (
        _camera(section, k, options, where) for k, (section, where) in enumerate(taken)
    )
    pose = None
    if all("rotation" in each and "translation" in each for each, _ in taken):
        first, second = (_pose(section, where) for section, where in taken)
        pose = second @ first.inverse()
    return CameraPair(
        primary,
        secondary,
        pose,
        f"{file.name}: a camera has no rotation and translation.",
        "Caliscope" if "cameras" in data or "charuco" in data else "aniposelib",
        chosen.words,
        chosen.cameras,
        chosen.remarks,
    )


def aniposelib_names(file: ForeignFile) -> tuple[str, ...]:
    """Names of the cameras."""
    return tuple(_sections(read_toml(file.text, file.name)))


def _sections(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras of aniposelib's `[cam_0]`, or of Caliscope's `[cameras.0]`, in their order.

    Cameras that Caliscope ignores are left out.
    """
    caliscope = data.get("cameras")
    found = caliscope if isinstance(caliscope, dict) else data
    return {
        key: found[key]
        for key in sorted(found, key=lambda key: (len(key), key))
        if isinstance(found[key], dict) and "matrix" in found[key] and not found[key].get("ignore")
    }


def read_toml(text: str, name: str) -> dict[str, Any]:
    """The content of a TOML file."""
    check_length(text, name)
    check_depth(text, name)
    if any(piece.count(".") > MOST_DOTS for piece in BETWEEN_KEYS.split(text)):
        raise StereocalError(f"{name}: a key has more than {MOST_DOTS} parts; it is not read.")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of too many digits is a ValueError
        raise StereocalError(f"{name}: this is not valid TOML ({error}).") from error


def _camera(data: Mapping[str, Any], k: int, options: ExchangeOptions, source: str) -> Camera:
    coefficients = array_of(data.get("distortions"), (-1,), "distortions", source)
    model = lens_model_of(coefficients, data.get("fisheye"), options.lens_model, source)
    K = array_of(data.get("matrix"), (3, 3), "matrix", source)
    size = size_of(data.get("size"), options, k, source)
    return camera_of(K, coefficients, size, source, model)


def _distortion(camera: Camera, which: str) -> FloatArray:
    return camera.distortion if camera.is_fisheye else lens(camera, 5, which, "aniposelib")


def _pose(data: Mapping[str, Any], source: str) -> Pose:
    """Camera from world; a rotation vector, or Caliscope's matrix."""
    rotation = array_of(data.get("rotation"), (-1,), "rotation", source)
    translation = array_of(data.get("translation"), (3,), "translation", source)
    if rotation.size == 9:
        return pose_of(rotation.reshape(3, 3), translation, source)
    turn, _ = cv2.Rodrigues(array_of(rotation, (3,), "rotation", source))
    return pose_of(turn, translation, source)
