"""Recognise camera files of other programs by their content, and take two cameras from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import ArchiveOptions, CameraPair
from stereocal.formats.archives.chains import (
    kalibr_names,
    read_chain,
    read_sections,
    toml_sections,
)
from stereocal.formats.archives.matlab_stereo import read_stereo_struct
from stereocal.formats.camera_file import K_NAMES, read_camera
from stereocal.formats.exchange.aniposelib import read_toml
from stereocal.formats.exchange.exchange import FORMATS
from stereocal.formats.exchange.opencv_stereo import NAMES
from stereocal.formats.exchange.options import ExchangeOptions, text_of
from stereocal.formats.exchange.ros import ros_camera
from stereocal.formats.file_storage import Storage, find_node, read_storage
from stereocal.formats.other_files import is_matlab
from stereocal.formats.yaml_text import read_yaml
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters

Kind = Literal["camera", "ros", "opencv", "kalibr", "toml", "matlab", "script", "parameters"]
OF_ONE_CAMERA = ("camera", "ros")
"""Kinds of which each file has one camera, or OpenCV's two files have both."""
Files = Mapping[str, bytes]


def camera_kind(name: str, content: bytes) -> Kind | None:
    """The kind of a camera file; None if it is none.

    Raises:
        StereocalError: it looks like one, but is damaged.
    """
    if is_matlab(content):
        return "matlab"
    lower = name.lower()
    if lower.endswith(".m"):
        return "script"
    if lower.endswith(".toml"):
        return "toml"
    if lower.endswith((".yaml", ".yml", ".xml", ".json")):
        return _kind_of(_storage(name, content), lower)
    return None


def has_both_cameras(kind: Kind | None) -> bool:
    """Whether a single file of this kind has both cameras."""
    return kind is not None and kind not in OF_ONE_CAMERA


def camera_names(name: str, content: bytes) -> tuple[str, ...]:
    """Names of the cameras in a file with any number of them; empty for other kinds."""
    kind = camera_kind(name, content)
    if kind == "kalibr":
        return kalibr_names(_storage(name, content))
    if kind == "toml":
        return tuple(toml_sections(read_toml(text_of(content, name), name)))
    return ()


def read_camera_pair(files: Files, options: ArchiveOptions) -> CameraPair:
    """Two cameras from the files of one program.

    A single file with one camera serves for both: a nominal lens.

    Raises:
        StereocalError: files of several programs, too many, or damaged.
    """
    kinds = {name: camera_kind(name, content) for name, content in files.items()}
    source = ", ".join(files)
    if len(set(kinds.values())) > 1 or None in kinds.values():
        named = ", ".join(f"{name} ({kind or 'unknown'})" for name, kind in kinds.items())
        raise StereocalError(
            f"These camera files are not of one program: {named}. Give both cameras in one format."
        )
    kind = next(iter(kinds.values()))
    exchange = ExchangeOptions(
        (options.image_size, options.image_size), unit=options.unit, lens_model=options.lens_model
    )
    if kind in OF_ONE_CAMERA:
        return _of_single_files(files, kind, exchange)
    if kind == "opencv":
        return _of_opencv(files, exchange, source)
    if len(files) > 1:
        raise StereocalError(f"{source}: one file with both cameras is expected, not {len(files)}.")
    ((name, content),) = files.items()
    if kind == "matlab":
        return read_stereo_struct(content, name)
    if kind == "kalibr":
        return read_chain(_storage(name, content), options.cameras, exchange, name)
    if kind == "toml":
        data = read_toml(text_of(content, name), name)
        return read_sections(data, options.cameras, exchange, name)
    if kind == "parameters":
        rig = RigParameters.loads(text_of(content, name), name)
        return CameraPair("stereocal", rig.primary, rig.secondary, rig.pose, "", stated="m")
    return _of_format("matlab", files, exchange, source)


def _of_format(format_name: str, files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    known = FORMATS[format_name]
    rig, unit = known.read(files, options, source)
    return CameraPair(
        known.title, rig.primary, rig.secondary, rig.pose, "", stated=unit, usual=known.unit
    )


def _of_single_files(files: Files, kind: Kind | None, options: ExchangeOptions) -> CameraPair:
    if len(files) > 2:
        raise StereocalError(f"{', '.join(files)}: {len(files)} camera files; give one or two.")
    if kind == "ros" and len(files) == 2:
        try:
            return _of_format("ros", files, options, ", ".join(files))
        except StereocalError:  # cameras that were calibrated one by one
            pass
    cameras = [
        _single(name, content, kind, k, options) for k, (name, content) in enumerate(files.items())
    ]
    words = "one lens for both cameras" if len(cameras) == 1 else "primary first"
    return CameraPair("camera files", cameras[0], cameras[-1], None, words)


def _single(
    name: str, content: bytes, kind: Kind | None, k: int, options: ExchangeOptions
) -> Camera:
    if kind == "ros":
        return ros_camera(name, _storage(name, content), k, options)
    return read_camera(content, name, options.lens_model)


def _of_opencv(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Both cameras of intrinsics.yml; their pose if there is an extrinsics.yml."""
    storages = [_storage(name, content) for name, content in files.items()]
    has_pose = all(any(find_node(each, (key,)) for each in storages) for key in ("R", "T"))
    if has_pose:
        return _of_format("opencv", files, options, source)
    still = b"%YAML:1.0\n---\nR: [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]\nT: [1.0, 0.0, 0.0]\n"
    found = _of_format("opencv", {**files, "no-extrinsics.yml": still}, options, source)
    return replace(found, pose=None)


def _storage(name: str, content: bytes) -> Storage:
    text = text_of(content, name)
    start = text.lstrip()
    if start.startswith(("{", "<", "%YAML")):
        return read_storage(text, name)
    return read_yaml(text, name)


def _kind_of(data: Mapping[str, Any], lower: str) -> Kind | None:
    stated = str(data.get("format", ""))
    if stated.startswith("stereocal-"):
        known: dict[str, Kind] = {"parameters": "parameters", "camera": "camera"}
        return known.get(stated.split("/")[0].removeprefix("stereocal-"))
    if kalibr_names(data) and not lower.endswith(".json"):
        return "kalibr"
    if find_node(data, K_NAMES) is not None:
        return "ros" if "projection_matrix" in data and "distortion_model" in data else "camera"
    if any(find_node(data, names) is not None for names in NAMES.values()):
        return "opencv"
    return None
