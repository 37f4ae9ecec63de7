"""mrcal's camera models: one file a camera, OpenCV's lens models, poses from a common frame."""

from __future__ import annotations

import ast
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.formats.exchange.lens_fit import lens
from stereocal.formats.exchange.options import ExchangeOptions, header, numbers, refuse_skew
from stereocal.formats.exchange.reading import (
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_matrix,
    camera_of,
    pose_of,
    size_of,
)
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig

MODEL = "LENSMODEL_OPENCV8"
MODELS = {"LENSMODEL_PINHOLE": 0, "LENSMODEL_OPENCV4": 4, "LENSMODEL_OPENCV5": 5, MODEL: 8}


def is_mrcal(file: ForeignFile) -> bool:
    """Whether it is a camera model of mrcal."""
    return file.ends_with(".cameramodel")


def write_mrcal(rig: Rig, _: ExchangeOptions) -> dict[str, bytes]:
    """`primary.cameramodel` and `secondary.cameramodel`; the primary's frame is the common one."""
    files = {}
    turn = Rotation.from_matrix(rig.pose.R).as_rotvec()
    for which, camera, extrinsics in (
        ("primary", rig.primary, np.zeros(6)),
        ("secondary", rig.secondary, np.concatenate([turn, rig.pose.T])),
    ):
        refuse_skew(camera, which, "mrcal")
        K, (width, height) = camera.K, camera.image_size
        values = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *lens(camera, 8, which, "mrcal")]
        files[f"{which}.cameramodel"] = (
            header("#", "The centre of the top-left pixel is (0, 0).")
            + f"{{\n  'lensmodel': '{MODEL}',\n  'intrinsics': {numbers(values)},\n"
            + f"  'extrinsics': {numbers(extrinsics)},\n  'imagersize': [{width}, {height}],\n}}\n"
        ).encode()
    return files


def read_mrcal(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Both cameras; the files are taken in the order of their names, a primary first."""
    if len(files) != 2:
        raise StereocalError("two camera models are expected.", source)
    found = [_model(file) for file in sorted(files, key=lambda file: file.name)]
    cameras, (first, second) = [], ((R, T) for _, R, T in found)
    for k, (model, _, _) in enumerate(found):
        count = MODELS[model["lensmodel"]]
        values = array_of(model.get("intrinsics"), (4 + count,), "the intrinsics", source)
        size = size_of(model.get("imagersize"), options, k, source)
        cameras.append(camera_of(camera_matrix(*values[:4]), values[4:], size, source))
    R = second[0] @ first[0].T
    return CameraPair(cameras[0], cameras[1], pose_of(R, second[1] - R @ first[1], source))


def _model(file: ForeignFile) -> tuple[dict[str, Any], FloatArray, FloatArray]:
    """The entries of a file, and R and T from the common frame."""
    try:
        model = ast.literal_eval(file.text)
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise StereocalError("this is not a camera model of mrcal.", file.name) from error
    if not isinstance(model, dict) or model.get("lensmodel") not in MODELS:
        raise StereocalError(f"its lens model is none of {', '.join(MODELS)}.", file.name)
    pose = array_of(model.get("extrinsics"), (6,), "the extrinsics", file.name)
    return model, Rotation.from_rotvec(pose[:3]).as_matrix(), pose[3:]
