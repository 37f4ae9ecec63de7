"""MATLAB's stereoParameters: a script that builds them, or their struct in a .mat file.

MATLAB's points are row vectors, so RotationOfCamera2 is the transpose of R; the newer PoseCamera2
is the inverse of our pose. The first pixel is (1, 1).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.camera_format import (
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
    only_file,
    pose_from,
)
from stereocal.formats.exchange.options import UNITS, ExchangeOptions, Unit, unit_called
from stereocal.formats.matlab_file import Fields, needed_in_field, numbers_in_field, read_structs
from stereocal.formats.other_files import is_matlab
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray

ASSIGNED = (
    *(f"{name}{k}" for k in "12" for name in ("K", "RadialDistortion", "TangentialDistortion")),
    "RotationOfCamera2",
    "TranslationOfCamera2",
)
"""Names that a script must assign."""
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
    for k, (_which, camera, _pose) in enumerate(two, start=1):
        k1, k2, p1, p2, k3 = camera.distortion
        width, height = camera.image_size
        text += _assign(f"K{k}", camera.K + FIRST_PIXEL)
        text += _assign(f"RadialDistortion{k}", np.array([[k1, k2, k3]]))
        text += _assign(f"TangentialDistortion{k}", np.array([[p1, p2]]))
        text += f"ImageSize{k} = [{height} {width}];\n"
    pose = two[1][2]
    text += _assign("RotationOfCamera2", pose.R.T)
    text += _assign("TranslationOfCamera2", pose.T[None])
    return {"stereo_parameters.m": (text + BUILD).encode()}


_WORLD_UNITS = re.compile(r"WorldUnits['\"]?\s*[,=]\s*['\"]([^'\"]*)['\"]")
_ASSIGNED = re.compile(r"^[ \t]*([A-Za-z]\w*)[ \t]*=[ \t]*\[([^\[\]]*)\]", re.MULTILINE)


def _without_comments(text: str) -> str:
    """The script without comments, with lines continued by `...` joined."""
    plain = []
    for line in text.split("\n"):
        code, continued, _ = line.partition("%")[0].partition("...")
        plain.append(code + (" " if continued else "\n"))
    return "".join(plain)


def read_matlab(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras and their pose from a script as ours, or from a struct (`toStruct`)."""
    file = only_file(files, (".m", ".mat"), source)
    if is_matlab(file.content):
        return stereo_of(read_structs(file.content, file.name), file.name, options)
    code = _without_comments(file.text)
    assigned = {key: _table(body, key, file.name) for key, body in _ASSIGNED.findall(code)}
    if missing := [key for key in ASSIGNED if not assigned.get(key, np.zeros(0)).size]:
        raise StereocalError(
            f"{file.name}: {missing[0]} is missing; expected is a script as stereocal writes it, "
            f"which assigns {', '.join(ASSIGNED)}, ImageSize1 and ImageSize2."
        )
    fields: dict[str, Any] = dict(assigned)
    for k, part in enumerate(PARTS, start=1):
        fields[part] = {key[:-1]: assigned[key] for key in assigned if key.endswith(str(k))}
    fields["WorldUnits"] = _WORLD_UNITS.findall(code)
    return replace(stereo_of({"": fields}, file.name, options), program="", called="")


def _unit_of(stated: Iterable[object], source: str) -> Unit | None:
    """The unit that a file states, at several places; None if at none."""
    words = {word.strip() for word in stated if isinstance(word, str) and word.strip()}
    known = {*map(unit_called, words)}
    if None in known or len(known) > 1:
        raise StereocalError(
            f"{source}: its WorldUnits are {', '.join(sorted(words))[:60]}; write the lengths in "
            f"one of {', '.join(UNITS)}."
        )
    return next(iter(known), None)


