"""Photographs with another board beside the two targets."""

from collections.abc import Iterator

import cv2
import numpy as np

from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import field_rig
from stereocal.system.array_types import FloatArray
from tests.bar_photographs import BAR_M, BOARD_M, DEPTHS_M, small
from tools.photographs.bars import (
    BarSettings,
    PhotographPair,
    facing,
    place_boards,
    place_visible_bars,
)
from tools.photographs.rendering import (
    PhotographSettings,
    Picture,
    Placed,
    photograph,
    x_corner_board,
)

WITH_ANOTHER = 0.4
"""In so many frames of a series there is a third board: it stands behind the bar in the others."""


BAR = BarSettings(board_m=BOARD_M)
SETTINGS = PhotographSettings()


def small_rig() -> Rig:
    """The rig of the field study with pixels four times as large."""
    field = field_rig(baseline_m=2.0)
    return Rig(small(field.primary), small(field.secondary), field.pose)


def cluttered(size: tuple[int, int], rng: np.random.Generator) -> Picture:
    """Rectangles, crosses, lines, and some patches of four rectangles that are nearly a board."""
    width, height = size
    grey = np.full((height, width), 110.0, np.float32)
    for _ in range(12):
        u, v = rng.uniform(0, [width, height])
        sides, shade = rng.uniform(8, 60, 2), float(rng.uniform(20, 220))
        box = cv2.boxPoints(((u, v), tuple(sides), float(rng.uniform(0, 180))))
        cv2.fillConvexPoly(grey, np.round(box * 16).astype(np.int32), shade, cv2.LINE_AA, 4)
    for _ in range(15):
        ends = np.round(rng.uniform(0, [width, height], (2, 2)) * 16).astype(np.int32)
        shade, thick = float(rng.uniform(20, 220)), int(rng.integers(1, 6))
        cv2.line(grey, tuple(ends[0]), tuple(ends[1]), shade, thick, cv2.LINE_AA, 4)
    for _ in range(2):
        u, v, turn = *rng.uniform(30, [width - 30, height - 30]), rng.uniform(0, np.pi)
        side = rng.uniform(12, 30)
        shades = float(rng.uniform(30, 60)), float(rng.uniform(150, 215))
        axis = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        for i, j in np.ndindex(2, 2):
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - [i, j]
            stretch = side * rng.uniform(0.75, 1.3)
            outline = np.round(([u, v] + stretch * corners @ axis) * 16).astype(np.int32)
            cv2.fillConvexPoly(grey, outline, shades[(i + j) % 2], cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.8), dtype=np.float32)


def taken(kind: str, frames: int, rng: np.random.Generator) -> Iterator[PhotographPair]:
    """The photographs of one series."""
    rig = small_rig()
    scene = place_visible_bars(rig, rng, frames, BAR_M, BOARD_M, DEPTHS_M, margin_px=40.0)
    cameras = (rig.primary, rig.secondary)
    backgrounds: list[Picture | float] = [110.0, 110.0]
    if kind == "clutter":
        backgrounds = [cluttered(camera.image_size, rng) for camera in cameras]
    poses = (Pose(np.eye(3), np.zeros(3)), rig.pose)
    viewpoint = 0.5 * rig.pose.inverse().T
    place = next(_places(rig, rng))
    for frame, ends in enumerate(scene.ends_m, start=1):
        there = kind != "clutter" and rng.uniform() < WITH_ANOTHER
        if there and kind == "on the line":
            place = _on_the_line(rig, ends, rng)
        if there and kind == "at its length":
            place = _at_its_length(rig, ends, rng)
        bar = place_boards(ends, viewpoint, BAR, rng)
        third = Placed(
            x_corner_board(BOARD_M, BAR.black, BAR.white, bool(rng.integers(2))),
            facing(place, viewpoint, float(rng.uniform(0, 0.5)), *rng.uniform(-np.pi, np.pi, 2)),
        )
        images = []
        for which, (camera, pose) in enumerate(zip(cameras, poses, strict=True)):
            shown = [*([third] if there else []), *bar]
            if there and kind == "hidden" and which == 1:
                shown = [one for one in shown if not _is_at(one, ends[1])]
            moved = [one.seen_from(pose) for one in shown]
            images.append(photograph(camera, backgrounds[which], moved, SETTINGS, rng))
        centres = [
            camera.project(pose.apply(ends)) for camera, pose in zip(cameras, poses, strict=True)
        ]
        yield PhotographPair(frame, images[0], images[1], centres[0], centres[1])


def _is_at(placed: Placed, point: FloatArray) -> bool:
    return bool(np.linalg.norm(placed.camera_from_board.T - point) < 1e-9)


def _places(rig: Rig, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Places that both cameras see, as bars have them."""
    while True:
        yield place_visible_bars(rig, rng, 1, BAR_M, BOARD_M, DEPTHS_M, margin_px=40.0).ends_m[0, 0]


def _on_the_line(rig: Rig, ends: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A place in the epipolar plane of target B, which both cameras see, apart from the bar."""
    eye = rig.pose.inverse().T
    for place in _places(rig, rng):
        normal = np.cross(eye, ends[1]) / np.linalg.norm(np.cross(eye, ends[1]))
        moved: FloatArray = place - (place @ normal) * normal
        if np.linalg.norm(moved - place) < 1.0 and _shows(rig, ends, moved):
            return moved
    raise AssertionError


def _at_its_length(rig: Rig, ends: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A place as far from target A as B is, which both cameras see, apart from the bar."""
    while True:
        away = rng.normal(size=3)
        place: FloatArray = ends[0] + BAR_M * away / np.linalg.norm(away)
        if _shows(rig, ends, place):
            return place


def _shows(rig: Rig, ends: FloatArray, place: FloatArray) -> bool:
    """Whether both cameras see a third board at this place whole, and apart from the bar's."""
    for camera, pose in ((rig.primary, Pose(np.eye(3), np.zeros(3))), (rig.secondary, rig.pose)):
        pixels = camera.project(pose.apply(np.vstack([ends, place])))
        apart = np.linalg.norm(pixels[:2] - pixels[2], axis=1).min() > 60
        inside = ((pixels[2] > 30) & (pixels[2] < np.array(camera.image_size) - 30)).all()
        if not (apart and inside):
            return False
    return True
