"""Kalibr's camchain; `T_cn_cnm1` is `secondary_from_primary`, as ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import (
    ExchangeOptions,
    ReadRig,
    array_of,
    camera_matrix,
    header,
    numbers,
    only_file,
    refuse_skew,
    size_of,
)
from stereocal.formats.yaml_text import read_yaml
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig


def write_kalibr(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`camchain.yaml`.

    Raises:
        StereocalError: a skew, or a lens that needs k3 or further coefficients.
    """
    text = header(
        "#",
        "cam0 is the primary camera, cam1 the secondary; T_cn_cnm1 takes cam0 to cam1.",
        "intrinsics: fu fv pu pv; distortion_coeffs: k1 k2 p1 p2; the centre of the top-left",
        "pixel is (0, 0).",
    )
    for k, (which, camera) in enumerate((("primary", rig.primary), ("secondary", rig.secondary))):
        refuse_skew(camera, which, "Kalibr")
        coefficients = lens(camera, 4, which, "Kalibr")
        K = camera.K
        text += f"cam{k}:\n"
        if k == 1:
            transform = np.vstack([np.column_stack([rig.pose.R, rig.pose.T]), [0, 0, 0, 1]])
            text += "  T_cn_cnm1:\n" + "".join(f"  - {numbers(row)}\n" for row in transform)
        text += (
            "  camera_model: pinhole\n"
            f"  intrinsics: {numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])}\n"
            "  distortion_model: radtan\n"
            f"  distortion_coeffs: {numbers(coefficients)}\n"
            f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"  rostopic: /{which}/image_raw\n"
        )
    return {"camchain.yaml": text.encode()}


def read_kalibr(files: Mapping[str, bytes], options: ExchangeOptions, source: str) -> ReadRig:
    """Two cameras and their pose.

    Raises:
        StereocalError: not two cameras, another lens model, or a number is missing.
    """
    name, text = only_file(files, (".yaml", ".yml"), source)
    data = read_yaml(text, name)
    chain = sorted(key for key in data if key.startswith("cam") and key[3:].isdigit())
    if chain != ["cam0", "cam1"]:
        raise StereocalError(
            f"{name}: a chain of cam0 and cam1 is expected; the file has "
            f"{', '.join(chain) or 'no camera'}."
        )
    cameras = [
        kalibr_camera(data[key], k, options, f"{name}, {key}") for k, key in enumerate(chain)
    ]
    transform = array_of(data["cam1"].get("T_cn_cnm1"), (4, 4), "T_cn_cnm1", f"{name}, cam1")
    return Rig(cameras[0], cameras[1], Pose(transform[:3, :3], transform[:3, 3])), None


def kalibr_camera(data: Any, k: int, options: ExchangeOptions, source: str) -> Camera:
    """The camera of an entry of a camchain; `k` is 0 for the primary.

    Raises:
        StereocalError: another lens model, or a number is missing.
    """
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a camera.")
    # Coefficients without a model are an error, not a lens without distortion.
    usual = "none" if data.get("distortion_coeffs") is None else "no distortion_model"
    model, distortion = data.get("camera_model"), data.get("distortion_model", usual)
    if model != "pinhole" or distortion not in ("radtan", "none"):
        raise StereocalError(
            f"{source}: the camera is {model} with {distortion}; only pinhole with radtan or none "
            "is supported. Calibrate with --models pinhole-radtan."
        )
    fx, fy, cx, cy = array_of(data.get("intrinsics"), (4,), "intrinsics", source)
    coefficients = (
        np.zeros(4)
        if distortion == "none"
        else array_of(data.get("distortion_coeffs"), (4,), "distortion_coeffs", source)
    )
    size = size_of(data.get("resolution"), options.image_sizes[k], CAMERAS[k], source)
    return Camera(camera_matrix(fx, fy, cx, cy), coefficients, size)
