"""A board in front of two cameras, one of which may be turned about its axis."""

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from tests.files import encoded
from tests.lens import PATTERN, SMALL, SQUARES
from tools.photographs.board_series import draw_board_poses
from tools.photographs.rendering import (
    Board,
    chessboard,
    chessboard_corners,
    on_plane,
    ray_splines,
    turned,
)

CROSSING_M = 0.6
HERE = Pose(np.eye(3), np.zeros(3))


def stereo(roll: float) -> Pose:
    """`secondary_from_primary` of cameras that look at one place; the secondary is rolled."""
    R = turned([0.0, 0.0, roll]) @ turned([0.05, 0.25, 0.0])
    at = np.array([0.0, 0.0, CROSSING_M])
    return Pose(R, at - R @ at)


def placings(rig: Pose, count: int, seed: int) -> list[Pose]:
    """`primary_from_board` of boards that both cameras see whole."""
    rng, found = np.random.default_rng(seed), list[Pose]()
    points = chessboard_corners((SQUARES[0] + 2, SQUARES[1] + 2), PATTERN.square_m)
    size = np.array(SMALL.image_size)
    while len(found) < count:
        for pose in draw_board_poses(SMALL, rng, count, SQUARES, PATTERN.square_m):
            away = Pose(pose.R @ turned([0, 0, rng.uniform(-np.pi, np.pi)]), 1.3 * pose.T)
            seen = [camera.apply(away.apply(points)) for camera in (HERE, rig)]
            pixels = np.vstack([SMALL.project(own) for own in seen])
            if (pixels > 4).all() and (pixels < size - 4).all():
                found.append(away)
    return found[:count]


def photographs(
    rig: Pose, count: int, seed: int, board: Board | None = None, hidden: int = 0
) -> dict[str, bytes]:
    """Photographs of both cameras by name.

    Args:
        board: a chessboard if None.
        hidden: of every third frame the left part of both, px.
    """
    found = {}
    for at, pose in enumerate(placings(rig, count, seed)):
        for side, camera in (("left", HERE), ("right", rig)):
            image = _photographed(camera @ pose, board or chessboard(SQUARES, PATTERN.square_m))
            image[:, : hidden * (at % 3 == 0)] = 110
            found[f"{side}{at:02}.png"] = encoded(image)
    return found


def _photographed(pose: Pose, board: Board) -> npt.NDArray[np.uint8]:
    """A quick picture: grey levels at four points of each pixel; corners are exact to 0.04 px."""
    rows, columns = board.cells.shape
    fine = 2 if rows > 100 else 20  # points of the picture of the board in a cell
    drawn = cv2.resize(board.cells.astype(np.float32), None, fx=fine, fy=fine, interpolation=0)
    x, y = on_plane(*_rays(), np.linalg.inv(np.column_stack([pose.R[:, :2], pose.T])))
    u, v = (
        ((at / size + 0.5) * cells * fine - 0.5).astype(np.float32)
        for at, size, cells in zip((x, y), board.size_m, (columns, rows), strict=True)
    )
    seen = cv2.remap(drawn, u, v, cv2.INTER_LINEAR, borderValue=120.0)
    soft = cv2.GaussianBlur(seen, (0, 0), 1.6)
    return np.rint(cv2.resize(soft, SMALL.image_size, interpolation=cv2.INTER_AREA)).astype(
        np.uint8
    )


@cache
def _rays() -> tuple[FloatArray, FloatArray]:
    """Normalised x and y of the middles of the four quarters of each pixel."""
    columns, rows = ((np.arange(2 * n) - 0.5) / 2 for n in SMALL.image_size)
    x, y = ray_splines(SMALL, columns, rows)
    return x(rows, columns), y(rows, columns)
