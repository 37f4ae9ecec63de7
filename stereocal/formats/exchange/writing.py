"""What the writers of other programs' camera files share: the lens they can hold, and numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import CameraFormat
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.system.numbers import rounded
from stereocal.version import __version__

Posed = tuple[str, Camera, Pose]
"""A camera's name, lens, and pose from the first camera."""
OUR_UNIT = "lengths in metres"
"""Text in all files that stereocal writes, except DLT coefficients."""
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
NEGLIGIBLE_PX = 0.02
"""Far below the precision of any detected target."""
GRID = 41


@dataclass(frozen=True, kw_only=True)
class ExchangeFormat(CameraFormat):
    """A format that is written too."""

    write: Callable[[Sequence[Posed], ExchangeOptions], dict[str, bytes]]
    """Cameras as of `fitting` in, files by name out."""
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

    def fitting(self, posed: Posed) -> Posed:
        """A camera with the number of coefficients that the format has, padded with zeros.

        If the lens has more, and the format 4 or 5, coefficients are refitted, provided that no
        pixel moves by more than `NEGLIGIBLE_PX`.
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
        padded = np.zeros(14)
        padded[: len(camera.distortion)] = camera.distortion
        if not padded[count:].any():
            return which, replace(camera, distortion=padded[:count], uncertainty=None), pose
        further = count + int(np.flatnonzero(padded[count:])[0])
        difference = ""
        if count in (4, 5):
            fitted, worst = fewer_coefficients(camera, count)
            if worst <= NEGLIGIBLE_PX:
                return which, replace(camera, distortion=fitted, uncertainty=None), pose
            difference = f", and without it points would move by up to {rounded(worst)} px"
        name = COEFFICIENTS[further]
        raise StereocalError(
            f"{self.program} supports only {' '.join(COEFFICIENTS[:count])} of a lens; that of the "
            f"{which} camera also has {name} = {padded[further]:g}{difference}. Calibrate the lens "
            f"with {name} fixed at 0, or choose another format."
        )


def fewer_coefficients(camera: Camera, count: int) -> tuple[FloatArray, float]:
    """The best k1 k2 p1 p2 [k3] for a lens with more, and the largest difference in px.

    Linear least squares on a grid of pixels: the model without denominator is linear in them.
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
