"""Photographs of single 2x2 boards, made without the model that is fitted to them.

Each pixel is a mean over a fine grid of points that are traced back to the board's plane; the blur
is a discrete Gaussian on that fine grid.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereocal.rig.compiled import FloatArray
from tools.photographs.rendering import Photograph


@dataclass(frozen=True)
class Board:
    """How one board is seen. Lengths in px, brightness in grey levels."""

    centre: tuple[float, float]
    side: float = 80.0
    turn: float = 0.3
    tilt: float = 0.0
    tilt_axis: float = 0.0
    distance: float = 20.0
    """Of the camera, in sides of the board: how strong the perspective is."""
    blur: float = 1.0
    black: float = 60.0
    white: float = 190.0
    margin: float = 0.0
    """White paper around the board, in sides."""
    shade: tuple[float, float] = (0.0, 0.0)
    """Relative change of the light per 100 px to the right and down."""


def plane_to_image(board: Board) -> FloatArray:
    """(3, 3): homography from the board's plane (one side long, its centre at 0) to px."""
    turn, axis = board.turn, board.tilt_axis
    spin = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    lean, _ = cv2.Rodrigues(board.tilt * np.array([math.cos(axis), math.sin(axis), 0.0]))
    R = np.asarray(lean, dtype=np.float64) @ spin
    H = np.column_stack([R[:, 0], R[:, 1], [0.0, 0.0, board.distance]])
    scale = board.side * board.distance
    to_px = np.array([[scale, 0, board.centre[0]], [0, scale, board.centre[1]], [0, 0, 1]])
    homography: FloatArray = to_px @ H
    return homography


def paint(light: FloatArray, board: Board, origin: tuple[float, float], fine: int) -> None:
    """Draw a board into `light`, (h fine, w fine), in place; pixel (0, 0) has its centre at
    `origin`.

    A fine pixel that an edge crosses takes its share of both sides. Without this, edges along the
    rows or columns were off by up to half a fine pixel: 0.06 to 0.12 px.
    """
    if board.shade == (0.0, 0.0):  # which alone reaches beyond the board
        reach = board.side * (0.8 + 1.5 * board.margin) * 1.2 + 2.0
        spans = [
            (int(np.clip((at - zero - reach) * fine, 0, most)), int((at - zero + reach) * fine))
            for at, zero, most in zip(board.centre, origin, light.shape[::-1], strict=True)
        ]
        (left, right), (top, bottom) = spans
        light = light[top : max(bottom, 0), left : max(right, 0)]
        origin = (origin[0] + left / fine, origin[1] + top / fine)
    height, width = light.shape
    u = origin[0] + (np.arange(width) + 0.5) / fine - 0.5
    v = origin[1] + (np.arange(height) + 0.5) / fine - 0.5
    across, down, depth = np.linalg.inv(plane_to_image(board))

    def side(line: FloatArray) -> FloatArray:
        """-1 to 1: on which side of a line each fine pixel is."""
        away = line[0] * u + line[1] * v[:, None] + line[2]
        return np.asarray(np.clip(2.0 * fine * away / math.hypot(line[0], line[1]), -1.0, 1.0))

    def covered(half: float) -> FloatArray:
        """0 to 1: the share of each fine pixel inside a square."""
        lines = (
            half * depth + across,
            half * depth - across,
            half * depth + down,
            half * depth - down,
        )
        share: FloatArray = np.prod([0.5 + 0.5 * side(line) for line in lines], axis=0)
        return share

    depth = depth * math.copysign(1.0, depth @ [*board.centre, 1.0])
    light += covered(0.5 + board.margin) * (board.white - light)
    middle, contrast = 0.5 * (board.white + board.black), board.white - board.black
    light += covered(0.5) * (middle + 0.5 * contrast * side(across) * side(down) - light)
    light *= 1.0 + board.shade[0] * (u - board.centre[0]) / 100.0
    light *= 1.0 + board.shade[1] * (v - board.centre[1])[:, None] / 100.0


def picture(
    boards: Board | Sequence[Board],
    size: tuple[int, int],
    noise: float = 0.0,
    seed: int = 0,
    background: float = 120.0,
    fine: int = 8,
    bits: int = 8,
) -> Photograph:
    """A photograph (h, w) of boards of one blur before a plain grey; `size` is (width, height)."""
    light = np.full((size[1] * fine, size[0] * fine), background)
    boards = [boards] if isinstance(boards, Board) else boards
    for board in boards:
        paint(light, board, (0.0, 0.0), fine)
    blur = boards[0].blur * fine
    light = cv2.GaussianBlur(light, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    image = light.reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))
    image = image + noise * np.random.default_rng(seed).normal(size=image.shape)
    scale = (2**bits - 1) / 255.0
    levels: FloatArray = np.clip(np.rint(image * scale), 0, 2**bits - 1)
    return levels.astype(np.uint8) if bits == 8 else levels.astype(np.uint16)
