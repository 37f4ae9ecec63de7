"""Small photographs of what people hold, a bar, balls, tags or a board, before the other objects,
which lie about and do not move.

    first, second = photographs_of("balls", np.random.default_rng(0))
"""

from typing import Literal, get_args

import cv2
import numpy as np

from stereocal.intrinsics.proposed_board import ProposedBoard
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tools.photographs.balls import (
    BLUE,
    RED,
    YELLOW,
    BallSettings,
    ColourPhotograph,
    ColourPicture,
    clutter,
    expose_colours,
    paint_ball,
    seen_by,
    side_light,
)
from tools.photographs.bars import BarSettings, facing, place_boards, place_visible_bars, rod
from tools.photographs.rendering import (
    HERE,
    Board,
    Placed,
    chessboard,
    paint,
    pixel_ray,
    x_corner_board,
)

Kind = Literal["bar2x2", "balls", "tags", "board", "charuco"]
KINDS: tuple[Kind, ...] = get_args(Kind)
SIZE = (480, 360)
LENS = np.array([-0.2, 0.1, 0.001, -0.001, 0.0])
CAMERA = Camera(np.array([[600.0, 0, 240], [0, 600, 180], [0, 0, 1]]), LENS, SIZE)
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 0.9))
DEPTHS_M, BEHIND_M = (1.2, 2.0), (2.4, 3.2)
"""Of what is held, and of what lies about."""
BAR_M, BALL_M, TAG_IDS = 0.5, 0.03, (3, 7)
SQUARES = (9, 7)
"""Of the boards."""
HELD_BOARD = ProposedBoard(SQUARES[0] - 1, SQUARES[1] - 1)
LYING = 0.7
"""Chance that an object of another kind lies about."""
PAINT_BLUR_PX = 0.9
"""Before that of the lens: sharp edges take ten times as long."""


def photographs_of(
    kind: Kind, rng: np.random.Generator, frames: int = 4
) -> list[dict[str, ColourPhotograph]]:
    """The photographs of each camera by name; the targets, the board and all else are random."""
    camera_light = side_light(rng, 30.0, 70.0)
    backgrounds = _backgrounds(kind, rng)
    blur = float(rng.uniform(0.3, 1.0))
    length = 0.2 if kind in ("board", "charuco") else BAR_M
    scene = place_visible_bars(RIG, rng, frames, length, 2 * BALL_M, DEPTHS_M, margin_px=45.0)
    side = float(rng.uniform(0.08, 0.2))
    found: list[dict[str, ColourPhotograph]] = [{}, {}]
    for frame, ends in enumerate(scene.ends_m, start=1):
        things = _held(kind, ends, side, rng)
        for which, (own, pose) in enumerate(zip(found, (HERE, RIG.pose), strict=True)):
            light = BallSettings(seen_by(camera_light, pose), ambient=0.2, blur_px=blur)
            picture = backgrounds[which].copy()
            _paint(picture, pose, things)
            if kind == "balls":
                for centre, colour in zip(pose.apply(ends), (RED, YELLOW), strict=True):
                    paint_ball(picture, CAMERA, centre, BALL_M, colour, light)
            own[f"{CAMERAS[which]}/{frame:04}"] = expose_colours(picture, light, rng)
    return found


def tag(number: int, side_m: float) -> Board:
    """A tag of 4X4_50 with a white border of one cell; `side_m` is that of its black square."""
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = np.asarray(cv2.aruco.generateImageMarker(words, number, 6), np.float64)
    framed = np.pad(cells, 1, constant_values=255.0)
    return Board(35.0 + framed * (170.0 / 255.0), (side_m * 8 / 6, side_m * 8 / 6))


def charuco(square_m: float) -> Board:
    """A ChArUco board of `SQUARES`: DICT_4X4_50, markers of 0.73 squares."""
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard(SQUARES, square_m, 0.73 * square_m, words)
    drawn = board.generateImage((80 * SQUARES[0], 80 * SQUARES[1]))
    width, height = (square_m * squares for squares in SQUARES)
    return Board(np.where(drawn > 127, 205.0, 35.0), (width, height))


def _held(kind: Kind, ends: FloatArray, side: float, rng: np.random.Generator) -> list[Placed]:
    """What is held, apart from balls, from the farthest to the nearest."""
    viewpoint = 0.5 * RIG.pose.inverse().T
    if kind == "bar2x2":
        return place_boards(ends, viewpoint, BarSettings(board_m=side, rod_m=0.015), rng)
    poses = [
        facing(end, viewpoint, *rng.uniform((0.0, -3.0, -0.6), (0.6, 3.0, 0.6)).tolist())
        for end in (ends if kind == "tags" else ends.mean(axis=0)[None])
    ]
    if kind == "balls":
        return [rod(ends[0], ends[1], viewpoint, 0.01)]
    if kind == "tags":
        tags = [tag(n, 0.12) for n in TAG_IDS]
        return [
            rod(ends[0], ends[1], viewpoint, 0.015),
            *(Placed(each, pose) for each, pose in zip(tags, poses, strict=True)),
        ]
    square = 0.3 * side + 0.02 * (kind == "charuco")
    return [Placed(charuco(square) if kind == "charuco" else chessboard(SQUARES, square), poses[0])]


def _backgrounds(kind: Kind, rng: np.random.Generator) -> list[ColourPicture]:
    """Of both cameras: shapes of all colours, and objects of other kinds that lie about, seen by
    either camera wherever it may be."""
    found = []
    for _ in CAMERAS:
        picture = clutter(SIZE, rng, 25, grain=0.1)
        lying: list[Board] = []
        if kind not in ("board", "charuco") and rng.random() < LYING:
            lying.append(chessboard((int(rng.integers(4, 9)), int(rng.integers(4, 7))), 0.06))
        if kind != "bar2x2" and rng.random() < LYING:
            lying += [x_corner_board(float(rng.uniform(0.12, 0.25))) for _ in range(2)]
        if kind not in ("tags", "charuco") and rng.random() < LYING:
            lying += [tag(int(rng.integers(50)), 0.2) for _ in range(2)]
        _paint(picture, HERE, [Placed(each, _somewhere(rng)) for each in lying])
        if kind != "balls" and rng.random() < LYING:
            for colour in (RED, BLUE):
                light = BallSettings(side_light(rng, 20.0, 80.0), ambient=0.2)
                paint_ball(picture, CAMERA, _somewhere(rng).T, 0.06, colour, light)
        found.append(picture)
    return found


def _somewhere(rng: np.random.Generator) -> Pose:
    """Behind what is held, in view."""
    pixel = rng.uniform(0.12, 0.88, 2) * SIZE
    centre = float(rng.uniform(*BEHIND_M)) * pixel_ray(CAMERA, pixel)
    return facing(centre, np.zeros(3), *rng.uniform((0.0, -3.0, -3.0), (0.8, 3.0, 3.0)).tolist())


def _paint(picture: ColourPicture, camera_from_here: Pose, things: list[Placed]) -> None:
    """Paint grey things over a colour picture, in place."""
    for thing in things:
        seen = thing.seen_from(camera_from_here)
        linear = Board(seen.board.cells / 255.0, seen.board.size_m)
        paint(picture, CAMERA, Placed(linear, seen.camera_from_board), PAINT_BLUR_PX)
