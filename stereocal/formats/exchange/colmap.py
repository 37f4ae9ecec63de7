"""A COLMAP rig: the text files of a sparse model without images, and `rig_config.json`.

COLMAP's pixel origin is the corner of the first pixel, whose centre is (0.5, 0.5). Quaternions are
w x y z. The rig's frame is the primary's, so the secondary's `sensor_from_rig` is our pose.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import RATIONAL, lens
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, number, refuse_skew
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_matrix,
    camera_of,
    pose_of,
)
from stereocal.rig.camera import FISHEYE_UNKNOWNS, Camera
from stereocal.rig.compiled import FloatArray

FIRST_PIXEL = 0.5
FISHEYE = FISHEYE_UNKNOWNS[4:]
MODELS: Mapping[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", *FISHEYE),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", *RATIONAL),
}


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
        model, parameters = _parameters(camera, which)
        width, height = camera.image_size
        cells = " ".join(number(value) for value in parameters)
        cameras += f"{k} {model} {width} {height} {cells}\n"
        config.append(
            {
                "image_prefix": f"{which}/",
                "camera_model_name": model,
                "camera_params": [float(value) for value in parameters],
            }
        )
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


def read_colmap(files: Files, _: ExchangeOptions, source: str) -> CameraPair:
    """The two cameras of the only rig in `cameras.txt` and `rigs.txt`."""
    named = {file.name: file for file in files}
    for name in ("cameras.txt", "rigs.txt"):
        if name not in named:
            raise StereocalError(
                f"{source}: {name} is missing; use the folder of a sparse model as text "
                "(colmap model_converter --output_type TXT)."
            )
    cameras = {}
    for cells in _rows(named["cameras.txt"]):
        if len(cells) < 5:
            raise StereocalError("cameras.txt: a camera has fewer than five entries.")
        cameras[cells[0]] = _camera(cells, "cameras.txt")
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
    return CameraPair(cameras[cells[3]], cameras[cells[5]], pose_of(R, values[4:], "rigs.txt"))


def _parameters(camera: Camera, which: str) -> tuple[str, FloatArray]:
    refuse_skew(camera, which, "COLMAP")
    K = camera.K
    pinhole = [K[0, 0], K[1, 1], K[0, 2] + FIRST_PIXEL, K[1, 2] + FIRST_PIXEL]
    if camera.is_fisheye:
        return "OPENCV_FISHEYE", np.array([*pinhole, *camera.distortion])
    eight = lens(camera, 8, which, "COLMAP")
    if eight[4:].any():
        return "FULL_OPENCV", np.array([*pinhole, *eight])
    return "OPENCV", np.array([*pinhole, *eight[:4]])


def _camera(cells: list[str], source: str) -> Camera:
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
    width, height = array_of(cells[2:4], (2,), "the image size", source)
    size = (int(width), int(height))
    if model == "OPENCV_FISHEYE":
        return camera_of(K, [named[k] for k in FISHEYE], size, source, "fisheye")
    return camera_of(K, [named.get(k, 0.0) for k in RATIONAL], size, source)


def _rows(file: ForeignFile) -> list[list[str]]:
    lines = file.text.splitlines()
    return [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
