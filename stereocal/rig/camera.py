"""A camera with one of OpenCV's lens models: distortion, undistortion, projection."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import combinations
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError, damaged, naming, refuse
from stereocal.rig.compiled import contiguous
from stereocal.rig.fisheye import LARGEST_ANGLE, fill_distorted, fill_undistorted, largest_angle
from stereocal.rig.geometry import homogeneous
from stereocal.rig.window import Window, rays_through, seen_through
from stereocal.system.answers import Answer
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.latest import once
from stereocal.system.records import of_plain, plain

LensModel = Literal["brown", "fisheye"]
"""OpenCV's usual lens (Brown), or the one of `fisheye`."""
CameraName = Literal["primary", "secondary"]
CAMERAS: tuple[CameraName, CameraName] = ("primary", "secondary")
LENS_UNKNOWNS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
"""The order of `Camera.lens_values` and of the correlation of a lens. The last four of a fisheye
are its k1 to k4."""
FISHEYE_UNKNOWNS = (*LENS_UNKNOWNS[:4], "k1", "k2", "k3", "k4")
LENS_MODELS: tuple[LensModel, ...] = ("brown", "fisheye")
POINTS_KEPT = 2000
"""The most points of `undistort` whose result is kept: other readings of a data set share most of
them."""
LARGEST_SIDE = 1_000_000
MAXIMUM_K = 1e9
DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
SMALLEST_EIGENVALUE = 1e-9
"""The least one of a correlation; a smaller one would make a combination of values exact."""
CENTRED, OFF_CENTRE = 0.1, 0.2
"""Usual distance of a principal point from the centre of its image, over the size of the image, and
the least of one that is not."""
SIZE_FACTOR_TOLERANCE = 1.3
"""The principal point may be this many times the image centre, or one over it, before K counts as
that of another image size."""


def camera_in_words(*names: str, begins: bool = False) -> str:
    """Such as `the primary camera`, or of a rig `camera 1` or `cameras 1 and 2`; with a capital if
    it begins a sentence."""
    of_two = not {*CAMERAS}.isdisjoint(names)
    phrases = [f"the {name}" for name in names] if of_two else names
    listed = " and ".join([", ".join(phrases[:-1]), phrases[-1]] if phrases[1:] else phrases)
    words = f"{listed} camera" if of_two else f"camera{'s' * (len(names) > 1)} {listed}"
    return words[:1].upper() + words[1:] if begins else words


