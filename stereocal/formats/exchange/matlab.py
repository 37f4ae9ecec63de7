"""MATLAB's stereoParameters: a script that builds them, or their struct in a .mat file.

MATLAB's points are row vectors, so RotationOfCamera2 is the transpose of R; the newer PoseCamera2
is the inverse of our pose. The first pixel is (1, 1).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, number
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_matrix,
    camera_of,
    only_file,
    pose_of,
    size_of,
)
from stereocal.formats.matlab_file import Fields, numbers_of, read_structs, required
from stereocal.formats.other_files import is_matlab
from stereocal.formats.units import Unit
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose

PARTS = ("CameraParameters1", "CameraParameters2")
FIRST_PIXEL = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
BUILD = """try  % R2022b and later
    camera1 = cameraParameters('K', K1, 'RadialDistortion', RadialDistortion1, ...
        'TangentialDistortion', TangentialDistortion1, 'ImageSize', ImageSize1, 'WorldUnits', 'm');
    camera2 = cameraParameters('K', K2, 'RadialDistortion', RadialDistortion2, ...
        'TangentialDistortion', TangentialDistortion2, 'ImageSize', ImageSize2, 'WorldUnits', 'm');
catch  % before
    camera1 = cameraParameters('IntrinsicMatrix', K1', 'RadialDistortion', RadialDistortion1, ...
        'TangentialDistortion', TangentialDistortion1, 'ImageSize', ImageSize1, 'WorldUnits', 'm');
    camera2 = cameraParameters('IntrinsicMatrix', K2', 'RadialDistortion', RadialDistortion2, ...
        'TangentialDistortion', TangentialDistortion2, 'ImageSize', ImageSize2, 'WorldUnits', 'm');
end
stereoParams = stereoParameters(camera1, camera2, RotationOfCamera2, TranslationOfCamera2);
"""


def write_matlab(two: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`stereo_parameters.m`, which creates `stereoParams` in the workspace."""
    text = header(
        "%",
        "Camera 1 is the primary, camera 2 the secondary. The first pixel is (1, 1), so the",
        "principal points are larger by 1 than stereocal's. RotationOfCamera2 is R': MATLAB's",
        "points are rows: x_secondary = x_primary * RotationOfCamera2 + TranslationOfCamera2.",
        "ImageSize: rows, columns. RadialDistortion: k1 k2 k3. TangentialDistortion: p1 p2.",
    )
    for k, (which, camera, _pose) in enumerate(two, start=1):
        k1, k2, p1, p2, k3 = lens(camera, 5, which, "MATLAB's cameraParameters")
        width, height = camera.image_size
        text += _assign(f"K{k}", camera.K + FIRST_PIXEL)
        text += _assign(f"RadialDistortion{k}", np.array([[k1, k2, k3]]))
        text += _assign(f"TangentialDistortion{k}", np.array([[p1, p2]]))
        text += f"ImageSize{k} = [{height} {width}];\n"
    pose = two[1][2]
    text += _assign("RotationOfCamera2", pose.R.T)
    text += _assign("TranslationOfCamera2", pose.T[None])
    return {"stereo_parameters.m": (text + BUILD).encode()}


WORLD_UNITS: Mapping[str, Unit] = {
    "m": "m",
    "meters": "m",
    "cm": "cm",
    "centimeters": "cm",
    "mm": "mm",
    "millimeters": "mm",
}
_WORLD_UNITS = re.compile(r"WorldUnits['\"]?\s*[,=]\s*['\"]([^'\"]*)['\"]")
_ASSIGNED = re.compile(r"^[ \t]*([A-Za-z]\w*)[ \t]*=[ \t]*\[([^\[\]]*)\]", re.MULTILINE)


def _without_comments(text: str) -> str:
    """The script without comments, with lines continued by `...` joined."""
    plain = []
    for line in text.split("\n"):
        code, continued, _ = line.partition("%")[0].partition("...")
        plain.append(code + (" " if continued else "\n"))
    return "".join(plain)


def is_matlab_file(file: ForeignFile) -> bool:
    """Whether it is a script or a .mat file."""
    return file.ends_with(".m") or is_matlab(file.content)


