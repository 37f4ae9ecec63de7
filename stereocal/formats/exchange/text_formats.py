"""Camera files as text: TOML (aniposelib, Caliscope), COLMAP's text model, Argus's profiles.

aniposelib and Caliscope state each camera's pose from the world, our primary's frame.

COLMAP's pixel origin is the corner of the first pixel, whose centre is (0.5, 0.5). Quaternions are
w x y z. The rig's frame is the primary's, so the secondary's `sensor_from_rig` is our pose.

Argus's `clicker_profile.txt` has a row for each camera, which begins with its number, the tables of
its lenses with a mode: number, focal length (px), width, height, cx, cy, aspect ratio, k1, k2, t1,
t2, k3.
"""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.formats.exchange.camera_format import (
    COEFFICIENTS,
    ONE_LENS,
    CameraFormat,
    ExchangeFormat,
    Files,
    ForeignPair,
    Posed,
    array_of,
    camera_from,
    camera_matrix,
    header,
    known_pose,
    number,
    numbers,
    only_file,
    pose_from,
    stated_unit,
)
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.file_storage import ForeignFile, check_text_length
from stereocal.formats.point_files import is_number_or_empty
from stereocal.rig.camera import FISHEYE_UNKNOWNS, Camera
from stereocal.rig.geometry import Pose
from stereocal.system.json_text import check_depth

MOST_DOTS = 100
"""In one key. The parser keeps every beginning of a dotted key: 20,000 parts took 1.5 GB."""
BETWEEN_KEYS = re.compile(r"[,=\[\]{}\n]")
_NUMBERS = r"(?:[-+\d.,\seE]|nan|inf)"
LONG_LIST = re.compile(rf"\[(?:{_NUMBERS}|\[{_NUMBERS}*\]){{4000,}}\]")
"""Numbers or points, as Caliscope writes all that it has adjusted: longer than any matrix."""
FIRST_PIXEL = 0.5
RATIONAL, FISHEYE = COEFFICIENTS[:8], FISHEYE_UNKNOWNS[4:]
MODELS: Mapping[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", *FISHEYE),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", *RATIONAL),
}
"""COLMAP's."""


