"""Small colour photographs of a bar with a red and a yellow ball, with known centres."""

from functools import lru_cache

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tests.files import encoded
from tools.photographs.balls import (
    RED,
    YELLOW,
    BallSettings,
    ColourPicture,
    clutter,
    photograph_balls,
    seen_by,
    side_light,
)
from tools.photographs.bars import place_visible_bars
from tools.photographs.rendering import HERE

BALL_M, BAR_M = 0.03, 0.5
"""Radius of a ball, length of the bar."""
COLOURS = "balls:#a02f35,#b79b2f"
"""Those that a person picks on the lit side."""
LENS = np.array([-0.2, 0.1, 0.001, -0.001, 0.0])
CAMERA = Camera(np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]]), LENS, (640, 480))
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 0.9))


def plain(level: float, size: tuple[int, int] = CAMERA.image_size) -> ColourPicture:
    """A background of one grey."""
    return np.full((size[1], size[0], 3), level, np.float32)


@lru_cache(maxsize=2)
def ball_bars(frames: int, seed: int = 4) -> tuple[dict[str, bytes], dict[str, FloatArray]]:
    """Photographs by name (primary/0001.png), and the true centres of A and B in each."""
    rng = np.random.default_rng(seed)
    files, truth = {}, {}
    scene = place_visible_bars(RIG, rng, frames, BAR_M, 2 * BALL_M, (1.2, 2.0), margin_px=40.0)
    behind = [clutter(CAMERA.image_size, rng, 25) for _ in range(2)]
    light = side_light(rng, 30.0, 70.0)
    for number, ends in enumerate(scene.ends_m, start=1):
        for k, (which, pose) in enumerate((("primary", HERE), ("secondary", RIG.pose))):
            name = f"{which}/{number:04}.png"
            there = pose.apply(ends)
            settings = BallSettings(seen_by(light, pose), ambient=0.2)
            image = photograph_balls(
                CAMERA, behind[k], there, BALL_M, (RED, YELLOW), settings, rng, rod_m=0.01
            )
            files[name], truth[name] = encoded(image), CAMERA.project(there)
    return files, truth
