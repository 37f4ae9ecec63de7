"""MATLAB's stereoParameters or cameraParameters, saved as a struct (`toStruct`) in a .mat file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import CameraPair
from stereocal.formats.archives.matlab_file import Fields, numbers_of, read_structs, required
from stereocal.formats.exchange.matlab import FIRST_PIXEL, WORLD_UNITS
from stereocal.formats.units import Unit
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose

PARTS = ("CameraParameters1", "CameraParameters2")


def read_stereo_struct(content: bytes, source: str) -> CameraPair:
    """The two cameras and their pose.

    Raises:
        StereocalError: there is no such struct, or a field is missing or wrong.
    """
    return stereo_of(read_structs(content, source), source)


def stereo_of(structs: Mapping[str, Fields], source: str) -> CameraPair:
    """As `read_stereo_struct`, from the structs of a file by name."""
    for fields in structs.values():
        if all(isinstance(fields.get(part), Mapping) for part in PARTS):
            primary, secondary = (
                struct_camera(fields[part], f"{source}, {which}")
                for part, which in zip(PARTS, CAMERAS, strict=True)
            )
            return CameraPair(
                "MATLAB",
                primary,
                secondary,
                _pose(fields, source),
                "stereoParams",
                stated=_unit(fields),
            )
    raise StereocalError(
        f"{source}: this .mat file has neither easyWandData nor the struct of a stereoParameters "
        f"(it contains: {', '.join(structs)[:100]}). In MATLAB: s = toStruct(stereoParams); "
        "save('stereo.mat', 's', '-v7')."
    )


def struct_camera(fields: Fields, source: str) -> Camera:
    """The camera of a cameraParameters or cameraIntrinsics struct.

    Raises:
        StereocalError: a field is missing or wrong.
    """
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
    try:
        return Camera(_matrix(fields, source), distortion, (int(width), int(height)))
    except (StereocalError, ValueError, OverflowError) as error:
        raise StereocalError(f"{source}: {error}") from error


def _matrix(fields: Fields, source: str) -> FloatArray:
    """K, whose first pixel is (1, 1) in MATLAB; older versions save its transpose."""
    for name, transposed in (("K", False), ("IntrinsicMatrix", True)):
        found = numbers_of(fields, name, source)
        if found is not None:
            if found.shape != (3, 3):
                raise StereocalError(f"{source}: {name} is not a 3x3 matrix.")
            return np.asarray((found.T if transposed else found) - FIRST_PIXEL)
    f, c = (required(fields, name, 2, source) for name in ("FocalLength", "PrincipalPoint"))
    return np.array([[f[0], 0, c[0] - 1], [0, f[1], c[1] - 1], [0, 0, 1.0]])


def _pose(fields: Fields, source: str) -> Pose | None:
    """RotationOfCamera2 is R transposed; PoseCamera2 is the pose's inverse, its matrix in A."""
    R = numbers_of(fields, "RotationOfCamera2", source)
    if R is not None:
        return Pose(
            required({"R": R}, "R", 9, f"{source}, RotationOfCamera2").reshape(3, 3).T,
            required(fields, "TranslationOfCamera2", 3, source),
        )
    pose: Any = fields.get("PoseCamera2")
    inner = pose if isinstance(pose, Mapping) else {"A": pose}
    A = numbers_of(inner, "A", source) if inner.get("A") is not None else None
    if A is None:
        return None
    A = required({"A": A}, "A", 16, f"{source}, PoseCamera2").reshape(4, 4)
    return Pose(A[:3, :3], A[:3, 3]).inverse()


def _unit(fields: Fields) -> Unit | None:
    parts = [fields, *(fields[part] for part in PARTS)]
    stated = [part.get("WorldUnits") for part in parts]
    known = {WORLD_UNITS[unit] for unit in stated if isinstance(unit, str) and unit in WORLD_UNITS}
    return known.pop() if len(known) == 1 else None
