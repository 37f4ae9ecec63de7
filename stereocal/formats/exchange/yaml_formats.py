"""Camera files in YAML: OpenCV's stereo sample, and Kalibr's camchain."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import camera_of, five_or_more
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
    known_pose,
    number,
    numbers,
    only_file,
    pose_from,
    stated_unit,
)
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.file_storage import ForeignFile, Storage, find_node, matrix_of
from stereocal.formats.lens_nodes import (
    FISHEYE,
    K_NAMES,
    R_NAMES,
    T_NAMES,
    cameras_among,
    has_matrix,
    nodes_of_all,
    what_is_in,
)
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.system.array_types import FloatArray
from stereocal.system.zip_files import is_npz


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
    """Whether it has lenses or a pose of a pair, and not the lens of a single camera."""
    if not file.ends_with(*STORAGES) and not is_npz(file.content):
        return False
    if "format" in file.storage or has_matrix(file.storage) or is_kalibr(file):
        return False
    posed = any(find_node(file.storage, names) is not None for names in (R_NAMES[:3], T_NAMES[:3]))
    return posed or [*cameras_among(file.storage)] not in ([], [""])


def _in_all(files: Files) -> Storage:
    """The nodes of all files, as of `intrinsics.yml` and `extrinsics.yml`."""
    nodes: dict[str, Any] = {}
    for file in files:
        if file.ends_with(*STORAGES) or is_npz(file.content):
            nodes |= file.storage
    return nodes


def read_opencv(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras from one or several files; their pose if R and T are there."""
    tree = _in_all(files)
    cameras = cameras_among(tree)
    if len(cameras) < 2:
        raise StereocalError(
            f"two cameras are expected, and {len(cameras)} found ({what_is_in(tree)}). OpenCV's "
            "stereo files have M1, D1, M2, D2 (intrinsics.yml) and R, T (extrinsics.yml); K_left, "
            "dist_left and the like are read too.",
            source,
        )
    chosen = chosen_pair([*cameras], options.cameras, source)
    lenses = [
        camera_of(cameras[name], f"{source}, {name}", options.lens_model, size, tree)
        for name, size in zip(chosen.names, options.image_sizes, strict=True)
    ]
    of_pair = nodes_of_all(tree)
    R, T = (find_node(of_pair, names) for names in (R_NAMES, T_NAMES))
    missing = ", ".join(name for name, node in (("R", R), ("T", T)) if node is None)
    lacks = (
        f"{missing} missing ({what_is_in(tree)}); OpenCV's stereo files have R, T (extrinsics.yml)."
    )
    if len(cameras) > 2:
        lacks = "it is not said of which two cameras its R and T are."
    elif missing and all(find_node(cameras[name], R_NAMES) is not None for name in chosen.names):
        lacks = "each camera has an R of its own, and it is not said from what to what."

    def pose() -> Pose | None:
        if missing or len(cameras) > 2:
            return None
        stated = pose_from(_values(R), _values(T), source)
        return stated.inverse() if chosen.pair == (1, 0) else stated

    known, no_pose, bad = known_pose(pose, f"{source}: {lacks}")
    pair = ForeignPair(lenses[0], lenses[1], known, no_pose, notes=bad, stated=stated_unit(tree))
    return replace(pair, chosen=chosen if len(cameras) > 2 or options.cameras else None)


def _values(node: Any) -> Any:
    """The numbers of a matrix, of which a wrong number is none."""
    return matrix_of(node, "R or T", "") if isinstance(node, dict) else node


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


def is_kalibr(file: ForeignFile) -> bool:
    """Whether it is a camchain, and no script's file with a matrix of `cam0`."""
    nodes = [file.storage[name] for name in kalibr_names(file)]
    matrices = [find_node(node, K_NAMES) for node in nodes if isinstance(node, dict)]
    return bool(nodes) and all(matrix is None for matrix in matrices)


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
    lacks = f"{file.name}: T_cn_cnm1, the pose of a camera, is missing."

    def along_the_chain() -> Pose | None:
        pose = AT_ORIGIN
        for key in names[first + 1 : last + 1]:
            step = data[key].get("T_cn_cnm1") if isinstance(data[key], dict) else None
            if step is None:
                return None
            pose = pose_from(step, None, f"{file.name}, {key}") @ pose
        return pose.inverse() if chosen.pair[0] == last else pose

    pose, no_pose, bad = known_pose(along_the_chain, lacks)
    pair = ForeignPair(primary, secondary, pose, no_pose, "Kalibr", chosen, notes=bad)
    return replace(pair, stated=stated_unit(data))


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
    names=lambda file: tuple(cameras_among(file.storage)),
)
KALIBR = ExchangeFormat(
    "Kalibr (camchain.yaml)",
    read_kalibr,
    is_kalibr,
    kalibr_names,
    unit="m",
    write=write_kalibr,
    of_rigs=True,
    skew="refused",
    coefficients=4,
)
