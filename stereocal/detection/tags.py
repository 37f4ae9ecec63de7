"""Two ArUco or AprilTag markers in a photograph: the centre of each.

OpenCV finds the markers. Their four sides are then fitted as straight lines to the edges in the
photograph, since the corners that OpenCV refines are 0.2 to 0.8 px off. The centre is where the
diagonals intersect, in the undistorted image, because a marker's centre is the midpoint of its
corners in space only.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import GreyImage, profiles, steepest
from stereocal.detection.target import Sighting, Spot, Tags
from stereocal.rig.camera import Camera
from stereocal.system.array_types import FloatArray

USED = (0.12, 0.88)
"""Part of a side that the line is fitted to: the blur of a corner is left out."""
SMALLEST_SIDE = 12.0
SMALL_SIDE = 24.0
"""px; smaller tags are doubtful: four cells of 4x4_50 and the border have 4 px each."""
REACH = 0.1
"""Reach of the profiles, in sides; the black border is at least 1/10 of the side (8x8 cells)."""
STRAIGHT_PX = 0.35
"""Largest scatter of a side about its line before the tag is doubtful (bent paper)."""
CORRELATION = 2.0
"""Neighbouring edges share pixels: the variance of a line is this much larger than for
independent ones."""
SMALL_SIGMA_PX = 0.018
"""Error of a tag of 40 px from edges that share its cells' blur, growing as the inverse square of
the side: with it stated errors hold in renderings from 20 to 120 px (rms z 0.7 to 1.3)."""


def find_tags(image: npt.NDArray[Any], target: Tags, camera: Camera | None = None) -> Sighting:
    """Find both tags in a photograph (h, w) of 8 or 16 bits; the camera's lens straightens their
    sides."""
    grey = image
    if image.dtype != np.uint8:
        bright = max(float(np.percentile(image[::8, ::8], 99.9)), 1.0)
        grey = cv2.convertScaleAbs(image, alpha=255.0 / bright)
    corners, ids, _ = _detector(target.dictionary).detectMarkers(grey)
    numbers = [] if ids is None else np.asarray(ids).ravel().tolist()
    exact, spots = image.astype(np.float32), []
    for wanted in target.ids:
        outlines = [
            c[0].astype(float) for c, n in zip(corners, numbers, strict=True) if n == wanted
        ]
        spot = _fitted(exact, outlines[0], camera) if outlines else None
        if spot is not None and len(outlines) > 1:
            also = f"Tag {wanted} is in the photograph {len(outlines)} times."
            spot = replace(spot, doubts=(*spot.doubts, also))
        spots.append(spot)
    missing = [str(n) for n, spot in zip(target.ids, spots, strict=True) if spot is None]
    why = ""
    if missing:
        others = sorted(set(numbers) - set(target.ids))
        seen = f"; there are {', '.join(map(str, others[:5]))}" if others else ""
        why = f"No tag {' and no tag '.join(missing)} of {target.dictionary} was found{seen}."
    return Sighting((spots[0], spots[1]), why)


@lru_cache(maxsize=8)
def _detector(dictionary: str) -> Any:
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(words, settings)


def _fitted(image: GreyImage, corners: FloatArray, camera: Camera | None) -> Spot | None:
    """The centre of a tag with corners (4, 2) px near the true ones; None if it has no sides."""
    for _ in range(2):
        lines, scatter, errors = _sides(image, corners, camera)
        if not np.isfinite(lines).all():
            return None
        ideal = _corners(lines)
        corners = ideal if camera is None else _distorted(camera, ideal)
    side = 0.25 * float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
    if side < SMALLEST_SIDE:
        return None
    centre = _centre(ideal)
    variance = (SMALL_SIGMA_PX * (40.0 / side) ** 2) ** 2
    for k in range(4):
        for move in errors[k]:
            moved = lines.copy()
            moved[k] += move
            variance += 0.5 * float(((_centre(_corners(moved)) - centre) ** 2).sum())
    raw = centre if camera is None else _distorted(camera, centre[None])[0]
    doubts = []
    the_tag = f"The tag at ({raw[0]:.0f}, {raw[1]:.0f})"
    if scatter > STRAIGHT_PX:
        doubts.append(f"{the_tag} has sides that are not straight: is it bent or partly hidden?")
    if side < SMALL_SIDE:
        doubts.append(f"{the_tag} is small: {side:.0f} px wide.")
    return Spot(float(raw[0]), float(raw[1]), float(np.sqrt(variance)), 0.5 * side, tuple(doubts))


def _sides(
    image: GreyImage, corners: FloatArray, camera: Camera | None
) -> tuple[FloatArray, float, FloatArray]:
    """Lines (4, 3) with n.x = c through the sides, in undistorted px, their scatter, and errors
    (4, 2, 3): changes by one standard error of the offset and of the direction."""
    lines, scatters, errors = np.full((4, 3), np.nan), [], np.zeros((4, 2, 3))
    middle = corners.mean(axis=0)
    for k in range(4):
        start, end = corners[k], corners[(k + 1) % 4]
        length = float(np.linalg.norm(end - start))
        along = (end - start) / max(length, 1e-9)
        normal = np.array([along[1], -along[0]])
        if normal @ (start - middle) < 0:
            normal = -normal
        n = max(8, int(length))
        points = start + np.linspace(*USED, n)[:, None] * (end - start)
        reach = max(2.5, REACH * length)
        # The border is black and the paper around it white.
        along_normal, profile = profiles(image, points, np.tile(normal, (n, 1)), reach)
        away, height, _ = steepest(along_normal, -profile, 0.6 * reach)
        strong = height > 0.5 * np.nanmedian(height) if np.isfinite(height).any() else height > 0
        points = (points + away[:, None] * normal)[strong]
        if camera is not None:
            points = camera.undistort_to_pixels(points)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 5:
            continue
        lines[k], scatter, errors[k] = _line(points)
        scatters.append(scatter)
    return lines, max(scatters, default=np.inf), errors


def _line(points: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """The line through points (n, 2), robustly, the scatter about it, and its two errors."""
    for _ in range(3):
        middle = points.mean(axis=0)
        _, _, axes = np.linalg.svd(points - middle)
        away = (points - middle) @ axes[1]
        far = np.abs(away) > max(3.0 * 1.4826 * float(np.median(np.abs(away))), 0.02)
        if not far.any() or (~far).sum() < 5:
            break
        points = points[~far]
    scatter = float(np.sqrt((away**2).sum() / max(len(points) - 2, 1)))
    along = (points - middle) @ axes[0]
    error = scatter * np.sqrt(CORRELATION / len(points))
    turn = scatter * np.sqrt(CORRELATION / float((along**2).sum()))
    line = np.array([*axes[1], axes[1] @ middle])
    turned = turn * np.array([*axes[0], axes[0] @ middle])
    return line, scatter, np.array([[0.0, 0.0, error], turned])


def _corners(lines: FloatArray) -> FloatArray:
    """(4, 2): corner k is where side k - 1 meets side k."""
    met = np.cross(np.roll(lines * [1, 1, -1], 1, axis=0), lines * [1, 1, -1])
    return np.asarray(met[:, :2] / met[:, 2:])


def _centre(corners: FloatArray) -> FloatArray:
    """(2,): where the diagonals intersect."""
    q = np.column_stack([corners, np.ones(4)])
    met = np.cross(np.cross(q[0], q[2]), np.cross(q[1], q[3]))
    return np.asarray(met[:2] / met[2])


def _distorted(camera: Camera, ideal: FloatArray) -> FloatArray:
    """Raw px of px of the undistorted image."""
    q = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(camera.K).T
    return camera.distort(q[:, :2])
