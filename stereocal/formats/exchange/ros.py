"""ROS: camera_info files, and messages as `rostopic echo` and `ros2 topic echo` print them.

A point x of the first camera's rectified frame is at P x in the image that a projection matrix P is
of. Of a rectified pair, P = K' [I | t], and the rectification matrix turns the camera into that
frame. Other programs write P = K [R | t] of the camera itself, with the rectification I.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.camera_format import (
    STORAGES,
    ExchangeFormat,
    Files,
    ForeignPair,
    Posed,
    array_of,
    decomposed,
    header,
    lenses_of,
    named_as_both,
    numbers,
    pose_from,
)
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.yaml_formats import rectification
from stereocal.formats.file_storage import ForeignFile, find_node
from stereocal.formats.lens_nodes import K_NAMES
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray

P_NAMES = ("projection_matrix", "P", "p")
R_NAMES = ("rectification_matrix", "R", "r")
"""In files, in ROS 1 and in ROS 2."""
MESSAGE = re.compile(rb"^(K|k|camera_matrix):", re.MULTILINE)
MOST_SKEW, MOST_DIFFERENT = 0.01, 0.5
"""Limits of a projection matrix with a rotation: its skew by its focal length, and the difference
of its camera matrix from the camera's own."""


def write_ros(two: Sequence[Posed], _: ExchangeOptions) -> dict[str, bytes]:
    """`primary.yaml` and `secondary.yaml`."""
    R1, R2, P1, P2, _Q = rectification(two)
    files = {}
    for (which, camera, _pose), R, P in zip(two, (R1, R2), (P1, P2), strict=True):
        model, coefficients = "equidistant", camera.distortion
        if not camera.is_fisheye:
            model = "rational_polynomial" if coefficients[5:].any() else "plumb_bob"
            coefficients = coefficients if coefficients[5:].any() else coefficients[:5]
        width, height = camera.image_size
        text = header(
            "#",
            f"The {which} camera of the pair. The centre of the top-left pixel is (0, 0).",
            "The pair's R and T are not in it as such: R = R2^T R1 and",
            "T = R2^T (P2[0,3] / P2[0,0], P2[1,3] / P2[1,1], 0) from the rectification matrices.",
        )
        text += (
            f"image_width: {width}\nimage_height: {height}\ncamera_name: {which}\n"
            + _table("camera_matrix", camera.K)
            + f"distortion_model: {model}\n"
            + _table("distortion_coefficients", coefficients[None])
            + _table("rectification_matrix", R)
            + _table("projection_matrix", P)
        )
        files[f"{which}.yaml"] = text.encode()
    return files


def _table(name: str, values: FloatArray) -> str:
    rows, columns = values.shape
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {numbers(values)}\n"


def is_ros(file: ForeignFile) -> bool:
    """Whether it is a camera_info file or message."""
    if not file.ends_with(*STORAGES) and not (
        file.ends_with(".txt") and MESSAGE.search(file.content)
    ):
        return False
    if "format" in file.storage:
        return False
    return all(find_node(file.storage, names) is not None for names in (K_NAMES, P_NAMES))


def read_ros(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """The cameras of two camera_info files, or one lens for both; their pose if it is in them."""
    files = [file for file in files if file.ends_with(*STORAGES, ".txt")]
    no_pose = (
        f"{source}: two camera_info files are expected, there are {len(files)}: use their folder."
    )
    if not 1 <= len(files) <= 2:
        raise StereocalError(no_pose)
    pose, notes = None, list[str]()
    if len(files) == 2:
        if options.cameras is None and not options.in_order:  # the left camera has no baseline
            files.sort(key=lambda file: bool(_numbers(file, P_NAMES, (3, 4))[:, 3].any()))
        named = {file.name: file for file in files}
        names, order = named_as_both([*named], options, "the folder")
        files, notes = [named[name] for name in names], [*order]
        try:
            pose = _pose_of_pair(files, source, notes)
        except StereocalError as error:  # cameras that were calibrated one by one
            no_pose = str(error)
    lenses = replace(lenses_of(files, options, no_pose), notes=tuple(notes))
    return lenses if pose is None else replace(lenses, pose=pose, program="ROS")


def _pose_of_pair(files: Files, source: str, notes: list[str]) -> Pose:
    """The secondary from the primary; adds to `notes` how it was read."""
    poses = [_from_world(file) for file in files]
    shifted = [bool(np.abs(pose.T).max() > 0) for pose, _ in poses]
    if not any(shifted) or (all(shifted) and not any(turned for _, turned in poses)):
        raise StereocalError(
            f"{source}: the projection matrices are not those of a stereo pair: one must have a "
            "last column of zeros, the other the baseline."
        )
    if turned := [file.name for file, (_, turned) in zip(files, poses, strict=True) if turned]:
        notes.append(
            f"The projection matrix of {' and '.join(turned)} has a rotation in it, as K [R | t] "
            "has: the pose was taken from it."
        )
    (first, _), (second, _) = poses
    return second @ first.inverse()


def _from_world(file: ForeignFile) -> tuple[Pose, bool]:
    """The camera from the frame of the pair, and whether the projection matrix turns into it."""
    P = _numbers(file, P_NAMES, (3, 4))
    turns = P[1, 0] != 0 or not np.array_equal(P[2, :3], [0, 0, 1])
    has_own = not turns or find_node(file.storage, R_NAMES) is not None
    R = _numbers(file, R_NAMES, (3, 3)) if has_own else np.eye(3)
    if not turns:
        if not (P[0, 0] > 0 and P[1, 1] > 0):
            raise StereocalError(
                "the focal lengths of its projection matrix are not above 0.", file.name
            )
        shift = np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), dtype=np.float64)
        still = pose_from(R.T, np.zeros(3), f"{file.name}, {R_NAMES[0]}")
        return still @ Pose(np.eye(3), shift), False
    K, pose = decomposed(P, f"{file.name}, {P_NAMES[0]}")
    if np.abs(R - np.eye(3)).max() > 0:
        raise StereocalError(
            "its projection matrix has a rotation in it, and its rectification matrix another: "
            "what they mean together is not known.",
            file.name,
        )
    K_of_file = _numbers(file, K_NAMES, (3, 3))
    different = np.abs(K - K_of_file).max() / K_of_file[0, 0]
    if abs(K[0, 1]) > MOST_SKEW * K[0, 0] or not different < MOST_DIFFERENT:
        raise StereocalError(
            "its projection matrix is neither that of a rectified camera nor K [R | t] of its own "
            "camera matrix.",
            file.name,
        )
    return pose, True


def _numbers(file: ForeignFile, names: Sequence[str], shape: tuple[int, ...]) -> FloatArray:
    table = find_node(file.storage, names)
    if table is None:
        raise StereocalError(f"{names[0]} is missing.", file.name)
    values = table.get("data") if isinstance(table, dict) else table
    return array_of(values, shape, names[0], file.name)


ROS = ExchangeFormat(
    "ROS (two camera_info files)",
    read_ros,
    is_ros,
    one_camera=True,
    unit="m",
    write=write_ros,
    skew="ignored",
    coefficients=8,
)
