"""OpenCV's stereo files as in its sample: `intrinsics.yml` and `extrinsics.yml`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import K_NAMES
from stereocal.formats.exchange.options import ExchangeOptions, Posed, header, number, rig_of
from stereocal.formats.exchange.reading import (
    STORAGES,
    CameraPair,
    Files,
    ForeignFile,
    array_of,
    camera_of,
    pose_of,
    size_of,
)
from stereocal.formats.file_storage import find_node, is_number, matrix_of, stated_lens_model
from stereocal.formats.lens_model import five_or_more, lens_model_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig

NAMES: Mapping[str, tuple[str, ...]] = {
    "M1": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "CM1"),
    "M2": ("M2", "K2", "cameraMatrix2", "camera_matrix_2", "CM2"),
    "D1": ("D1", "distCoeffs1", "distortion_coefficients_1"),
    "D2": ("D2", "distCoeffs2", "distortion_coefficients_2"),
    "R": ("R",),
    "T": ("T",),
}
"""Common names of the matrices; we write those of OpenCV's sample."""


def write_opencv(two: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """The two files; R1, R2, P1, P2, Q are those of `cv2.stereoRectify`."""
    rig = rig_of(two)
    fisheye = rig.primary.is_fisheye
    if fisheye != rig.secondary.is_fisheye:
        raise StereocalError(
            "OpenCV's stereo files have one lens model for both cameras, but one camera of this "
            "pair is a fisheye and the other is not. Choose another format."
        )
    intrinsics = [("M1", rig.primary.K), ("D1", _row(rig.primary))]
    intrinsics += [("M2", rig.secondary.K), ("D2", _row(rig.secondary))]
    sizes = (
        "".join(
            f"image_size_{k}: [ {camera.image_size[0]}, {camera.image_size[1]} ]\n"
            for k, camera in ((1, rig.primary), (2, rig.secondary))
        )
        + "fisheye_model: 1\n" * fisheye
    )
    extrinsics = [("R", rig.pose.R), ("T", rig.pose.T[:, None])]
    extrinsics += list(zip(("R1", "R2", "P1", "P2", "Q"), rectification(rig), strict=True))
    comment = "1 is the primary camera, 2 the secondary."
    return {
        "intrinsics.yml": _file(
            [
                comment,
                "M: camera matrix; D: k1 k2 k3 k4 of a fisheye; sizes: width, height."
                if fisheye
                else "M: camera matrix; D: k1 k2 p1 p2 [k3 [k4 k5 k6 ...]]; sizes: width, height.",
                "The centre of the top-left pixel is (0, 0).",
            ],
            intrinsics,
            sizes,
        ),
        "extrinsics.yml": _file(
            [comment, "R1, R2, P1, P2, Q are for images of the size of the primary's."], extrinsics
        ),
    }


def rectification(rig: Rig) -> tuple[FloatArray, ...]:
    """R1, R2, P1, P2, Q of `cv2.stereoRectify`; for a fisheye, of its undistorted image."""
    none = np.zeros((1, 5))
    found = cv2.stereoRectify(
        rig.primary.K,
        none if rig.primary.is_fisheye else _row(rig.primary),
        rig.secondary.K,
        none if rig.secondary.is_fisheye else _row(rig.secondary),
        rig.primary.image_size,
        rig.pose.R,
        rig.pose.T[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    return tuple(np.asarray(each, dtype=np.float64) for each in found[:5])


def is_opencv(file: ForeignFile) -> bool:
    """Whether it has one of the matrices of a stereo file."""
    if not file.ends_with(*STORAGES) or "format" in file.storage:
        return False
    if find_node(file.storage, K_NAMES) is not None:  # of a single camera
        return False
    return any(find_node(file.storage, names) is not None for names in NAMES.values())


def read_opencv(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras from one or several files; their pose if R and T are there."""
    found: dict[str, FloatArray] = {}
    sizes: dict[int, Any] = {}
    models: list[str | bool] = []
    for file in files:
        if file.ends_with(*STORAGES):
            _read_one(file, found, sizes, models)
    missing = [key for key in NAMES if key not in found]
    lacks = (
        f"{source}: {', '.join(missing)} missing; OpenCV's stereo files have M1, D1, M2, D2 "
        "(intrinsics.yml) and R, T (extrinsics.yml)."
    )
    if set(missing) - {"R", "T"}:
        raise StereocalError(lacks)
    cameras = []
    for k, which in enumerate(CAMERAS):
        where, K, D = f"{source}, {which}", found[f"M{k + 1}"], found[f"D{k + 1}"]
        model = lens_model_of(D, models[0] if models else None, options.lens_model, where)
        size = size_of(sizes.get(k), options, k, source)
        K = array_of(K, (3, 3), f"M{k + 1}", source)
        cameras.append(camera_of(K, D, size, where, model))
    if missing:
        return CameraPair(cameras[0], cameras[1], None, lacks)
    R, T = array_of(found["R"], (3, 3), "R", source), array_of(found["T"], (3,), "T", source)
    return CameraPair(cameras[0], cameras[1], pose_of(R, T, source))


def _read_one(
    file: ForeignFile, found: dict[str, FloatArray], sizes: dict[int, Any], models: list[str | bool]
) -> None:
    for key, known in NAMES.items():
        node = find_node(file.storage, known)
        if node is not None:
            found[key] = matrix_of(node, key, file.name)
    stated = stated_lens_model(file.storage)
    models += [] if stated is None else [stated]
    for k in (0, 1):
        node = find_node(file.storage, (f"image_size_{k + 1}", "image_size", "imageSize"))
        if isinstance(node, list) and len(node) == 2 and all(map(is_number, node)):
            sizes[k] = node


def _row(camera: Camera) -> FloatArray:
    known = camera.distortion
    return (known if camera.is_fisheye else five_or_more(known))[None, :]


def _file(comments: list[str], matrices: list[tuple[str, FloatArray]], more: str = "") -> bytes:
    text = "%YAML:1.0\n---\n" + header("#", *comments)
    for name, values in matrices:
        rows = [", ".join(number(value) for value in row) for row in values]
        text += (
            f"{name}: !!opencv-matrix\n   rows: {values.shape[0]}\n   cols: {values.shape[1]}\n"
            "   dt: d\n   data: [ " + ",\n       ".join(rows) + " ]\n"
        )
    return (text + more).encode()
