"""What readers and writers of other programs' camera files share: two cameras, lenses, numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any, Literal

import numpy as np
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError, naming
from stereocal.formats.camera_file import agreed_size, lens_model_of, read_camera
from stereocal.formats.exchange.chosen_cameras import ChosenPair, chosen_pair
from stereocal.formats.exchange.options import (
    ExchangeOptions,
    ImageSize,
    Unit,
    metres_per_unit,
    unit_called,
)
from stereocal.formats.file_storage import ForeignFile, Storage, find_node
from stereocal.formats.lens_nodes import UNIT_NAMES, count, nodes_of_all
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import ROTATION_TOLERANCE, Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.system.arrays import LARGEST
from stereocal.system.numbers import rounded
from stereocal.version import __version__

ONE_LENS = "one lens for both cameras"
STORAGES = (".yaml", ".yml", ".xml", ".json", ".npz")
Files = Sequence[ForeignFile]


@dataclass(frozen=True, eq=False)
class ForeignPair:
    """Two cameras of another program's files, and their pose if it is known."""

    primary: Camera
    secondary: Camera
    pose: Pose | None
    """`secondary_from_primary`, in the unit of the file."""
    no_pose: str = ""
    """Why there is no pose, for an error."""
    program: str = ""
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
    called: str = ""
    """Which cameras they are, where none were chosen."""

    @property
    def words(self) -> str:
        """Which cameras they are."""
        return self.chosen.words if self.chosen else self.called

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the user is told."""
        error = 0.0 if self.pose is None else self.pose.rounding
        remarks = self.notes + (self.chosen.remarks if self.chosen else ())
        width, height = self.primary.image_size
        if self.primary.is_height_first and self.secondary.is_height_first:
            remarks += (
                "The image size seems to be given as height and width: the image centres are those "
                f"of {height}x{width} px. Write the width first.",
            )
        if error <= ROTATION_TOLERANCE:
            return remarks
        return (
            *remarks,
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
    read: Callable[[Files, ExchangeOptions, str], ForeignPair]
    recognises: Callable[[ForeignFile], bool] | None = None
    """Whether a file is of this format; None: files are not recognised, but read by its name."""
    names: Callable[[ForeignFile], tuple[str, ...]] | None = None
    """Names of the cameras, if a file can have any number of them."""
    one_camera: bool = False
    """Whether each file has one camera."""
    unit: Unit | None = None
    """Unit of all its files, by its documentation."""


def lenses_of(files: Files, options: ExchangeOptions, no_pose: str) -> ForeignPair:
    """The lenses of two files of one camera each, or of one file for both.

    Args:
        no_pose: why there is no pose.
    """
    sized = zip(files, options.image_sizes, strict=False)
    cameras = [read_camera(f.content, f.name, options.lens_model, size) for f, size in sized]
    pair = ForeignPair(cameras[0], cameras[-1], None, no_pose, "camera files")
    names = files[0].name, files[-1].name
    return replace(pair, called=ONE_LENS * (len(files) == 1), files=names)


def named_as_both(
    names: Sequence[str], options: ExchangeOptions, source: str
) -> tuple[tuple[str, str], tuple[str, ...]]:
    """The primary's and the secondary's of one or two files of one camera each, and a note where
    they were not given in this order."""
    first, second = names[0], names[-1]
    if len(names) < 2 or options.in_order:
        return (first, second), ()
    if options.cameras is not None:
        stems = [str(PurePath(name).with_suffix("")) for name in names]
        first, second = (names[k] for k in chosen_pair(stems, options.cameras, source).pair)
    note = f"{first} was taken as the primary camera, {second} as the secondary."
    return (first, second), (note,)


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
        array = np.array(value, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError) as error:
        size = "x".join("n" if side < 0 else str(side) for side in shape)
        raise StereocalError(f"{what} is not a table of {size} numbers.", source) from error
    if not np.isfinite(array).all():
        raise StereocalError(f"{what} has a number that is not finite.", source)
    if (np.abs(array) > LARGEST).any():
        raise StereocalError(f"{what} has a number that is too large.", source)
    return array


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
    K: Any, lens: Any, size: Any, stated: object, options: ExchangeOptions, k: int, source: str
) -> Camera:
    """Camera `k`, 0 or 1, of what a file has.

    Args:
        lens: its distortion coefficients.
        size: width and height; None if the file does not state it.
        stated: the lens model, as for `lens_model_of`.
        source: what errors begin with.
    """
    coefficients = array_of(lens, (-1,), "the distortion", source)
    model = lens_model_of(coefficients, stated, options.lens_model, source)
    image_size = size_of(size, options, k, source)
    matrix = array_of(K, (3, 3), "the camera matrix", source)
    with naming(source):
        return Camera(matrix, coefficients, image_size, model=model)


def pose_from(R: Any, T: Any, source: str) -> Pose:
    """The pose of what a file has: 3x3 and 3 numbers, or 4x4 numbers in `R` if there is no `T`.

    Three numbers of R are a rotation vector. A rotation with few decimals is replaced by the
    nearest, as `Pose.nearest`.
    """
    if T is None:
        matrix = array_of(R, (4, 4), "the pose", source)
        R, T = matrix[:3, :3], matrix[:3, 3]
    if count(R if isinstance(R, list) else np.asarray(R).tolist()) == 3:
        vector = array_of(R, (3,), "R", source)
        if not (angle := float(np.linalg.norm(vector))) <= 2 * np.pi:
            raise StereocalError(
                f"R has three numbers, which are no rotation vector: its length is {angle:g}, and "
                f"{2 * np.pi:.4g} rad is a whole turn.",
                source,
            )
        R = Rotation.from_rotvec(vector).as_matrix()
    rotation, shift = array_of(R, (3, 3), "R", source), array_of(T, (3,), "T", source)
    with naming(source):
        return Pose.nearest(rotation, shift)


def known_pose(
    read: Callable[[], Pose | None], lacks: str
) -> tuple[Pose | None, str, tuple[str, ...]]:
    """The pose that is read, or why there is none, also as a remark if it is no pose.

    Lenses are of use without it where the baseline is measured.

    Args:
        lacks: why there is none, if none is stated.
    """
    try:
        return read(), lacks, ()
    except StereocalError as error:
        return None, str(error), (f"The pose of the cameras was not taken: {error}",)


def stated_unit(tree: Storage) -> Unit | None:
    """The unit of lengths that the nodes of a file state; None for no length's, as `px`."""
    word = find_node(nodes_of_all(tree), UNIT_NAMES)
    return unit_called(word) if isinstance(word, str) else None


