"""What the readers of other programs' camera files share: a file, its numbers, two cameras."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import rq

from stereocal.errors import StereocalError, naming
from stereocal.formats.camera_file import agreed_size, lens_model_of, read_camera
from stereocal.formats.exchange.chosen_cameras import ChosenPair
from stereocal.formats.exchange.options import ExchangeOptions, ImageSize, Unit, metres_per_unit
from stereocal.formats.file_storage import ForeignFile
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.rig.rotations import ROTATION_TOLERANCE
from stereocal.system.arrays import LARGEST

ONE_LENS = "one lens for both cameras"
STORAGES = (".yaml", ".yml", ".xml", ".json")
Files = Sequence[ForeignFile]


@dataclass(frozen=True, eq=False)
class CameraPair:
    """Two cameras of another program's files, and their pose if it is known."""

    primary: Camera
    secondary: Camera
    pose: Pose | None
    """`secondary_from_primary`, in the unit of the file."""
    no_pose: str = ""
    """Why there is no pose, for an error."""
    program: str = ""
    words: str = ""
    """Which cameras they are."""
    chosen: ChosenPair | None = None
    """The cameras taken, if a file can have any number of them."""
    stated: Unit | None = None
    """Unit of the file, if it states one."""
    usual: Unit | None = None
    """Unit of all files of this program."""
    files: tuple[str, str] | None = None
    """The files of the primary and the secondary, if each has its own."""
    notes: tuple[str, ...] = ()
    """What the reader has to tell."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user is told."""
        error = 0.0 if self.pose is None else self.pose.rounding
        found = self.notes + (self.chosen.remarks if self.chosen else ())
        if error <= ROTATION_TOLERANCE:
            return found
        return (
            *found,
            f"A rotation in the files is one to {error:.1g} only, as with three or four decimals: "
            f"the nearest was taken, which may be wrong by {np.degrees(error / 2):.1g} degrees.",
        )

    def scale(self, baseline: float, unit: Unit | None, source: str) -> float:
        """Metres per unit of the file; `unit` is stated by the user.

        Raises:
            UnitError: the unit is not known, or implausible.
        """
        return metres_per_unit(baseline, self.stated, unit, self.usual, source)

    def rig(self, options: ExchangeOptions, source: str) -> Rig:
        """The rig in metres."""
        names = self.chosen.cameras if self.chosen else ()
        if len(names) > 2 and options.cameras is None:
            raise StereocalError(
                f"two cameras are expected; the file has {len(names)} ({', '.join(names)[:200]}): "
                "choose two.",
                source,
                option="--cameras, as --cameras 1,2",
            )
        if self.pose is None:
            raise StereocalError(self.no_pose)
        scale = self.scale(self.pose.baseline, options.unit, source)
        return Rig(self.primary, self.secondary, Pose(self.pose.R, scale * self.pose.T))


@dataclass(frozen=True)
class CameraFormat:
    """How the camera files of a program are read."""

    title: str
    read: Callable[[Files, ExchangeOptions, str], CameraPair]
    recognises: Callable[[ForeignFile], bool] | None = None
    """Whether a file is of this format; None: files are not recognised, but read by its name."""
    names: Callable[[ForeignFile], tuple[str, ...]] | None = None
    """Names of the cameras, if a file can have any number of them."""
    one_camera: bool = False
    """Whether each file has one camera."""
    unit: Unit | None = None
    """Unit of all its files, by its documentation."""


def lenses_of(files: Files, options: ExchangeOptions, no_pose: str) -> CameraPair:
    """The lenses of two files of one camera each, or of one file for both.

    Args:
        no_pose: why there is no pose.
    """
    cameras = [
        read_camera(file.content, file.name, options.lens_model, size)
        for file, size in zip(files, options.image_sizes, strict=False)
    ]
    words, names = ONE_LENS * (len(files) == 1), (files[0].name, files[-1].name)
    return CameraPair(cameras[0], cameras[-1], None, no_pose, "camera files", words, files=names)


def only_file(files: Files, endings: tuple[str, ...], source: str) -> ForeignFile:
    """The only file, or the only one with one of these endings."""
    fitting = [file for file in files if file.ends_with(*endings)] or files
    if len(fitting) != 1:
        raise StereocalError(
            f"one file that ends with {' or '.join(endings)} is expected; there are "
            f"{len(fitting)}.",
            source,
        )
    return fitting[0]


def array_of(value: Any, shape: tuple[int, ...], what: str, source: str) -> FloatArray:
    """Numbers from a file as an array of `shape`; -1 in it is any length."""
    try:
        found = np.array(value, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError) as error:
        size = "x".join("n" if side < 0 else str(side) for side in shape)
        raise StereocalError(f"{what} is not a table of {size} numbers.", source) from error
    if not np.isfinite(found).all():
        raise StereocalError(f"{what} has a number that is not finite.", source)
    if (np.abs(found) > LARGEST).any():
        raise StereocalError(f"{what} has a number that is too large.", source)
    return found


def size_of(value: Any, options: ExchangeOptions, k: int, source: str) -> ImageSize:
    """The image size of camera `k`: the file's (`value`), or else the user's."""
    stated = None
    if value is not None:
        width, height = (int(side) for side in array_of(value, (2,), "the image size", source))
        stated = width, height
    return agreed_size(stated, options.image_sizes[k], source, f" of the {CAMERAS[k]} camera")


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    """K without skew."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def camera_from(
    K: Any,
    distortion: Any,
    size: Any,
    stated: object,
    options: ExchangeOptions,
    k: int,
    source: str,
) -> Camera:
    """Camera `k`, 0 or 1, of what a file has.

    Args:
        size: width and height; None if the file does not state it.
        stated: the lens model, as for `lens_model_of`.
        source: what errors begin with.
    """
    coefficients = array_of(distortion, (-1,), "the distortion", source)
    model = lens_model_of(coefficients, stated, options.lens_model, source)
    image_size = size_of(size, options, k, source)
    matrix = array_of(K, (3, 3), "the camera matrix", source)
    with naming(source):
        return Camera(matrix, coefficients, image_size, model=model)


def pose_from(R: Any, T: Any, source: str) -> Pose:
    """The pose of what a file has: 3x3 and 3 numbers, or 4x4 numbers in `R` if there is no `T`.

    A rotation with few decimals is replaced by the nearest, as `Pose.nearest`.
    """
    if T is None:
        whole = array_of(R, (4, 4), "the pose", source)
        R, T = whole[:3, :3], whole[:3, 3]
    rotation, shift = array_of(R, (3, 3), "R", source), array_of(T, (3,), "T", source)
    with naming(source):
        return Pose.nearest(rotation, shift)


def decomposed(P: FloatArray, source: str) -> tuple[FloatArray, Pose]:
    """K and pose of a projection matrix K [R | t], of any scale and sign."""
    largest = float(np.abs(P).max())
    scale = float(np.linalg.norm(P[2, :3])) if largest < LARGEST else 0.0
    if largest >= LARGEST * scale or abs(np.linalg.det(P[:, :3] / scale)) < 1e-9:
        raise StereocalError("this is not the projection matrix of a camera.", source)
    P = P / scale * np.sign(np.linalg.det(P[:, :3]))
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    if np.diag(K).min() < 1e-12 * np.abs(K).max():
        raise StereocalError("this is not the projection matrix of a camera.", source)
    t = np.linalg.solve(K, P[:, 3])
    K /= K[2, 2]
    K[[1, 2, 2], [0, 0, 1]] = 0.0
    K[2, 2] = 1.0
    return K, pose_from(R, t, source)
