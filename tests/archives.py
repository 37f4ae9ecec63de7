"""Files of other programs: those that were once misread, and with the cameras of the known rig."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import savemat

from stereocal.formats.archives.archive import Archive
from stereocal.formats.exchange.dlt import dlt_coefficients
from stereocal.formats.exchange.exchange import export_files
from stereocal.formats.exchange.matlab import FIRST_PIXEL
from stereocal.formats.exchange.options import ExchangeOptions, PixelOrigin
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tests.rigs.known_rig import BAR_M, PRIMARY, RIG, SECONDARY, bar_ends, images

CASES = Path(__file__).parent / "cases"
LOWER_LEFT = PixelOrigin("lower-left")
WORLD = Pose.from_angles(RIG.angles, 3.3)
"""Primary from easyWand's world."""
BACKGROUND = np.array([[-2.0, 0.5, 9.0], [1.1, -0.7, 12.0], [0.3, 1.2, 15.0], [2.0, 0.1, 11.0]])


def case(folder: str, *names: str) -> dict[str, bytes]:
    """Files that were once misread."""
    return {name: (CASES / folder / name).read_bytes() for name in names}


def focal(found: Archive) -> tuple[float, float]:
    """The focal lengths of both cameras."""
    assert found.primary is not None and found.secondary is not None
    return float(found.primary.K[0, 0]), float(found.secondary.K[0, 0])


def lens(camera: Camera) -> tuple[float, FloatArray, FloatArray]:
    """One focal length, the principal point from the bottom, and the five coefficients."""
    u, v = camera.K[0, 2], camera.image_size[1] - camera.K[1, 2]
    k = np.zeros(5)
    k[: len(camera.distortion)] = camera.distortion
    k[2] *= -1.0
    return float(camera.K[0, 0]), np.array([u, v]), k


def easywand_camera(camera: Camera) -> Camera:
    """The camera as easyWand can have it: one focal length, no skew."""
    focal = camera.K[0, 0]
    K = np.array([[focal, 0, camera.K[0, 2]], [0, focal, camera.K[1, 2]], [0, 0, 1.0]])
    return Camera(K, camera.distortion, camera.image_size)


def from_bottom(points: FloatArray, camera: Camera) -> FloatArray:
    matrix = LOWER_LEFT.matrix(camera.image_size[1])
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])


def in_both(points: FloatArray) -> list[FloatArray]:
    """The images of points in both cameras, from the bottom."""
    cameras = zip(images(points), (PRIMARY, SECONDARY), strict=True)
    return [from_bottom(side, camera) for side, camera in cameras]


def wand_table(frames: int, more_cameras: int = 0) -> FloatArray:
    """(frames, 4 cameras): end A in all cameras, then end B; frame 3 lacks B in the secondary."""
    sides = in_both(bar_ends(frames))
    sides += [np.full_like(sides[0], np.nan)] * more_cameras
    table = np.hstack([side[0::2] for side in sides] + [side[1::2] for side in sides])
    second_end = 2 * len(sides) + 2
    table[2, second_end : second_end + 2] = np.nan
    return table


def easywand_fields(frames: int = 12, more_cameras: int = 0) -> dict[str, Any]:
    """The fields of the struct, as the program's documentation names them."""
    cameras = [PRIMARY, SECONDARY, *[PRIMARY] * more_cameras]
    focal, centres, lenses = zip(*map(lens, cameras), strict=True)
    width, height = np.array([camera.image_size for camera in cameras], np.float64).T
    static = in_both(BACKGROUND) + [np.full((len(BACKGROUND), 2), np.nan)] * more_cameras
    poses, options = (
        [WORLD, RIG @ WORLD, *[WORLD] * more_cameras],
        ExchangeOptions(corner="lower-left"),
    )
    coefficients = [
        dlt_coefficients(easywand_camera(camera), pose, options)
        for camera, pose in zip(cameras, poses, strict=True)
    ]
    return {
        "wandPts": wand_table(frames, more_cameras),
        "backgroundPts": np.hstack(static),
        "axisPts": np.zeros((0, 0)),
        "gravityFreq": np.zeros((0, 0)),
        "wandLen": BAR_M,
        "focalLengths": np.array(focal),
        "principalPoints": np.concatenate(centres),
        "imageWidth": width,
        "imageHeight": height,
        "nlin": np.array(lenses),
        "coefs": np.column_stack(coefficients),
        "rotationMatrices": np.zeros((3, 3, len(cameras))),
        "translationVector": np.zeros((1, 3, len(cameras))),
        "wandScore": 0.6,
        "dwand": np.full(frames, BAR_M),
    }