def decomposed(P: FloatArray, source: str) -> tuple[FloatArray, Pose]:
    """K and pose of a projection matrix K [R | t], of any scale and sign."""
    largest = float(np.abs(P).max())
    # The third row of K R is that of R, of length 1.
    scale = float(np.linalg.norm(P[2, :3])) if largest < LARGEST else 0.0
    if largest >= LARGEST * scale or abs(np.linalg.det(P[:, :3] / scale)) < 1e-9:
        raise StereocalError("this is not the projection matrix of a camera.", source)
    P = P / scale * np.sign(np.linalg.det(P[:, :3]))  # det(K R) > 0
    K, R = rq(P[:, :3])
    # K is unique but for the signs of its columns, which are those of a positive diagonal.
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    if np.diag(K).min() < 1e-12 * np.abs(K).max():
        raise StereocalError("this is not the projection matrix of a camera.", source)
    t = np.linalg.solve(K, P[:, 3])
    K /= K[2, 2]
    K[[1, 2, 2], [0, 0, 1]] = 0.0  # exactly, below the diagonal
    K[2, 2] = 1.0
    return K, pose_from(R, t, source)


Posed = tuple[str, Camera, Pose]
"""A camera's name, lens, and pose from the first camera."""
OUR_UNIT = "lengths in metres"
"""Text in all files that stereocal writes, except DLT coefficients."""
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
NEGLIGIBLE_PX = 0.02
"""Far below the precision of any detected target."""
GRID = 41
"""Rows and columns of pixels on which a lens is refitted."""


