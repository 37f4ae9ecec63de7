"""Boards before a camera with a known lens: corners by projection, and small photographs."""

from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from tests.files import encoded
from tools.photographs.board_series import draw_board_poses
from tools.photographs.rendering import (
    Board,
    Photograph,
    PhotographSettings,
    Placed,
    chessboard,
    chessboard_corners,
    photograph,
    turned,
)
from tools.photographs.videos import write_video

SMALL = Camera(
    K=np.array([[905.0, 0.0, 326.0], [0.0, 898.0, 233.0], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.21, 0.17, 0.0009, -0.0013, -0.06]),
    image_size=(640, 480),
)
PATTERN = BoardPattern(8, 6, 0.03)
SQUARES = (9, 7)
TRUE = np.array([905.0, 898.0, 326.0, 233.0, -0.21, 0.17, 0.0009, -0.0013, -0.06])


class AtOnce(Executor):
    """Does each piece of work where it stands, and notes what it was given."""

    def __init__(self) -> None:
        self.given: list[tuple[Any, ...]] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.given.append(args)
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def views(
    count: int, seed: int, noise_px: float = 0.1, camera: Camera = SMALL
) -> tuple[BoardView, ...]:
    """Corners of boards in random poses, by projection, with normal noise."""
    rng = np.random.default_rng(seed)
    poses = draw_board_poses(camera, rng, count, SQUARES, PATTERN.square_m)
    points = chessboard_corners(SQUARES, PATTERN.square_m)
    ids = np.arange(len(points))
    return tuple(
        BoardView(
            f"{at:02}.png",
            camera.image_size,
            ids,
            camera.project(pose.apply(points)) + noise_px * rng.normal(size=(len(points), 2)),
        )
        for at, pose in enumerate(poses)
    )


def search(count: int, seed: int, noise_px: float = 0.1) -> BoardSearch:
    """The same, as found in photographs."""
    return BoardSearch(PATTERN, views(count, seed, noise_px), ())


def photographed(
    pose: Pose,
    squares: tuple[int, int] = SQUARES,
    board: Board | None = None,
    bits: int = 8,
    blur_px: float = 0.7,
    camera: Camera = SMALL,
) -> Photograph:
    """A photograph of a chessboard, or of another board."""
    board = board or chessboard(squares, PATTERN.square_m)
    settings = PhotographSettings(blur_px=blur_px, bits=bits)
    rng = np.random.default_rng(0)
    return photograph(camera, 120.0, [Placed(board, pose)], settings, rng)


def facing(spin: float = 0.0, tilt: float = 0.3, distance_m: float = 0.6) -> Pose:
    """A board in the middle of the image, turned in its plane, then tilted about a slanted axis."""
    R = turned([tilt * 0.8, tilt * 0.6, 0.0]) @ turned([0.0, 0.0, spin])
    return Pose(R, np.array([0.0, 0.0, distance_m]))


def corners_of(pose: Pose, squares: tuple[int, int] = SQUARES) -> FloatArray:
    """The true inner corners (n, 2), row by row."""
    return SMALL.project(pose.apply(chessboard_corners(squares, PATTERN.square_m)))


def write_boards(folder: Path, count: int, seed: int = 1) -> list[Pose]:
    """Photographs 00.png, 01.png ... of the board in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    poses = draw_board_poses(SMALL, np.random.default_rng(seed), count, SQUARES, PATTERN.square_m)
    for at, pose in enumerate(poses):
        (folder / f"{at:02}.png").write_bytes(encoded(photographed(pose)))
    return poses


def film_boards(path: Path, count: int, seed: int = 1) -> Path:
    """A video of the board, a frame in each pose."""
    poses = draw_board_poses(SMALL, np.random.default_rng(seed), count, SQUARES, PATTERN.square_m)
    frames = [np.asarray(photographed(pose), np.uint8) for pose in poses]
    seconds = [0.2 * k for k in range(count)]
    return write_video(path, seconds, draw=frames.__getitem__, preset="ultrafast")