def read_matlab(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras and their pose from a script as ours, or from a struct (`toStruct`)."""
    file = only_file(files, (".m", ".mat"), source)
    if is_matlab(file.content):
        return stereo_of(read_structs(file.content, file.name), file.name)
    name, code = file.name, _without_comments(file.text)
    tables = {key: _table(body, key, name) for key, body in _ASSIGNED.findall(code)}
    cameras = []
    for at, which in enumerate(CAMERAS):
        k = at + 1
        K = _required(tables, f"K{k}", (3, 3), name) - FIRST_PIXEL
        radial = _required(tables, f"RadialDistortion{k}", (-1,), name)
        tangential = _required(tables, f"TangentialDistortion{k}", (2,), name)
        if len(radial) not in (2, 3):
            raise StereocalError(f"{name}: RadialDistortion{k} must have two or three numbers.")
        size = tables.get(f"ImageSize{k}")
        size = None if size is None else size.ravel()[::-1]
        distortion = np.concatenate([radial[:2], tangential, radial[2:]])
        size_px = size_of(size, options, at, name)
        cameras.append(camera_of(K, distortion, size_px, f"{name}, {which}"))
    R = _required(tables, "RotationOfCamera2", (3, 3), name).T
    pose = pose_of(R, _required(tables, "TranslationOfCamera2", (3,), name), name)
    return CameraPair(cameras[0], cameras[1], pose, stated=_unit_of(code, name))


def stereo_of(structs: Mapping[str, Fields], source: str) -> CameraPair:
    """The cameras and their pose from the structs of a .mat file by name."""
    for fields in structs.values():
        if all(isinstance(fields.get(part), Mapping) for part in PARTS):
            primary, secondary = (
                _struct_camera(fields[part], f"{source}, {which}")
                for part, which in zip(PARTS, CAMERAS, strict=True)
            )
            return CameraPair(
                primary,
                secondary,
                _struct_pose(fields, source),
                f"{source}: neither RotationOfCamera2 nor PoseCamera2 is in the struct.",
                "MATLAB",
                "stereoParams",
                stated=_struct_unit(fields),
            )
    raise StereocalError(
        f"{source}: this .mat file has neither easyWandData nor the struct of a stereoParameters "
        f"(it contains: {', '.join(structs)[:100]}). In MATLAB: s = toStruct(stereoParams); "
        "save('stereo.mat', 's', '-v7')."
    )


def _unit_of(code: str, source: str) -> Unit | None:
    units = set(_WORLD_UNITS.findall(code))
    unknown = sorted(units - set(WORLD_UNITS))
    known = {WORLD_UNITS[unit] for unit in units & set(WORLD_UNITS)}
    if unknown or len(known) > 1:
        raise StereocalError(
            f"{source}: its WorldUnits are {', '.join(sorted(units))[:60]}; write the lengths in "
            "one of m, cm and mm."
        )
    return known.pop() if known else None


def _assign(name: str, values: FloatArray) -> str:
    rows = ["  " + " ".join(number(value) for value in row) for row in values]
    return f"{name} = [\n" + "\n".join(rows) + "\n];\n"


def _table(body: str, key: str, source: str) -> FloatArray:
    rows = [row.replace(",", " ").split() for row in re.split(r"[;\n]", body) if row.strip(" ,\t")]
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise StereocalError(f"{source}: {key} contains something that is not a number.") from error


def _required(
    tables: Mapping[str, FloatArray], key: str, shape: tuple[int, ...], source: str
) -> FloatArray:
    if key not in tables:
        raise StereocalError(
            f"{source}: {key} is missing; expected is a script as stereocal writes it, which "
            "assigns K1, RadialDistortion1, TangentialDistortion1, ImageSize1, the same with 2, "
            "RotationOfCamera2 and TranslationOfCamera2."
        )
    return array_of(tables[key], shape, key, source)


def _struct_camera(fields: Fields, source: str) -> Camera:
    """The camera of a cameraParameters or cameraIntrinsics struct."""
    inner = fields.get("Intrinsics")
    fields = {**fields, **inner} if isinstance(inner, Mapping) else fields
    radial = numbers_of(fields, "RadialDistortion", source)
    radial = np.zeros(2) if radial is None else radial.ravel()
    if len(radial) not in (2, 3) or not np.isfinite(radial).all():
        raise StereocalError(f"{source}: RadialDistortion must have two or three numbers.")
    tangential = (
        required(fields, "TangentialDistortion", 2, source)
        if "TangentialDistortion" in fields
        else np.zeros(2)
    )
    height, width = required(fields, "ImageSize", 2, source)
    distortion = np.concatenate([radial[:2], tangential, radial[2:], np.zeros(3 - len(radial))])
    return camera_of(_matrix(fields, source), distortion, (int(width), int(height)), source)


def _matrix(fields: Fields, source: str) -> FloatArray:
    """K, whose first pixel is (1, 1) in MATLAB; older versions save its transpose."""
    for name, transposed in (("K", False), ("IntrinsicMatrix", True)):
        found = numbers_of(fields, name, source)
        if found is not None:
            if found.shape != (3, 3):
                raise StereocalError(f"{source}: {name} is not a 3x3 matrix.")
            return np.asarray((found.T if transposed else found) - FIRST_PIXEL)
    f, c = (required(fields, name, 2, source) for name in ("FocalLength", "PrincipalPoint"))
    return camera_matrix(f[0], f[1], c[0] - 1, c[1] - 1)


def _struct_pose(fields: Fields, source: str) -> Pose | None:
    """RotationOfCamera2 is R transposed; PoseCamera2 is the pose's inverse, its matrix in A."""
    R = numbers_of(fields, "RotationOfCamera2", source)
    if R is not None:
        R = required({"R": R}, "R", 9, f"{source}, RotationOfCamera2").reshape(3, 3).T
        return pose_of(R, required(fields, "TranslationOfCamera2", 3, source), source)
    pose: Any = fields.get("PoseCamera2")
    inner = pose if isinstance(pose, Mapping) else {"A": pose}
    A = numbers_of(inner, "A", source) if inner.get("A") is not None else None
    if A is None:
        return None
    A = required({"A": A}, "A", 16, f"{source}, PoseCamera2").reshape(4, 4)
    return pose_of(A[:3, :3], A[:3, 3], source).inverse()


def _struct_unit(fields: Fields) -> Unit | None:
    parts = [fields, *(fields[part] for part in PARTS)]
    stated = [part.get("WorldUnits") for part in parts]
    known = {WORLD_UNITS[unit] for unit in stated if isinstance(unit, str) and unit in WORLD_UNITS}
    return known.pop() if len(known) == 1 else None
