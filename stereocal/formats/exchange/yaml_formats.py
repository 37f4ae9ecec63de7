"""Camera files in YAML: OpenCV's stereo sample, and Kalibr's camchain."""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import (
    DISTORTION_NAMES,
    FISHEYE,
    K_NAMES,
    five_or_more,
    image_size_in,
    stated_lens_model,
)
from stereocal.formats.exchange.camera_format import (
    STORAGES,
    ExchangeFormat,
    Files,
    ForeignPair,
    Posed,
    array_of,
    camera_from,
    camera_matrix,
    header,
    number,
    numbers,
    only_file,
    pose_from,
)
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import ExchangeOptions, ImageSize
from stereocal.formats.file_storage import ForeignFile, find_node, matrix_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.system.array_types import FloatArray


def _names_of(k: str, side: str, names: Sequence[str]) -> tuple[str, ...]:
    """Names of a matrix of camera 1 or 2, the left or the right; we write the first."""
    ended = (name + end for end in (k, side[0].upper(), f"_{side}") for name in names)
    return (*ended, *(f"{side}_{name}" for name in names))


NAMES: Mapping[str, tuple[str, ...]] = {
    f"{key}{k}": _names_of(k, side, names)
    for k, side in (("1", "left"), ("2", "right"))
    for key, names in (("M", ("M", *K_NAMES, "CM")), ("D", ("D", *DISTORTION_NAMES)))
} | {"R": ("R", "rotation", "rotation_matrix"), "T": ("T", "translation", "translation_vector")}


def write_opencv(two: Sequence[Posed], _options: ExchangeOptions) -> dict[str, bytes]:
    """`intrinsics.yml` and `extrinsics.yml`; R1, R2, P1, P2, Q are of `rectification`."""
    (_, primary, _), (_, secondary, pose) = two
    fisheye = primary.is_fisheye
    if fisheye != secondary.is_fisheye:
        raise StereocalError(
            "OpenCV's stereo files have one lens model for both cameras, but one camera of this "
            "pair is a fisheye and the other is not. Choose another format."
        )
    comment = "1 is the primary camera, 2 the secondary."
    lens = "k1 k2 k3 k4 of a fisheye" if fisheye else "k1 k2 p1 p2 [k3 [k4 k5 k6 ...]]"
    intrinsics = header(
        "#",
        comment,
        f"M: camera matrix; D: {lens}; sizes: width, height.",
        "The centre of the top-left pixel is (0, 0).",
    )
    sizes = ""
    for k, camera in ((1, primary), (2, secondary)):
        intrinsics += _matrix_node(f"M{k}", camera.K) + _matrix_node(f"D{k}", _row(camera))
        sizes += f"image_size_{k}: [ {camera.image_size[0]}, {camera.image_size[1]} ]\n"
    extrinsics = header(
        "#", comment, "R1, R2, P1, P2, Q are for images of the size of the primary's."
    )
    extrinsics += _matrix_node("R", pose.R) + _matrix_node("T", pose.T[:, None])
    for name, values in zip(("R1", "R2", "P1", "P2", "Q"), rectification(two), strict=True):
        extrinsics += _matrix_node(name, values)
    begin = "%YAML:1.0\n---\n"
    return {
        "intrinsics.yml": (begin + intrinsics + sizes + "fisheye_model: 1\n" * fisheye).encode(),
        "extrinsics.yml": (begin + extrinsics).encode(),
    }


def _matrix_node(name: str, values: FloatArray) -> str:
    rows = [", ".join(number(value) for value in row) for row in values]
    return (
        f"{name}: !!opencv-matrix\n   rows: {values.shape[0]}\n   cols: {values.shape[1]}\n"
        "   dt: d\n   data: [ " + ",\n       ".join(rows) + " ]\n"
    )


def _row(camera: Camera) -> FloatArray:
    known = camera.distortion
    return (known if camera.is_fisheye else five_or_more(known))[None, :]


def rectification(two: Sequence[Posed]) -> list[FloatArray]:
    """R1, R2, P1, P2, Q of `cv2.stereoRectify`; for a fisheye, of its undistorted image."""
    (_, primary, _), (_, secondary, pose) = two
    first, second = (
        np.zeros((1, 5)) if camera.is_fisheye else _row(camera) for camera in (primary, secondary)
    )
    size, T, flags = primary.image_size, pose.T[:, None], cv2.CALIB_ZERO_DISPARITY
    rectified = cv2.stereoRectify(
        primary.K, first, secondary.K, second, size, pose.R, T, flags=flags
    )
    R2, *rest = (np.asarray(matrix, dtype=np.float64) for matrix in rectified[1:5])
    return [R2 @ pose.R, R2, *rest]  # OpenCV's R1 knows no turn below 1e-5 rad


def is_opencv(file: ForeignFile) -> bool:
    """Whether it has one of the matrices of a stereo file, and not that of a single camera."""
    if not file.ends_with(*STORAGES) or "format" in file.storage:
        return False
    if find_node(file.storage, K_NAMES) is not None:
        return False
    return any(find_node(file.storage, names) is not None for names in NAMES.values())


