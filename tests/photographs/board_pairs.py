"""A board in front of two cameras, one of which may be turned about its axis."""

import numpy as np

from stereocal.rig.geometry import Pose
from tests.files import encoded
from tests.photographs.lens import PATTERN, SMALL, SQUARES, photographed
from tools.photographs.board_series import draw_board_poses
from tools.photographs.rendering import Board, chessboard_corners, turned

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
            image = photographed(camera @ pose, board=board)
            image[:, : hidden * (at % 3 == 0)] = 110
            found[f"{side}{at:02}.png"] = encoded(image)
    return found
