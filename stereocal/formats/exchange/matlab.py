"""Write and read a MATLAB script that builds `stereoParams`.

MATLAB's points are row vectors, so RotationOfCamera2 is the transpose of R; the newer PoseCamera2
is the inverse of our pose. The first pixel is (1, 1).
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import (
    ExchangeOptions,
    ReadRig,
    array_of,
    header,
    number,
    only_file,
    size_of,
)
from stereocal.formats.units import Unit
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig

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


def write_matlab(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`stereo_parameters.m`, which creates `stereoParams` in the workspace.

    Raises:
        StereocalError: a lens with more than five coefficients.
    """
    text = header(
        "%",
        "Camera 1 is the primary, camera 2 the secondary. The first pixel is (1, 1), so the",
        "principal points are larger by 1 than stereocal's. RotationOfCamera2 is R': MATLAB's",
        "points are rows: x_secondary = x_primary * RotationOfCamera2 + TranslationOfCamera2.",
        "ImageSize: rows, columns. RadialDistortion: k1 k2 k3. TangentialDistortion: p1 p2.",
    )
    for k, which, camera in ((1, "primary", rig.primary), (2, "secondary", rig.secondary)):
        k1, k2, p1, p2, k3 = lens(camera, 5, which, "MATLAB's cameraParameters")
        width, height = camera.image_size
        text += _assign(f"K{k}", camera.K + FIRST_PIXEL)
        text += _assign(f"RadialDistortion{k}", np.array([[k1, k2, k3]]))
        text += _assign(f"TangentialDistortion{k}", np.array([[p1, p2]]))
        text += f"ImageSize{k} = [{height} {width}];\n"
    text += _assign("RotationOfCamera2", rig.pose.R.T)
    text += _assign("TranslationOfCamera2", rig.pose.T[None])
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


def read_matlab(files: Mapping[str, bytes], options: ExchangeOptions, source: str) -> ReadRig:
    """Two cameras and their pose from such a script, with lengths in its WorldUnits.

    Raises:
        StereocalError: an assignment is missing or damaged, or the units are not known.
    """
    name, text = only_file(files, (".m",), source)
    code = _without_comments(text)
    tables = {key: _table(body, key, name) for key, body in _ASSIGNED.findall(code)}
    cameras = []
    for k, which in ((1, "primary"), (2, "secondary")):
        K = _required(tables, f"K{k}", (3, 3), name) - FIRST_PIXEL
        radial = _required(tables, f"RadialDistortion{k}", (-1,), name)
        tangential = _required(tables, f"TangentialDistortion{k}", (2,), name)
        if len(radial) not in (2, 3):
            raise StereocalError(f"{name}: RadialDistortion{k} must have two or three numbers.")
        size = tables.get(f"ImageSize{k}")
        size = None if size is None else size.ravel()[::-1]
        distortion = np.concatenate([radial[:2], tangential, radial[2:]])
        size_px = size_of(size, options.image_sizes[k - 1], which, name)
        try:
            cameras.append(Camera(K, distortion, size_px))
        except StereocalError as error:
            raise StereocalError(f"{name}, {which}: {error}") from error
    R = _required(tables, "RotationOfCamera2", (3, 3), name).T
    pose = Pose(R, _required(tables, "TranslationOfCamera2", (3,), name))
    return Rig(cameras[0], cameras[1], pose), _unit_of(code, name)


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
