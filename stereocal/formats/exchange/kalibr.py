"""Kalibr's camchain; `T_cn_cnm1` is `secondary_from_primary`, as ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, numbers, refuse_skew
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_matrix,
    camera_of,
    chosen_pair,
    only_file,
    pose_of,
    size_of,
)
from stereocal.formats.lens_model import FISHEYE
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose


def write_kalibr(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`camchain.yaml`."""
    names = ", ".join(f"cam{k} is the {name} camera" for k, (name, _, _) in enumerate(cameras))
    text = header(
        "#",
        f"{names}; T_cn_cnm1 takes the camera before to each.",
        "intrinsics: fu fv pu pv; distortion_coeffs: k1 k2 p1 p2, of equidistant k1 k2 k3 k4;",
        "the centre of the top-left pixel is (0, 0).",
    )
    for k, (which, camera, pose) in enumerate(cameras):
        refuse_skew(camera, which, "Kalibr")
        fisheye = camera.is_fisheye
        coefficients = camera.distortion if fisheye else lens(camera, 4, which, "Kalibr")
        K = camera.K
        text += f"cam{k}:\n"
        if k:
            step = pose @ cameras[k - 1][2].inverse()
            transform = np.vstack([np.column_stack([step.R, step.T]), [0, 0, 0, 1]])
            text += "  T_cn_cnm1:\n" + "".join(f"  - {numbers(row)}\n" for row in transform)
        text += (
            "  camera_model: pinhole\n"
            f"  intrinsics: {numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])}\n"
            f"  distortion_model: {'equidistant' if fisheye else 'radtan'}\n"
            f"  distortion_coeffs: {numbers(coefficients)}\n"
            f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"  rostopic: /{which}/image_raw\n"
        )
    return {"camchain.yaml": text.encode()}


def kalibr_names(file: ForeignFile) -> tuple[str, ...]:
    """Names of the cameras of a camchain, in its order; empty for another file."""
    if not file.ends_with(".yaml", ".yml"):
        return ()
    found = [key for key in file.storage if key.startswith("cam") and key[3:].isdecimal()]
    return tuple(sorted(found, key=lambda key: int(key[3:])))


def read_kalibr(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras of a camchain; the pose is known if the chain between them is whole."""
    file = only_file(files, (".yaml", ".yml"), source)
    data, names = file.storage, kalibr_names(file)
    chosen = chosen_pair(names, options.cameras, file.name)
    primary, secondary = (
        _camera(data[name], k, options, f"{file.name}, {name}")
        for k, name in enumerate(chosen.names)
    )
    numbers = [int(name[3:]) for name in names]
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise StereocalError(
            f"{file.name}: a chain without gaps is expected; the file has {', '.join(names)[:200]}."
        )
    first, last = sorted(chosen.pair)
    pose: Pose | None = Pose(np.eye(3), np.zeros(3))
    for key in names[first + 1 : last + 1]:
        where = f"{file.name}, {key}"
        if pose is None or not isinstance(data[key], dict) or data[key].get("T_cn_cnm1") is None:
            pose = None
            continue
        T = array_of(data[key]["T_cn_cnm1"], (4, 4), "T_cn_cnm1", where)
        pose = pose_of(T[:3, :3], T[:3, 3], where) @ pose
    if pose is not None and chosen.pair[0] == last:
        pose = pose.inverse()
    return CameraPair(
        primary,
        secondary,
        pose,
        f"{file.name}: T_cn_cnm1, the pose of a camera, is missing.",
        "Kalibr",
        chosen.words,
        chosen.cameras,
        chosen.remarks,
    )


def _camera(data: Any, k: int, options: ExchangeOptions, source: str) -> Camera:
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a camera.")
    # Coefficients without a model are an error, not a lens without distortion.
    usual = "none" if data.get("distortion_coeffs") is None else "no distortion_model"
    model, distortion = data.get("camera_model"), data.get("distortion_model", usual)
    fisheye = distortion in FISHEYE
    if model != "pinhole" or (distortion not in ("radtan", "none") and not fisheye):
        raise StereocalError(
            f"{source}: the camera is {model} with {distortion}; only pinhole with radtan, "
            "equidistant or none is supported. Calibrate with --models pinhole-radtan or "
            "pinhole-equi."
        )
    fx, fy, cx, cy = array_of(data.get("intrinsics"), (4,), "intrinsics", source)
    coefficients = (
        np.zeros(4)
        if distortion == "none"
        else array_of(data.get("distortion_coeffs"), (4,), "distortion_coeffs", source)
    )
    size = size_of(data.get("resolution"), options, k, source)
    K = camera_matrix(fx, fy, cx, cy)
    return camera_of(K, coefficients, size, source, "fisheye" if fisheye else "brown")
