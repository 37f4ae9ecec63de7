"""One frame seen with one parameter set: rays, epipolar lines, and the length of the bar."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.refined.outliers import bar_frames, frame_reprojection_px
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.fisheye import LARGEST_ANGLE
from stereocal.rig.rig import Rig

PAPERS: tuple[Method, ...] = ("2d", "3d")
ON_LINE = 200
"""Points of a drawn epipolar line, which distortion bends."""


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame seen with one set."""

    method: Method
    rig: Rig
    dataset: Dataset
    frame: int

    @cached_property
    def rows(self) -> IntArray:
        """(n,): the rows of the frame's targets, 1 or 2; of an object those farthest apart."""
        rows = self.dataset.correspondences
        if rows.rigid_object is None:
            return np.flatnonzero(rows.frame == self.frame)
        part = rows.parts[0]
        return np.flatnonzero(part == part[rows.frame == self.frame].min())

    @cached_property
    def letters(self) -> list[str]:
        """(n,): the targets' names."""
        rows = self.dataset.correspondences
        return [rows.names[target] for target in rows.target[self.rows]]

    @cached_property
    def pixels(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2) for each camera: the targets in the images as recorded."""
        rows = self.dataset.correspondences
        return rows.primary[self.rows], rows.secondary[self.rows]

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """The primary and the secondary camera of the set."""
        return self.rig.primary, self.rig.secondary

    @cached_property
    def rays(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2) for each camera: undistorted, normalised."""
        first, second = (
            camera.undistort(own) for camera, own in zip(self.cameras, self.pixels, strict=True)
        )
        return first, second

    @cached_property
    def distances_px(self) -> FloatArray:
        """(n, 2): distance of the points from the epipolar lines, in pixels as of `Camera`."""
        return self.rig.epipolar_distances(*self.pixels)

    @cached_property
    def nearest_m(self) -> FloatArray:
        """(n, 2, 3): the ends of the shortest segment between the rays, in the primary's frame."""
        primary_from_secondary = self.rig.pose.inverse()
        centre = primary_from_secondary.T
        found = []
        for first, second in zip(*self.rays, strict=True):
            d = np.append(first, 1.0)
            e = primary_from_secondary.R @ np.append(second, 1.0)
            # Least squares of s d - (centre + r e).
            (s, r), *_ = np.linalg.lstsq(np.column_stack([d, -e]), centre, rcond=None)
            found.append([s * d, centre + r * e])
        return np.array(found)

    @cached_property
    def gaps_m(self) -> FloatArray:
        """(n,): the shortest distance between the two rays of each target."""
        return np.asarray(np.linalg.norm(self.nearest_m[:, 0] - self.nearest_m[:, 1], axis=1))

    @cached_property
    def length_m(self) -> float | None:
        """The bar's length; None with one target."""
        middle = self.nearest_m.mean(axis=1)
        return float(np.linalg.norm(middle[0] - middle[1])) if len(middle) == 2 else None

    @cached_property
    def stated_m(self) -> float | None:
        """The measured length of the bar; None with one target."""
        rows = self.dataset.correspondences
        at = np.flatnonzero(rows.frame[rows.bars[:, 0]] == self.frame)
        return float(self.dataset.bar_distances_m[at[0]]) if len(at) else None

    @property
    def length_error(self) -> float | None:
        """Relative; None with one target."""
        if self.length_m is None or self.stated_m is None:
            return None
        return self.length_m / self.stated_m - 1.0

    def line(self, camera: int, target: int) -> FloatArray:
        """(m, 2): the epipolar line of a target's partner in the image as recorded, in pixels.

        A curve; NaN where it leaves the image of a fisheye, to which it may come back.
        """
        E = self.rig.pose.essential
        partner = np.append(self.rays[1 - camera][target], 1.0)
        a, b, c = E @ partner if camera == 1 else partner @ E
        own = self.cameras[camera]
        width, height = own.image_size
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
        if own.is_fisheye:  # its image is far from a rectangle on the plane z = 1
            border = np.tan(LARGEST_ANGLE) * np.array([[-1.0, -1.0], [1.0, 1.0]])
        else:
            border = own.undistort(corners * (1 - 1e-3) + 5e-4 * np.array([width, height]))
        foot = -c * np.array([a, b]) / (a * a + b * b)
        along = np.array([-b, a]) / np.hypot(a, b)
        reach, away = (border - foot) @ along, np.hypot(1.0, np.linalg.norm(foot))
        low, high = np.arctan([reach.min() / away, reach.max() / away])
        steps = away * np.tan(np.linspace(low, high, ON_LINE))  # evenly in angle
        steps = np.union1d(steps, (self.rays[camera][target] - foot) @ along)
        points = foot + steps[:, None] * along
        inside = ((points >= border.min(axis=0)) & (points <= border.max(axis=0))).all(axis=1)
        pixels = own.distort(points[inside & own.uses(points)])
        if own.is_fisheye:
            pixels[~((pixels >= 0) & (pixels <= corners[2])).all(axis=1)] = np.nan
        return pixels


def views_of(calibration: Calibration, frame: int) -> dict[Method, FrameView]:
    """A frame with each set."""
    dataset = calibration.dataset
    if frame not in dataset.correspondences.frames:
        raise StereocalError(f"There is no frame {frame}.")
    rigs: dict[Method, Rig] = {
        method: Rig(dataset.primary, dataset.secondary, calibration.methods[method].pose)
        for method in PAPERS
    }
    if (refined := calibration.refined) is not None:
        rigs["refined"] = Rig(refined.primary, refined.secondary, refined.pose)
    return {method: FrameView(method, rig, dataset, frame) for method, rig in rigs.items()}


def telling_frame(calibration: Calibration) -> int:
    """The frame that shows best why there are two sets.

    There the reprojection error is smaller with the 2D set and the length error with the 3D set, by
    the largest parts of their maxima.
    """
    frames = bar_frames(calibration)
    every = calibration.dataset.correspondences.frames
    if not len(frames):
        return int(every[0])
    of_bars = np.searchsorted(every, frames)
    px = [frame_reprojection_px(calibration, method)[of_bars] for method in PAPERS]
    length = [calibration.errors[method].length for method in PAPERS]
    gain = _scaled(px[1] - px[0]) + _scaled(length[0] - length[1])
    used = np.isin(frames, calibration.frames) & np.isfinite(gain)
    return int(frames[np.argmax(np.where(used, gain, -np.inf))])


def _scaled(values: FloatArray) -> FloatArray:
    return np.asarray(values / max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-300))
