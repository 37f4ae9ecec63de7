"""Photographs of single 2x2 boards, each described by how it is seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from tools.photographs.rendering import (
    Photograph,
    PhotographSettings,
    Placed,
    expose,
    paint,
    turned,
    x_corner_board,
)

DISTANCE = 20.0
"""Of the camera, in sides of the board: how strong the perspective is."""


@dataclass(frozen=True)
class Board:
    """How one board is seen. Lengths in px, brightness in grey levels."""

    centre: tuple[float, float]
    side: float = 80.0
    turn: float = 0.3
    tilt: float = 0.0
    tilt_axis: float = 0.0
    blur: float = 1.0
    black: float = 60.0
    white: float = 190.0

    def camera(self, size: tuple[int, int]) -> Camera:
        """One that looks straight at it, with images of (width, height)."""
        f, (u, v) = self.side * DISTANCE, self.centre
        return Camera(np.array([[f, 0.0, u], [0.0, f, v], [0.0, 0.0, 1.0]]), np.zeros(5), size)

    @property
    def pose(self) -> Pose:
        """Before that camera, with sides of 1 m."""
        axis = self.tilt * np.array([np.cos(self.tilt_axis), np.sin(self.tilt_axis), 0.0])
        return Pose(turned(axis) @ turned([0.0, 0.0, self.turn]), np.array([0.0, 0.0, DISTANCE]))


def picture(
    boards: Board | Sequence[Board],
    size: tuple[int, int],
    noise: float = 0.0,
    seed: int = 0,
    background: float = 120.0,
) -> Photograph:
    """A photograph (h, w) of boards before a plain grey; `size` is (width, height)."""
    light = np.full(size[::-1], background, np.float32)
    for board in [boards] if isinstance(boards, Board) else boards:
        placed = Placed(x_corner_board(1.0, board.black, board.white, False), board.pose)
        paint(light, board.camera(size), placed, board.blur)
    plain = PhotographSettings(vignetting=0.0, full_well_e=np.inf, read_noise=noise)
    return expose(light, plain, np.random.default_rng(seed))
