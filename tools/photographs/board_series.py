"""Synthetic photographs of a chessboard for lens calibration, with known poses."""

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import chessboard_corners, outline_of, pixel_ray, pixels_of, turned

LENS_SQUARES = (19, 13)
"""Columns and rows of squares (paper, Section 5: 18x12 inner corners)."""
LENS_SQUARE_M = 0.03
LENS_PHOTOGRAPHS = 22
BOARD_SHARE = (0.55, 0.95)
"""Width of the untilted board over the width of the image."""
TILT_RAD = (0.15, 0.85)
"""Angle between the board's normal and the line of sight. The focal length of a long lens can only
be determined from the foreshortening of a tilted board."""
SPIN_RAD = 0.3
"""Standard deviation of the rotation in the board's plane."""
EDGE_PX = 4.0
"""Least distance of the outer squares from the edge of the image."""
MAXIMUM_TRIES = 20_000


def draw_board_poses(
    camera: Camera,
    rng: np.random.Generator,
    count: int = LENS_PHOTOGRAPHS,
    squares: tuple[int, int] = LENS_SQUARES,
    square_m: float = LENS_SQUARE_M,
) -> list[Pose]:
    """Poses (camera from board) of boards that lie inside the image and together fill it.

    Size, tilt and rotation are random. The position is random too, more often near the edges and
    corners of the image than in its centre.
    """
    outline = outline_of(square_m * np.array(squares), 9)
    poses: list[Pose] = []
    for _ in range(MAXIMUM_TRIES):
        pose = _draw_pose(camera, rng, outline)
        if pose is not None:
            poses.append(pose)
        if len(poses) >= count:
            return poses
    raise StereocalError(
        f"A board of {squares[0]}x{squares[1]} squares does not fit into an image of "
        f"{camera.image_size[0]}x{camera.image_size[1]} px when it is tilted."
    )


def true_corners(camera: Camera, pose: Pose) -> FloatArray:
    """Raw pixels (n, 2) of a board's inner corners, row by row from the top left."""
    return camera.project(pose.apply(chessboard_corners(LENS_SQUARES, LENS_SQUARE_M)))


def _draw_pose(camera: Camera, rng: np.random.Generator, outline: FloatArray) -> Pose | None:
    """One random pose; None if the board does not fit into the image."""
    size = np.array(camera.image_size, dtype=np.float64)
    depth = camera.K[0, 0] * np.ptp(outline[:, 0]) / (rng.uniform(*BOARD_SHARE) * size[0])
    tilt, azimuth = rng.uniform(*TILT_RAD), rng.uniform(-np.pi, np.pi)
    R = turned((tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.0))
    R = R @ turned((0.0, 0.0, SPIN_RAD * rng.standard_normal()))
    middle = 0.5 * (size - 1.0)
    pixels = _pixels(camera, outline, R, middle, depth)
    if pixels is None:
        return None
    lowest = middle - pixels.min(axis=0) + EDGE_PX
    highest = size - 1.0 - EDGE_PX - (pixels.max(axis=0) - middle)
    # Beta(1/2, 1/2) is densest at both ends.
    position = lowest + (highest - lowest) * rng.beta(0.5, 0.5, 2)
    if (highest < lowest).any():
        return None
    pixels = _pixels(camera, outline, R, position, depth)
    if pixels is None or not ((pixels >= EDGE_PX) & (pixels <= size - 1.0 - EDGE_PX)).all():
        return None
    return Pose(R, depth * pixel_ray(camera, position))


def _pixels(
    camera: Camera, outline: FloatArray, R: FloatArray, position: FloatArray, depth: float
) -> FloatArray | None:
    """Pixels of the outline with its centre at the pixel `position`; None if not all in view."""
    points = outline @ R.T + depth * pixel_ray(camera, position)
    if not np.isfinite(points).all() or (points[:, 2] <= 0.1 * depth).any():
        return None
    return pixels_of(camera, points)