def mat(variables: Mapping[str, Any], compressed: bool = True) -> bytes:
    """A .mat file of version 5 (compressed: 7)."""
    file: Any = io.BytesIO()
    savemat(file, dict(variables), do_compression=compressed)
    return bytes(file.getvalue())


def wand_csv(frames: int = 12, more_cameras: int = 0) -> bytes:
    """The same points as Argus and easyWand write them as CSV."""
    count = 2 + more_cameras
    names = [f"cam{k}_{axis}" for _ in "AB" for k in range(count) for axis in "xy"]
    rows = [",".join(map(repr, map(float, row))) for row in wand_table(frames, more_cameras)]
    return "\n".join([",".join(names), *rows]).encode() + b"\n"


def stereo_struct() -> dict[str, Any]:
    """What `toStruct(stereoParams)` gives in MATLAB, whose first pixel is (1, 1)."""

    def camera(own: Camera) -> dict[str, Any]:
        k1, k2, p1, p2, k3 = [*own.distortion, 0.0][:5]
        return {
            "RadialDistortion": np.array([k1, k2, k3]),
            "TangentialDistortion": np.array([p1, p2]),
            "ImageSize": np.array(own.image_size[::-1], dtype=np.float64),
            "WorldUnits": "meters",
            "IntrinsicMatrix": (own.K + FIRST_PIXEL).T,
        }

    return {
        "CameraParameters1": camera(PRIMARY),
        "CameraParameters2": camera(SECONDARY),
        "RotationOfCamera2": RIG.R.T,
        "TranslationOfCamera2": RIG.T,
    }


PLAIN = Rig(
    Camera(PRIMARY.K, PRIMARY.distortion[:4], PRIMARY.image_size),
    Camera(
        SECONDARY.K - [[0, SECONDARY.K[0, 1], 0], [0, 0, 0], [0, 0, 0]],
        SECONDARY.distortion[:4],
        SECONDARY.image_size,
    ),
    RIG,
)
"""Without skew and k3, which Kalibr has not."""


def toml_row(values: Any) -> str:
    return repr(np.asarray(values).tolist())


def caliscope(names: tuple[str, ...], rotation: Any) -> bytes:
    text, cameras, poses = "", (PRIMARY, PRIMARY, SECONDARY), (RIG.inverse(), RIG @ RIG, RIG)
    for name, camera, pose in zip(names, cameras, poses, strict=True):
        text += (
            f"[{name}]\nsize = {list(camera.image_size)}\nrotation_count = 0\n"
            f"matrix = {toml_row(camera.K)}\n"
            f"distortions = {toml_row([*camera.distortion, 0.0][:5])}\n"
            f"rotation = {toml_row(rotation(pose))}\ntranslation = {toml_row(pose.T)}\n"
        )
    return text.encode()


def caliscope_files() -> list[bytes]:
    """Three cameras in Caliscope's newer file and in its older one."""
    newer = caliscope(
        ("cameras.0", "cameras.1", "cameras.2"), lambda pose: cv2.Rodrigues(pose.R)[0].ravel()
    )
    older = caliscope(("cam_0", "cam_1", "cam_2"), lambda pose: pose.R)
    older += b"[charuco]\ncolumns = 4\n[stereo_0_1]\nrotation = [[1.0]]\nRMSE = 1.0\n"
    return [newer, older]


def kalibr_chain() -> bytes:
    """Three cameras; the third stands to the second as the second to the first."""
    text = export_files(PLAIN, "kalibr")["camchain.yaml"].decode()
    return (text + text[text.index("cam1:") :].replace("cam1:", "cam2:")).encode()