@dataclass(frozen=True, kw_only=True)
class ExchangeFormat(CameraFormat):
    """A format that is written too."""

    write: Callable[[Sequence[Posed], ExchangeOptions], dict[str, bytes]]
    """Cameras as of `as_supported` in, files by name out."""
    of_rigs: bool = False
    """Whether any number of cameras can be written; else `primary` and `secondary`."""
    skew: Literal["kept", "ignored", "refused"] = "kept"
    """Ignored: in the file, but unused by the other program. Refused: the file has no place."""
    fisheye: bool = True
    without_lens: bool = False
    coefficients: int | None = None
    """Number of distortion coefficients, if fewer than in OpenCV's model."""

    @property
    def program(self) -> str:
        return self.title.split(" (")[0]

    def as_supported(self, posed: Posed) -> Posed:
        """A camera with the number of coefficients that the format has, padded with zeros; as it is
        if the format takes any number, and of a fisheye.

        If the lens has more, and the format 4 or 5, coefficients are refitted, provided that no
        pixel moves by more than `NEGLIGIBLE_PX`.

        Raises:
            StereocalError: the format has no place for the skew, the fisheye or a coefficient.
        """
        which, camera, pose = posed
        count = self.coefficients
        if self.skew == "refused" and camera.K[0, 1] != 0:
            raise StereocalError(
                f"{self.program} does not support skew; that of the {which} camera is "
                f"{camera.K[0, 1]:g} px."
            )
        if camera.is_fisheye and not self.fisheye:
            raise StereocalError(
                f"{self.program} has no fisheye lens (k1 k2 k3 k4), which the {which} camera has. "
                "Choose OpenCV, Kalibr, ROS, aniposelib or COLMAP."
            )
        if camera.is_fisheye or count is None:
            return posed
        padded = np.zeros(len(COEFFICIENTS))
        padded[: len(camera.distortion)] = camera.distortion
        if not padded[count:].any():
            return which, replace(camera, distortion=padded[:count], uncertainty=None), pose
        difference = ""
        if count in (4, 5):  # lenses without a denominator
            fitted, worst_px = fewer_coefficients(camera, count)
            if worst_px <= NEGLIGIBLE_PX:
                return which, replace(camera, distortion=fitted, uncertainty=None), pose
            difference = f", and without it points would move by up to {rounded(worst_px)} px"
        first_beyond = count + int(np.flatnonzero(padded[count:])[0])
        name, value = COEFFICIENTS[first_beyond], padded[first_beyond]
        raise StereocalError(
            f"{self.program} supports only {' '.join(COEFFICIENTS[:count])} of a lens; that of the "
            f"{which} camera also has {name} = {value:g}{difference}. Calibrate the lens "
            f"with {name} fixed at 0, or choose another format."
        )


def fewer_coefficients(camera: Camera, count: int) -> tuple[FloatArray, float]:
    """The best k1 k2 p1 p2 [k3] for a lens with more, and the largest difference in px.

    Linear least squares on a grid of pixels: the model without denominator is linear in them,
    x_d - x = x (k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y_d - y = y (k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

    Args:
        count: 4 or 5.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID))
    undistorted = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    undistorted = undistorted[np.isfinite(undistorted).all(axis=1)]
    x, y = undistorted.T
    r2 = x * x + y * y
    columns = [
        np.concatenate([x * r2, y * r2]),
        np.concatenate([x * r2**2, y * r2**2]),
        np.concatenate([2 * x * y, r2 + 2 * y * y]),
        np.concatenate([r2 + 2 * x * x, 2 * x * y]),
        np.concatenate([x * r2**3, y * r2**3]),
    ]
    normalised = Camera(np.eye(3), camera.distortion, camera.image_size)
    shift = (normalised.distort(undistorted) - undistorted).T.ravel()
    fitted, *_ = np.linalg.lstsq(np.column_stack(columns[:count]), shift, rcond=None)
    other = Camera(camera.K, fitted, camera.image_size)
    moved = other.distort(undistorted) - camera.distort(undistorted)
    worst = np.linalg.norm(moved, axis=1).max()
    return np.asarray(fitted, dtype=np.float64), float(worst)


def header(mark: str, *lines: str) -> str:
    """Comment lines that describe the file."""
    comments = [
        f"Written by stereocal {__version__}.",
        f"x_secondary = R x_primary + T; {OUR_UNIT}, image coordinates in pixels.",
        *lines,
    ]
    return "".join(f"{mark} {line}\n" for line in comments)


def number(value: float) -> str:
    """All digits of a float, with a point: YAML 1.1 reads `1e-05` as text."""
    text = repr(float(value))
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def numbers(values: FloatArray | Sequence[float]) -> str:
    """Numbers in brackets."""
    return "[" + ", ".join(number(value) for value in np.asarray(values).ravel()) + "]"