def stereo_of(structs: Mapping[str, Fields], source: str, options: ExchangeOptions) -> ForeignPair:
    """The cameras and their pose from the structs of a .mat file by name."""
    for fields in structs.values():
        if all(isinstance(fields.get(part), Mapping) for part in PARTS):
            primary = _camera(fields[PARTS[0]], options, 0, f"{source}, {CAMERAS[0]}")
            secondary = _camera(fields[PARTS[1]], options, 1, f"{source}, {CAMERAS[1]}")
            stating = [fields, *(fields[part] for part in PARTS)]
            units = [word for part in stating for word in np.ravel(part.get("WorldUnits", ""))]
            unit = _unit_of(units, source)
            lacks = f"{source}: neither RotationOfCamera2 nor PoseCamera2 is in the struct."
            pose, no_pose, bad = known_pose(partial(_pose, fields, source), lacks)
            pair = ForeignPair(primary, secondary, pose, no_pose, "MATLAB", stated=unit, notes=bad)
            return replace(pair, called="stereoParams")
    raise StereocalError(
        f"{source}: this .mat file has neither easyWandData nor the struct of a stereoParameters "
        f"(it contains: {', '.join(structs)[:100]}). In MATLAB: s = toStruct(stereoParams); "
        "save('stereo.mat', 's', '-v7')."
    )


def _assign(name: str, values: FloatArray) -> str:
    rows = ["  " + " ".join(number(value) for value in row) for row in values]
    return f"{name} = [\n" + "\n".join(rows) + "\n];\n"


def _table(body: str, key: str, source: str) -> FloatArray:
    rows = [row.replace(",", " ").split() for row in re.split(r"[;\n]", body) if row.strip(" ,\t")]
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise StereocalError(f"{source}: {key} contains something that is not a number.") from error


def _camera(fields: Fields, options: ExchangeOptions, k: int, source: str) -> Camera:
    """The camera of a cameraParameters or cameraIntrinsics struct, or of a script."""
    inner = fields.get("Intrinsics")
    fields = {**fields, **inner} if isinstance(inner, Mapping) else fields
    radial = numbers_in_field(fields, "RadialDistortion", source)
    radial = np.zeros(2) if radial is None else radial.ravel()
    if len(radial) not in (2, 3) or not np.isfinite(radial).all():
        raise StereocalError(f"{source}: RadialDistortion must have two or three numbers.")
    tangential = np.zeros(2)
    if "TangentialDistortion" in fields:
        tangential = _required(fields, "TangentialDistortion", (2,), source)
    size = numbers_in_field(fields, "ImageSize", source)
    size = None if size is None else size.ravel()[::-1]
    lens = np.concatenate([radial[:2], tangential, radial[2:]])
    return camera_from(_matrix(fields, source), lens, size, False, options, k, source)


def _matrix(fields: Fields, source: str) -> FloatArray:
    """K, whose first pixel is (1, 1) in MATLAB; older versions save its transpose."""
    for name, transposed in (("K", False), ("IntrinsicMatrix", True)):
        matrix = numbers_in_field(fields, name, source)
        if matrix is not None:
            if matrix.shape != (3, 3):
                raise StereocalError(f"{source}: {name} is not a 3x3 matrix.")
            return np.asarray((matrix.T if transposed else matrix) - FIRST_PIXEL)
    f, c = (_required(fields, name, (2,), source) for name in ("FocalLength", "PrincipalPoint"))
    return camera_matrix(f[0], f[1], c[0] - 1, c[1] - 1)


def _pose(fields: Fields, source: str) -> Pose | None:
    """RotationOfCamera2 is R transposed; PoseCamera2 is the pose's inverse, its matrix in A."""
    if numbers_in_field(fields, "RotationOfCamera2", source) is not None:
        R = _required(fields, "RotationOfCamera2", (3, 3), source).T
        return pose_from(R, _required(fields, "TranslationOfCamera2", (3,), source), source)
    pose: Any = fields.get("PoseCamera2")
    A = None
    if pose is not None:
        A = numbers_in_field(pose if isinstance(pose, Mapping) else {"A": pose}, "A", source)
    return None if A is None else pose_from(A, None, f"{source}, PoseCamera2").inverse()


def _required(fields: Fields, name: str, shape: tuple[int, ...], source: str) -> FloatArray:
    return array_of(needed_in_field(fields, name, source), shape, name, source)


MATLAB = ExchangeFormat(
    "MATLAB (stereoParameters)",
    read_matlab,
    lambda file: file.ends_with(".m") or is_matlab(file.content),
    write=write_matlab,
    fisheye=False,
    coefficients=5,
)