def read_opencv(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras from one or several files; their pose if R and T are there."""
    matrices: dict[str, FloatArray] = {}
    sizes: dict[int, ImageSize] = {}
    models: list[bool] = []
    for file in files:
        if not file.ends_with(*STORAGES):
            continue
        for key, known in NAMES.items():
            if (node := find_node(file.storage, known)) is not None:
                matrices[key] = matrix_of(node, key, file.name)
        if (stated := stated_lens_model(file.storage, file.name)) is not None:
            models.append(stated)
        for k in (0, 1):
            if (size := image_size_in(file.storage, file.name, str(k + 1))) is not None:
                sizes[k] = size
    missing = [key for key in NAMES if key not in matrices]
    lacks = (
        f"{source}: {', '.join(missing)} missing; OpenCV's stereo files have M1, D1, M2, D2 "
        "(intrinsics.yml) and R, T (extrinsics.yml)."
    )
    if set(missing) - {"R", "T"}:
        raise StereocalError(lacks)
    model = models[0] if models else None
    cameras = []
    for k, which in enumerate(CAMERAS):
        K, lens, where = matrices[f"M{k + 1}"], matrices[f"D{k + 1}"], f"{source}, {which}"
        cameras.append(camera_from(K, lens, sizes.get(k), model, options, k, where))
    pose = None if missing else pose_from(matrices["R"], matrices["T"], source)
    return ForeignPair(cameras[0], cameras[1], pose, lacks)


def write_kalibr(cameras: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`camchain.yaml`; its `T_cn_cnm1` is `secondary_from_primary`, as ours."""
    names = ", ".join(f"cam{k} is the {name} camera" for k, (name, _, _) in enumerate(cameras))
    text = header(
        "#",
        f"{names}; T_cn_cnm1 takes the camera before to each.",
        "intrinsics: fu fv pu pv; distortion_coeffs: k1 k2 p1 p2, of equidistant k1 k2 k3 k4;",
        "the centre of the top-left pixel is (0, 0).",
    )
    for k, (which, camera, pose) in enumerate(cameras):
        K = camera.K
        text += f"cam{k}:\n"
        if k:
            step = pose @ cameras[k - 1][2].inverse()
            transform = np.vstack([np.column_stack([step.R, step.T]), [0, 0, 0, 1]])
            text += "  T_cn_cnm1:\n" + "".join(f"  - {numbers(row)}\n" for row in transform)
        text += (
            "  camera_model: pinhole\n"
            f"  intrinsics: {numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])}\n"
            f"  distortion_model: {'equidistant' if camera.is_fisheye else 'radtan'}\n"
            f"  distortion_coeffs: {numbers(camera.distortion)}\n"
            f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"  rostopic: /{which}/image_raw\n"
        )
    return {"camchain.yaml": text.encode()}


def kalibr_names(file: ForeignFile) -> tuple[str, ...]:
    """Names of the cameras of a camchain, in its order; empty for another file."""
    if not file.ends_with(".yaml", ".yml"):
        return ()
    names = [key for key in file.storage if key.startswith("cam") and key[3:].isdecimal()]
    return tuple(sorted(names, key=lambda key: int(key[3:])))


def read_kalibr(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras of a camchain; the pose is known if the chain between them is whole."""
    file = only_file(files, (".yaml", ".yml"), source)
    data, names = file.storage, kalibr_names(file)
    chosen = chosen_pair(names, options.cameras, file.name)
    primary, secondary = (
        _kalibr_camera(data[name], k, options, f"{file.name}, {name}")
        for k, name in enumerate(chosen.names)
    )
    camera_numbers = [int(name[3:]) for name in names]
    if camera_numbers != list(range(camera_numbers[0], camera_numbers[0] + len(camera_numbers))):
        raise StereocalError(
            f"{file.name}: a chain without gaps is expected; the file has {', '.join(names)[:200]}."
        )
    first, last = sorted(chosen.pair)
    pose: Pose | None = AT_ORIGIN
    for key in names[first + 1 : last + 1]:
        step = data[key].get("T_cn_cnm1") if isinstance(data[key], dict) else None
        if pose is not None:
            pose = None if step is None else pose_from(step, None, f"{file.name}, {key}") @ pose
    if pose is not None and chosen.pair[0] == last:
        pose = pose.inverse()
    no_pose = f"{file.name}: T_cn_cnm1, the pose of a camera, is missing."
    return ForeignPair(primary, secondary, pose, no_pose, "Kalibr", chosen)


def _kalibr_camera(data: Any, k: int, options: ExchangeOptions, source: str) -> Camera:
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a camera.")
    # Coefficients without a model are an error, not a lens without distortion.
    usual = "none" if data.get("distortion_coeffs") is None else "no distortion_model"
    model, distortion = data.get("camera_model"), data.get("distortion_model", usual)
    if model != "pinhole" or distortion not in ("radtan", "none", *FISHEYE):
        raise StereocalError(
            f"{source}: the camera is {model} with {distortion}; only pinhole with radtan, "
            "equidistant or none is supported. Calibrate with --models pinhole-radtan or "
            "pinhole-equi."
        )
    K = camera_matrix(*array_of(data.get("intrinsics"), (4,), "intrinsics", source))
    lens = np.zeros(4)
    if distortion != "none":
        lens = array_of(data.get("distortion_coeffs"), (4,), "distortion_coeffs", source)
    size = data.get("resolution")
    return camera_from(K, lens, size, distortion in FISHEYE, options, k, source)


OPENCV = ExchangeFormat(
    "OpenCV (intrinsics.yml, extrinsics.yml)",
    read_opencv,
    is_opencv,
    write=write_opencv,
    skew="ignored",
)
KALIBR = ExchangeFormat(
    "Kalibr (camchain.yaml)",
    read_kalibr,
    lambda file: bool(kalibr_names(file)),
    kalibr_names,
    unit="m",
    write=write_kalibr,
    of_rigs=True,
    skew="refused",
    coefficients=4,
)