def write_aniposelib(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`calibration.toml`."""
    text = _toml_header(cameras)
    for k, (name, camera, pose) in enumerate(cameras):
        text += f"\n[cam_{k}]\nname = {json.dumps(name)}\n"
        text += "fisheye = true\n" * camera.is_fisheye + _toml_values(camera, pose)
    return {"calibration.toml": (text + "\n[metadata]\nadjusted = false\n").encode()}


def write_caliscope(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`camera_array.toml`, where the names of cameras are numbers."""
    text = _toml_header(cameras)
    for k, (name, camera, pose) in enumerate(cameras):
        text += f"\n# {json.dumps(name)}\n[cameras.{k}]\ncam_id = {k}\nrotation_count = 0\n"
        text += f"fisheye = {json.dumps(camera.is_fisheye)}\n{_toml_values(camera, pose)}"
    return {"camera_array.toml": text.encode()}


def _toml_header(cameras: Sequence[Posed]) -> str:
    return header(
        "#",
        f"The world is the frame of the {cameras[0][0]} camera, the first. rotation: rotation "
        "vector, radians.",
        "size: width, height; the centre of the top-left pixel is (0, 0).",
    )


def _toml_values(camera: Camera, pose: Pose) -> str:
    """What both programs write of a camera."""
    return (
        f"size = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
        f"matrix = [{', '.join(numbers(row) for row in camera.K)}]\n"
        f"distortions = {numbers(camera.distortion)}\n"
        f"rotation = {numbers(Rotation.from_matrix(pose.R).as_rotvec())}\n"
        f"translation = {numbers(pose.T)}\n"
    )


def read_aniposelib(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
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
    chosen = chosen_pair(_called(sections), options.cameras, file.name, [*sections])
    cameras, posed = [], list[tuple[Any, Any, str]]()
    for k, name in enumerate(chosen.names):
        table, where = [*sections.values()][chosen.pair[k]], f"{file.name}, {name}"
        K, lens, fisheye = table.get("matrix"), table.get("distortions"), table.get("fisheye")
        cameras.append(camera_from(K, lens, table.get("size"), fisheye, options, k, where))
        if all(table.get(key) not in (None, "null") for key in ("rotation", "translation")):
            posed.append((table["rotation"], table["translation"], where))

    def second_from_first() -> Pose | None:
        return pose_from(*posed[1]) @ pose_from(*posed[0]).inverse() if len(posed) == 2 else None

    lacks = f"{file.name}: a camera has no rotation and translation."
    pose, no_pose, bad = known_pose(second_from_first, lacks)
    program = "Caliscope" if "cameras" in data or "charuco" in data else "aniposelib"
    pair = ForeignPair(cameras[0], cameras[1], pose, no_pose, program, chosen, notes=bad)
    return replace(pair, stated=stated_unit({**data.get("metadata", {}), **data}))


def _called(sections: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Each camera's `name`, or else the names of the sections."""
    names = [table["name"] for table in sections.values() if isinstance(table.get("name"), str)]
    return tuple(names if len({*names}) == len(sections) else sections)


def _sections(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras of aniposelib's `[cam_0]`, or of Caliscope's `[cameras.0]`, in their order.

    Cameras that Caliscope ignores are left out.
    """
    caliscope = data.get("cameras")
    tables = caliscope if isinstance(caliscope, dict) else data
    return {
        key: table
        for key, table in tables.items()
        if isinstance(table, dict) and "matrix" in table and not table.get("ignore")
    }


def read_toml(text: str, name: str) -> dict[str, Any]:
    """The content of a TOML file."""
    text = LONG_LIST.sub("[]", text)
    check_text_length(text, name)
    check_depth(text, name)
    if any(piece.count(".") > MOST_DOTS for piece in BETWEEN_KEYS.split(text)):
        raise StereocalError(f"{name}: a key has more than {MOST_DOTS} parts; it is not read.")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of too many digits is a ValueError
        raise StereocalError(f"{name}: this is not valid TOML ({error}).") from error


def write_colmap(two: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`cameras.txt` and `rigs.txt`, the other files of a model (empty), and `rig_config.json`."""
    comment = header(
        "#",
        "Camera 1 is the primary and the rig's frame, camera 2 the secondary.",
        "The centre of the top-left pixel is (0.5, 0.5).",
    )
    cameras = comment + "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    config: list[dict[str, Any]] = []
    for k, (which, camera, _pose) in enumerate(two, start=1):
        K, lens, model = camera.K, camera.distortion, "OPENCV_FISHEYE"
        if not camera.is_fisheye:
            lens = lens if lens[4:].any() else lens[:4]
            model = "FULL_OPENCV" if lens[4:].any() else "OPENCV"
        centre = K[0, 2] + FIRST_PIXEL, K[1, 2] + FIRST_PIXEL
        parameters = [float(value) for value in (K[0, 0], K[1, 1], *centre, *lens)]
        width, height = camera.image_size
        cameras += f"{k} {model} {width} {height} {' '.join(map(number, parameters))}\n"
        lens_entries = {"camera_model_name": model, "camera_params": parameters}
        config.append({"image_prefix": f"{which}/", **lens_entries})
    pose = two[1][2]
    quaternion = Rotation.from_matrix(pose.R).as_quat(scalar_first=True, canonical=True)
    moved = " ".join(number(value) for value in [*quaternion, *pose.T])
    rigs = comment + "#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as\n"
    rigs += "#   (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])\n"
    rigs += f"1 2 CAMERA 1 CAMERA 2 1 {moved}\n"
    config[0]["ref_sensor"] = True
    config[1]["cam_from_rig_rotation"] = quaternion.tolist()
    config[1]["cam_from_rig_translation"] = pose.T.tolist()
    empty = dict.fromkeys(("frames.txt", "images.txt", "points3D.txt"), comment.encode())
    return {
        "cameras.txt": cameras.encode(),
        "rigs.txt": rigs.encode(),
        **empty,
        "rig_config.json": (json.dumps([{"cameras": config}], indent=2) + "\n").encode(),
    }


def read_colmap(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """The two cameras of the only rig in `cameras.txt` and `rigs.txt`."""
    named = {file.name: file for file in files}
    for name in ("cameras.txt", "rigs.txt"):
        if name not in named:
            raise StereocalError(
                f"{source}: {name} is missing; use the folder of a sparse model as text "
                "(colmap model_converter --output_type TXT)."
            )
    cameras = {cells[0]: cells for cells in _rows(named["cameras.txt"])}
    rigs = _rows(named["rigs.txt"])
    if len(rigs) != 1 or len(rigs[0]) != 14 or rigs[0][1] != "2" or rigs[0][6] != "1":
        raise StereocalError("rigs.txt: one rig of two cameras with their pose is expected.")
    cells = rigs[0]
    if cells[3] not in cameras or cells[5] not in cameras:
        raise StereocalError("rigs.txt: the rig names a camera that is missing in cameras.txt.")
    values = array_of(cells[7:], (7,), "the pose", "rigs.txt")
    if not 1e-9 < np.abs(values[:4]).max() < 1e9:
        raise StereocalError("rigs.txt: the rotation is not a quaternion.")
    R = Rotation.from_quat(values[:4], scalar_first=True).as_matrix()
    first = _colmap_camera(cameras[cells[3]], options, 0)
    second = _colmap_camera(cameras[cells[5]], options, 1)
    return ForeignPair(first, second, pose_from(R, values[4:], "rigs.txt"))


def _colmap_camera(cells: list[str], options: ExchangeOptions, k: int) -> Camera:
    source = "cameras.txt"
    if len(cells) < 5:
        raise StereocalError(f"{source}: a camera has fewer than five entries.")
    model = cells[1]
    if model not in MODELS:
        raise StereocalError(
            f"{source}: the lens model {model} is not supported; use one of {', '.join(MODELS)}."
        )
    names = MODELS[model]
    values = array_of(cells[4:], (len(names),), f"the parameters of {model}", source)
    named = dict(zip(names, values.tolist(), strict=True))
    fx = named.get("fx", named.get("f", 0.0))
    K = camera_matrix(fx, named.get("fy", fx), named["cx"] - FIRST_PIXEL, named["cy"] - FIRST_PIXEL)
    fisheye = model == "OPENCV_FISHEYE"
    lens = [named.get(name, 0.0) for name in (FISHEYE if fisheye else RATIONAL)]
    return camera_from(K, lens, cells[2:4], fisheye, options, k, source)


def _rows(file: ForeignFile) -> list[list[str]]:
    lines = file.text.splitlines()
    return [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]


ANIPOSELIB = ExchangeFormat(
    "aniposelib (calibration.toml)",
    read_aniposelib,
    lambda file: file.ends_with(".toml"),
    lambda file: _called(_sections(read_toml(file.text, file.name))),
    write=write_aniposelib,
    of_rigs=True,
    skew="ignored",
    coefficients=5,
)
CALISCOPE = replace(
    ANIPOSELIB, title="Caliscope (camera_array.toml)", recognises=None, write=write_caliscope
)
COLMAP = ExchangeFormat(
    "COLMAP (rig)", read_colmap, write=write_colmap, skew="refused", coefficients=8
)


ENDINGS = (".txt", ".csv", ".tsv")
_SEPARATOR = re.compile(r"[,;\s]+")
NUMBERS = 11
"""In a row, after the camera."""
ASPECT = (0.5, 2.0)
"""Plausible fy / fx, which tells a profile from a table of points."""


def _profile_rows(file: ForeignFile) -> list[list[str]]:
    """The cells of each camera; empty if it is no profile."""
    if not file.ends_with(*ENDINGS) or len(file.content) > 20_000:
        return []
    lines = file.content.decode("utf-8-sig", errors="replace").splitlines()
    rows = [_SEPARATOR.split(line.strip()) for line in lines if line.strip()]
    if rows and not all(map(is_number_or_empty, rows[0][1 : 1 + NUMBERS])):
        del rows[0]  # the names of the columns
    named = len({row[0] for row in rows}) == len(rows)
    return rows if named and all(map(_is_camera, rows)) else []


def _is_camera(row: list[str]) -> bool:
    cells = row[1 : 1 + NUMBERS]
    if len(cells) < NUMBERS or not all(map(is_number_or_empty, cells)):
        return False
    _, width, height, cx, cy, aspect, *_ = map(float, cells)
    inside = 0 < cx < width and 0 < cy < height
    return inside and width % 1 == height % 1 == 0 and ASPECT[0] < aspect < ASPECT[1]


def read_profile(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras of a profile, without a pose; a profile of one camera is a lens for both."""
    file = only_file(files, ENDINGS, source)
    rows = _profile_rows(file)
    names = [row[0] for row in rows]
    chosen = chosen_pair(names, options.cameras, file.name) if len(rows) > 1 else None
    cameras = []
    for k, row in enumerate([rows[camera] for camera in chosen.pair] if chosen else rows * 2):
        focal, width, height, cx, cy, aspect, *lens = map(float, row[1 : 1 + NUMBERS])
        K = camera_matrix(focal, focal * aspect, cx, cy)
        where = f"{file.name}, {row[0]}"
        cameras.append(camera_from(K, lens, (width, height), False, options, k, where))
    no_pose = f"{file.name}: a camera profile has no pose."
    pair = ForeignPair(cameras[0], cameras[1], None, no_pose, "Argus profile", chosen)
    return replace(pair, called=ONE_LENS)


def _profile_names(file: ForeignFile) -> tuple[str, ...]:
    return tuple(row[0] for row in _profile_rows(file))


ARGUS = CameraFormat(
    "Argus camera profile", read_profile, lambda file: bool(_profile_names(file)), _profile_names
)
