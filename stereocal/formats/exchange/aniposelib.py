"""aniposelib's and Caliscope's TOML: each camera's pose from the world, our primary's frame."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from scipy.spatial.transform import Rotation

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
from stereocal.rig.geometry import Pose
from stereocal.system.json_text import check_depth

MOST_DOTS = 100
"""In one key. The parser keeps every beginning of a dotted key: 20,000 parts took 1.5 GB."""
BETWEEN_KEYS = re.compile(r"[,=\[\]{}\n]")


def write_aniposelib(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`calibration.toml`."""
    text = _header(cameras)
    for k, own in enumerate(cameras):
        text += f"\n[cam_{k}]\nname = {json.dumps(own[0])}\n"
        text += "fisheye = true\n" * own[1].is_fisheye + _values(own, "aniposelib")
    return {"calibration.toml": (text + "\n[metadata]\nadjusted = false\n").encode()}


def write_caliscope(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`camera_array.toml`, where the names of cameras are numbers."""
    text = _header(cameras)
    for k, own in enumerate(cameras):
        text += f"\n# {json.dumps(own[0])}\n[cameras.{k}]\ncam_id = {k}\nrotation_count = 0\n"
        text += f"fisheye = {json.dumps(own[1].is_fisheye)}\n{_values(own, 'Caliscope')}"
    return {"camera_array.toml": text.encode()}


def _header(cameras: Sequence[Posed]) -> str:
    return header(
        "#",
        f"The world is the frame of the {cameras[0][0]} camera, the first. rotation: rotation "
        "vector, radians.",
        "size: width, height; the centre of the top-left pixel is (0, 0).",
    )


def _values(own: Posed, program: str) -> str:
    """What both programs write of a camera."""
    which, camera, pose = own
    distortion = camera.distortion if camera.is_fisheye else lens(camera, 5, which, program)
    return (
        f"size = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
        f"matrix = [{', '.join(numbers(row) for row in camera.K)}]\n"
        f"distortions = {numbers(distortion)}\n"
        f"rotation = {numbers(Rotation.from_matrix(pose.R).as_rotvec())}\n"
        f"translation = {numbers(pose.T)}\n"
    )


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


def _pose(data: Mapping[str, Any], source: str) -> Pose:
    """Camera from world; a rotation vector, or Caliscope's matrix."""
    rotation = array_of(data.get("rotation"), (-1,), "rotation", source)
    translation = array_of(data.get("translation"), (3,), "translation", source)
    if rotation.size == 9:
        return pose_of(rotation.reshape(3, 3), translation, source)
    turn = Rotation.from_rotvec(array_of(rotation, (3,), "rotation", source))
    return pose_of(turn.as_matrix(), translation, source)