@dataclass(frozen=True, eq=False)
class LensUncertainty:
    """Standard errors of the lens parameters; 0 for a parameter that was held fixed.

    Args:
        fx, fy, cx, cy: in pixels.
        distortion: one for each coefficient of the camera.
        correlation: (8, 8), of the errors of `LENS_UNKNOWNS`; None if unknown.
        without: `LENS_UNKNOWNS` (8,) without each photograph minus those of all, where the other
            camera was calibrated with the same boards; by frame, or by file name where it does not
            see the board.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: FloatArray
    correlation: FloatArray | None = None
    without: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = len(LENS_UNKNOWNS)
        distortion = _kept(self, "distortion", np.ravel(self.distortion))
        sigmas = np.array([self.fx, self.fy, self.cx, self.cy, *distortion])
        correlation = np.eye(size)
        if self.correlation is not None:
            correlation = _kept(self, "correlation", self.correlation)
        refuse(
            (
                not (np.isfinite(sigmas).all() and (sigmas >= 0).all()),
                "An uncertainty of the lens is below 0 or not a finite number.",
            ),
            (
                correlation.shape != (size, size)
                or not np.isfinite(correlation).all()
                or not np.allclose(correlation, correlation.T, atol=1e-6)
                or not np.allclose(np.diag(correlation), 1.0, atol=1e-6)
                or not np.linalg.eigvalsh(correlation)[0] > SMALLEST_EIGENVALUE,
                "The correlation of the lens must be a symmetric 8x8 table of fx, fy, cx, cy, "
                "k1, k2, p1, p2, with 1 on its diagonal and positive eigenvalues.",
            ),
            *(
                (
                    change.shape != (size,) or not np.isfinite(change).all(),
                    f'The change of the lens "without" {name} must be a list of 8 numbers.',
                )
                for name, change in self.without.items()
            ),
        )

    def to_json(self) -> dict[str, Any]:
        """The standard errors by name, as plain numbers."""
        return {name: value for name, value in plain(self).items() if value not in (None, {})}

    @classmethod
    def from_json(cls, data: Any) -> "LensUncertainty":
        """The uncertainty that `to_json` describes; other keys are ignored."""
        try:
            return of_plain(data, cls)
        except StereocalError:
            raise
        except (TypeError, ValueError, OverflowError) as error:
            raise StereocalError(
                "the uncertainty must have the numbers fx, fy, cx, cy and a list distortion."
            ) from error


def _kept(owner: object, name: str, values: npt.ArrayLike) -> FloatArray:
    """Give a frozen dataclass an array of its own that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    object.__setattr__(owner, name, array)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Answer):
    """A camera with one of OpenCV's lens models.

    Errors are in pixels of the undistorted image, K times points on the plane z = 1; those of a
    fisheye, whose undistorted image is stretched up to 15 times, in pixels of the recorded image.

    Args:
        K: (3, 3), `[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`, in pixels.
        distortion: OpenCV's coefficients k1 k2 p1 p2 [k3 [k4 k5 k6 [s1..s4 [tx ty]]]]; of a
            fisheye k1 k2 k3 k4.
        image_size: (width, height) in pixels.
        uncertainty: standard errors of fx, fy, cx, cy and the coefficients; None if unknown.
        model: of the lens.
        window: that it looks through; None in air.
    """

    K: FloatArray
    distortion: FloatArray
    image_size: tuple[int, int]
    uncertainty: LensUncertainty | None = None
    model: LensModel = "brown"
    window: Window | None = None

    def __post_init__(self) -> None:
        with damaged(
            "A camera has a matrix K and a distortion of numbers, and an image_size (w, h)."
        ):
            K, distortion = _kept(self, "K", self.K), np.ravel(self.distortion)
            if self.is_fisheye and not distortion.size:
                distortion = np.zeros(4)
            distortion = _kept(self, "distortion", distortion)
            width, height = (int(side) for side in self.image_size)
        object.__setattr__(self, "image_size", (width, height))
        refuse((K.shape != (3, 3), f"The camera matrix K must be 3x3, not {K.shape}."))
        (fx, fy), n = np.diag(K)[:2], distortion.size
        sigmas = n if self.uncertainty is None else self.uncertainty.distortion.size
        refuse(
            (
                not (np.isfinite(K).all() and np.isfinite(distortion).all()),
                "The camera has a number that is not finite (NaN or infinite).",
            ),
            (
                fx <= 0 or fy <= 0,
                f"The camera matrix K cannot be inverted: the focal lengths fx = {fx:g} and "
                f"fy = {fy:g} must both be above 0.",
            ),
            (
                np.abs(K).max() > MAXIMUM_K or min(fx, fy) < 1 / MAXIMUM_K,
                f"The camera matrix K has impossible values: fx = {fx:g}, fy = {fy:g}; they must "
                "be in pixels.",
            ),
            (
                K[1, 0] != 0 or not np.array_equal(K[2], [0, 0, 1]),
                "K is not a camera matrix: it must read [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]. "
                "Is it transposed?",
            ),
            (
                self.model not in LENS_MODELS,
                f'The lens model "{self.model}" is not known; use {" or ".join(LENS_MODELS)}.',
            ),
            (
                self.is_fisheye and n != 4,
                f"The lens has {n} distortion coefficients; a fisheye has 4, k1 k2 k3 k4.",
            ),
            (
                n not in DISTORTION_LENGTHS,
                f"The lens has {n} distortion coefficients; OpenCV's model has 4, 5, 8, 12 or 14 "
                "(or none).",
            ),
            (
                not (0 < width < LARGEST_SIDE and 0 < height < LARGEST_SIDE),
                f"The image size {width}x{height} px is not possible.",
            ),
            (
                sigmas != n,
                f"The lens has {n} distortion coefficients, but {sigmas} uncertainties for them.",
            ),
        )

    @property
    def in_words(self) -> str:
        """Size of the image and focal length."""
        width, height = self.image_size
        return f"{width} × {height} px, focal length {self.K[0, 0]:.1f} px"

    @property
    def answer(self) -> list[str]:
        (cx, cy), given = self.K[:2, 2], [f"{value:.4g}" for value in self.distortion]
        lens = "fisheye" if self.is_fisheye else "distortion"
        return [f"{self.in_words}, centre ({cx:.1f}, {cy:.1f}); {lens} {', '.join(given) or '0'}."]

    @property
    def lens_values(self) -> FloatArray:
        """(8,): the values of `LENS_UNKNOWNS`; coefficients that the camera does not have are 0."""
        distortion = np.zeros(4)
        distortion[: min(4, self.distortion.size)] = self.distortion[:4]
        K = self.K
        return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion])

    @property
    def is_fisheye(self) -> bool:
        """Whether its errors are in pixels of the recorded image."""
        return self.model == "fisheye"

    @property
    def lens_names(self) -> tuple[str, ...]:
        """Names of `lens_values`."""
        return FISHEYE_UNKNOWNS if self.is_fisheye else LENS_UNKNOWNS

    @cached_property
    def largest_angle(self) -> float:
        """From the axis, to which a fisheye can be inverted, in radians."""
        return largest_angle(self.distortion)

    def pixel_jacobians(self, normalised: npt.ArrayLike) -> FloatArray:
        """(n, 2, 2): derivatives of the pixels in which errors are by points (n, 2) of z = 1."""
        points = np.asarray(normalised, dtype=np.float64)
        if not self.is_fisheye:
            return np.tile(self.K[:2, :2], (len(points), 1, 1))
        return np.asarray(self.K[:2, :2] @ self._imaged(points)[1])

    @property
    def size_factor(self) -> float | None:
        """The size of the image that K belongs to, over `image_size`; None where they agree.

        Judged by the principal point, which lies near the centre of an image: the mean of cx and cy
        over those of the centre. They agree within `SIZE_FACTOR_TOLERANCE` either way.
        """
        centre = 0.5 * (np.array(self.image_size) - 1.0)
        principal = np.maximum(self.K[:2, 2], 1e-9)  # px; a factor above 0, so that it has a log
        factor = float(np.mean(principal / centre))
        return factor if abs(np.log(factor)) > np.log(SIZE_FACTOR_TOLERANCE) else None

    @property
    def is_height_first(self) -> bool:
        """Whether the principal point is near the centre of an image that is as wide as this one is
        high, and far from the centre of this one."""
        size = np.array(self.image_size)
        off, off_turned = (
            float(np.abs(self.K[:2, 2] / (way - 1.0) - 0.5).max()) for way in (size, size[::-1])
        )
        return off_turned < CENTRED < OFF_CENTRE < off

    def local_focal_px(self, normalised: FloatArray) -> FloatArray:
        """(n,): pixels per unit of the plane z = 1 at some of its points (n, 2), in the mean."""
        return np.asarray(np.sqrt(np.linalg.det(self.pixel_jacobians(normalised))))

    @property
    def corner_rays(self) -> FloatArray:
        """(4, 2): points of z = 1 of the image's corners, clockwise, without distortion.

        Of a fisheye with its distortion, and at most at the largest angle that is used.
        """
        right, bottom = np.array(self.image_size) - 0.5
        pixels = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
        rays = homogeneous(pixels) @ np.linalg.inv(self.K)[:2].T
        if not self.is_fisheye:
            return np.asarray(rays)
        edge = min(self.largest_angle, LARGEST_ANGLE) * (1 - 1e-9)
        limit = np.linalg.norm(self._distort(np.array([[np.tan(edge), 0.0]])))
        radius = np.linalg.norm(rays, axis=1, keepdims=True)
        return self.undistort(self._to_pixels(rays * np.minimum(1.0, limit / radius)))

    def distort(self, normalised: npt.ArrayLike) -> FloatArray:
        """Raw pixels (n, 2) of undistorted, normalised points (n, 2)."""
        return self._to_pixels(self._distort(np.asarray(normalised, dtype=np.float64)))

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Raw pixels (n, 2) of points (n, 3) in this camera's frame; NaN behind the camera, or
        before its window."""
        points = self.seen_in_air(points)
        depth = np.where(points[:, 2] > 0, points[:, 2], np.nan)
        return self.distort(points[:, :2] / depth[:, None])

    def seen_in_air(self, points: npt.ArrayLike) -> FloatArray:
        """(n, 3): points (n, 3) in this camera's frame; behind a window the directions in which
        they are seen, NaN before it."""
        points = np.asarray(points, dtype=np.float64)
        return points if self.window is None else seen_through(self.window, points)

    def rays_from(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Where the rays of raw pixels (n, 2) begin, (n, 3), and their directions (n, 3), of any
        length, in this camera's frame: at its centre, behind a window on its wet face; NaN without
        a ray."""
        return self.rays_along(homogeneous(self.undistort(pixels)))

    def rays_along(self, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The rays of `rays_from`, by their directions (n, 3) in air."""
        if self.window is not None:
            return rays_through(self.window, directions)
        return np.zeros_like(directions), directions

    def uses(self, rays: FloatArray) -> BoolArray:
        """(n,): whether points (n, 2) of z = 1 are finite, of a fisheye within its view."""
        limit = np.tan(LARGEST_ANGLE) if self.is_fisheye else np.finfo(np.float64).max
        return np.asarray(np.hypot(rays[:, 0], rays[:, 1]) <= limit)

    def is_outside(self, pixels: FloatArray) -> BoolArray:
        """(n,): which raw pixels (n, 2) are outside the image, which ends 0.5 px beyond the
        outermost pixel centres."""
        end = np.array(self.image_size) - 0.5
        return np.asarray(((pixels < -0.5) | (pixels > end)).any(axis=1))

    def outside(self, pixels: FloatArray) -> list[tuple[int, str]]:
        """The rows of raw pixels (n, 2) that `is_outside`, and in words: "point (-3, 20) is outside
        the 1280x1024 px image".

        Raises:
            StereocalError: all points are fractions of the image, not pixels.
        """
        width, height = self.image_size
        seen = pixels[np.isfinite(pixels).all(axis=1)]
        if len(seen) > 3 and (seen >= 0).all() and (seen <= 1).all():
            raise StereocalError(
                f"All {len(seen)} points of a camera of {width}x{height} px lie between 0 and 1, "
                f"as fractions of the image: give pixels, u times {width} and v times {height}."
            )
        missing = "; leave the point out if this marks a missing one"
        rows = np.flatnonzero(self.is_outside(pixels))
        return [
            (
                row,
                f"point ({u:g}, {v:g}) is outside the {width}x{height} px image"
                f"{missing if u == v == -1 else ''}",
            )
            for row, (u, v) in zip(rows.tolist(), pixels[rows], strict=True)
        ]

    def sees(self, points_m: FloatArray, margin_px: float = -0.5) -> BoolArray:
        """(n,): whether points (n, 3) in the camera's frame are in its image.

        Args:
            margin_px: least distance from the centres of the outermost pixels.
        """
        pixels, size = self.project(points_m), np.array(self.image_size)
        within = (pixels >= margin_px) & (pixels <= size - 1.0 - margin_px)
        inside = np.asarray(within.all(axis=1))
        # Far outside the view a distortion polynomial can fold back and map points into the image;
        # the pixel then undistorts to another ray.
        seen = np.flatnonzero(inside)
        in_air = self.seen_in_air(points_m[seen])
        rays = in_air[:, :2] / in_air[:, 2:]
        back = np.abs(self.undistort(pixels[seen]) - rays).max(axis=1, initial=0.0) < 1e-6
        inside[seen] = back & self.uses(rays)
        return inside

    def undistort(self, pixels: npt.ArrayLike) -> FloatArray:
        """Normalised points (n, 2) of raw pixels (n, 2); NaN where the lens model has no inverse.

        Newton's method on OpenCV's forward model, started at OpenCV's own inverse, which stops
        after 5 iterations: 0.02 px off at the corners of a 1280 px image with k1 = -0.22.
        """
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if len(pixels) > POINTS_KEPT:
            return self._undistorted(pixels)
        values = b"".join(array.tobytes() for array in (self.K, self.distortion, pixels))
        key = f"{self.model} {len(self.distortion)} {values.decode('latin-1')}"
        return once("rays", key, partial(self._undistorted, pixels)).copy()

    def _undistorted(self, pixels: FloatArray) -> FloatArray:
        """Normalised points (n, 2), as `undistort` gives them, computed anew."""
        distorted = homogeneous(pixels) @ np.linalg.inv(self.K).T
        distorted = np.ascontiguousarray(distorted[:, :2])
        if self.is_fisheye:
            rays = np.empty(distorted.shape)
            fill_undistorted(distorted, self.distortion, self.largest_angle, rays)
            return rays
        if not self.distortion.any() or not len(distorted):
            return distorted
        guess = cv2.undistortPoints(distorted[:, None], np.eye(3), self.distortion).reshape(-1, 2)
        points = np.asarray(guess, dtype=np.float64)
        with np.errstate(all="ignore"):
            for _ in range(20):
                there, (ux, vx, uy, vy) = self._distorted(points)
                error = there - distorted
                du, dv = error.T
                step = np.column_stack([du * vy - dv * uy, dv * ux - du * vx])
                points = points - step / (ux * vy - vx * uy)[:, None]
                if np.nanmax(np.abs(error), initial=0.0) < 1e-13:
                    break
            there, here = self._distorted(points)
            solved = np.abs(there - distorted).max(axis=1) < 1e-10
            # Far from the centre the polynomial folds back and has spurious solutions. A solution
            # counts if both eigenvalues of the Jacobian are positive all the way from the centre.
            on_the_way = (self._distorted(part * points)[1] for part in (0.25, 0.5, 0.75))
            for ux, vx, uy, vy in (*on_the_way, here):
                solved &= (ux * vy > vx * uy) & (ux + vy > 0)
        return np.where(solved[:, None], points, np.nan)

    def rays_of(self, pixels: npt.ArrayLike) -> FloatArray:
        """Normalised points (n, 2), as of `undistort`; NaN also where a fisheye images them beyond
        the view that is used."""
        rays = self.undistort(pixels)
        return np.where(self.uses(rays)[:, None], rays, np.nan) if self.is_fisheye else rays

    def undistort_to_pixels(self, pixels: npt.ArrayLike) -> FloatArray:
        """Pixels (n, 2) of the undistorted image, from raw pixels (n, 2)."""
        return self._to_pixels(self.undistort(pixels))

    def to_json(self) -> dict[str, Any]:
        """K, distortion, image size and window as plain lists; not the uncertainty."""
        return {
            "K": self.K.tolist(),
            "distortion": self.distortion.tolist(),
            "image_size": list(self.image_size),
            **({"model": self.model} if self.is_fisheye else {}),
            **({} if self.window is None else {"window": self.window.to_json()}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str) -> "Camera":
        """The camera that `to_json` describes, with its `uncertainty` if there is one."""
        missing = [key for key in ("K", "distortion", "image_size") if key not in data]
        with naming(source):
            refuse((missing, f"the camera has no {', '.join(missing)}."))
            try:
                width, height = map(int, data["image_size"])
                K, distortion = (np.array(data[key], float) for key in ("K", "distortion"))
            except (TypeError, ValueError, OverflowError) as error:
                raise StereocalError(
                    "K, distortion and image_size must be lists of numbers."
                ) from error
            stated = data.get("uncertainty")
            uncertainty = None if stated is None else LensUncertainty.from_json(stated)
            through = data.get("window")
            window = None if through is None else Window.from_json(through)
            model = data.get("model", "brown")
            return cls(K, distortion, (width, height), uncertainty, model, window)

    def _distort(self, normalised: FloatArray) -> FloatArray:
        """Distorted normalised points (n, 2), by OpenCV's full model."""
        if self.is_fisheye:
            return self._imaged(normalised)[0]
        if not len(normalised) or not self.distortion.any():
            return normalised
        return self._distorted(normalised)[0]

    def _imaged(self, normalised: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The points that `_distort` gives for a fisheye, and the Jacobians (n, 2, 2)."""
        distorted, jacobians = np.empty(normalised.shape), np.empty((len(normalised), 2, 2))
        fill_distorted(contiguous(normalised), self.distortion, distorted, jacobians)
        return distorted, jacobians

    def _distorted(self, normalised: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The points that `_distort` gives for a lens that is no fisheye, and (4, n): the
        derivatives of the distorted u and v by x, and of both by y.

        They are OpenCV's by the translation, for points at a depth of 1.
        """
        points, none = homogeneous(normalised)[:, None], np.zeros(3)
        projected, J = cv2.projectPoints(points, none, none, np.eye(3), self.distortion)
        by_x_and_y = np.asarray(J[:, 3:5], dtype=np.float64).reshape(-1, 2, 2)
        distorted = np.asarray(projected, dtype=np.float64).reshape(-1, 2)
        return distorted, by_x_and_y.transpose(2, 1, 0).reshape(4, -1)

    def _to_pixels(self, normalised: FloatArray) -> FloatArray:
        pixels: FloatArray = normalised @ self.K[:2, :2].T + self.K[:2, 2]
        return pixels


def pixel_scales(cameras: Sequence[Camera]) -> FloatArray:
    """(n, 3): fx, skew and fy of each: the part of K that acts on differences of normalised points,
    as `geometry.reprojection_shift` takes it.

    (n, 2, 4) if one is a fisheye: fx, skew, fy and its largest angle, which is 0 for other lenses;
    k1 to k4.
    """
    scales = np.array([camera.K[[0, 0, 1], [0, 1, 1]] for camera in cameras])
    if not any(camera.is_fisheye for camera in cameras):
        return scales
    lenses = np.zeros((len(cameras), 2, 4))
    lenses[:, 0, :3] = scales
    for row, camera in zip(lenses, cameras, strict=True):
        if camera.is_fisheye:
            row[0, 3], row[1] = camera.largest_angle, camera.distortion
    return lenses


def same_lens(one: Camera, other: Camera) -> bool:
    """Whether two cameras have the same lens, as where one file was given twice."""
    same = np.array_equal(one.K, other.K) and np.array_equal(one.distortion, other.distortion)
    return same and one.model == other.model


def one_file_in_words(cameras: Iterable[Camera]) -> str:
    """A question where two cameras have the same lens, before what a wrong file does; or empty."""
    if not any(same_lens(one, other) for one, other in combinations(cameras, 2)):
        return ""
    return "Two cameras have the same lens: was one file given for both? "
