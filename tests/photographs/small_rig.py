"""Photographs of boards, bars and tags by one small rig of two or three cameras, with its truth."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.rigs import looking
from stereocal.system.array_types import FloatArray
from tests.files import encoded
from tools.photographs.bars import (
    BarSettings,
    facing,
    photograph_bars,
    place_boards,
    place_visible_bars,
    rod,
)
from tools.photographs.board_series import draw_board_poses
from tools.photographs.objects import tag
from tools.photographs.rendering import (
    HERE,
    PhotographSettings,
    Placed,
    chessboard,
    photograph,
    turned,
)

BASELINE_M, BAR_M, BOARD_M = 1.2, 0.6, 0.2
CORNERS, SQUARE_M = (11, 8), 0.03
"""Inner corners of the chessboard for the lenses."""
PRIMARY = Camera(
    np.array([[1012.0, 0.0, 407.5], [0.0, 1009.0, 291.0], [0.0, 0.0, 1.0]]),
    np.array([-0.19, 0.14, 0.0008, -0.0011, -0.05]),
    (800, 600),
)
SECONDARY = Camera(
    np.array([[968.0, 0.0, 391.0], [0.0, 971.5, 310.5], [0.0, 0.0, 1.0]]),
    np.array([-0.15, 0.10, -0.0009, 0.0006, -0.02]),
    (800, 600),
)
ANGLES = Angles(yaw=0.31, pitch=-0.03, roll=0.045, delta=0.14, epsilon=3.09)
OUTDOORS = PhotographSettings(blur_px=1.5, full_well_e=4000.0, read_noise=6.0)
"""Little light: centres are found to 0.02 px, which is more than the error of the lenses."""
RIG = Rig(PRIMARY, SECONDARY, Pose.from_angles(ANGLES, BASELINE_M))


@dataclass(frozen=True)
class PhotographedRig:
    """All photographs by name; `RIG` is what is true of them."""

    bars: dict[str, bytes]
    """primary/0001.png, secondary/0001.png, and so on."""
    boards: dict[str, dict[str, bytes]]
    """For `primary` and `secondary`: 01.png, 02.png, and so on."""


@lru_cache(maxsize=2)
def photographed_rig(frames: int, boards: int) -> PhotographedRig:
    """Photographs of 800x600 px before plain backgrounds.

    Args:
        frames: pairs of the bar.
        boards: photographs of the chessboard, for each camera.
    """
    rng = np.random.default_rng([0, 17])
    good_light = PhotographSettings()
    scene = place_visible_bars(RIG, rng, frames, BAR_M, BOARD_M, (2.2, 4.5), margin_px=60.0)
    grey = (110.0, 110.0)
    bars = {}
    for pair in photograph_bars(scene, grey, BAR, OUTDOORS, rng):
        bars[f"primary/{pair.frame:04}.png"] = encoded(pair.primary)
        bars[f"secondary/{pair.frame:04}.png"] = encoded(pair.secondary)
    squares = (CORNERS[0] + 1, CORNERS[1] + 1)
    board = chessboard(squares, SQUARE_M)
    series = {}
    for which, camera in (("primary", PRIMARY), ("secondary", SECONDARY)):
        poses = draw_board_poses(camera, rng, boards, squares, SQUARE_M)
        series[which] = {
            f"{at:02}.png": encoded(
                photograph(camera, 120.0, [Placed(board, pose)], good_light, rng)
            )
            for at, pose in enumerate(poses, start=1)
        }
    return PhotographedRig(bars, series)


def true_values() -> dict[str, float]:
    """The true numbers under the names of `fit.errors.uncertainty.standard_errors`."""
    found: dict[str, float] = {**ANGLES._asdict(), "baseline_m": BASELINE_M}
    for name, camera in (("primary", PRIMARY), ("secondary", SECONDARY)):
        K: FloatArray = camera.K
        for key, value in zip(
            ("fx", "fy", "cx", "cy"), (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), strict=True
        ):
            found[f"{name}_{key}"] = float(value)
    return found


CAMERAS = {"left": PRIMARY, "mid": PRIMARY, "right": SECONDARY}
TAGS = "tags:4X4_50:3,7"
SEEN_M = np.array([0.15, 0.0, 2.9])
"""What all cameras look at."""
BAR = BarSettings(board_m=BOARD_M, black=60.0, white=160.0)


def _middle() -> Pose:
    """Above the line between the others, and rolled so that it sees other ends on the left."""
    centre = 0.5 * RIG.pose.inverse().T + [0.0, -0.3, 0.0]
    return Pose(turned([0.0, 0.0, 2.0]), np.zeros(3)) @ looking(centre, SEEN_M)


POSES = {"left": HERE, "mid": _middle(), "right": RIG.pose}
"""`camera_from_left`."""


@lru_cache(maxsize=2)
def photographed_bars(
    kind: str = "bar2x2", frames: int = 12
) -> tuple[dict[str, bytes], dict[str, FloatArray]]:
    """Photographs by name (left/0001.png), and the true centres of A and B (2, 2) in each.

    Args:
        kind: `bar2x2`, whose ends look alike, or `TAGS`.
    """
    rng = np.random.default_rng(5)
    scene = place_visible_bars(RIG, rng, 4 * frames, BAR_M, BOARD_M, (2.2, 3.5), 60.0)
    inside = [
        (np.abs(PRIMARY.project(POSES["mid"].apply(ends)) - [400, 300]) < [340, 240]).all()
        for ends in scene.ends_m
    ]
    files, truth = {}, {}
    viewpoint = POSES["mid"].inverse().T
    for number, ends in enumerate(scene.ends_m[inside][:frames], start=1):
        things = place_boards(ends, viewpoint, BAR, rng)
        if kind == TAGS:
            spun = [facing(end, viewpoint, 0.2, *rng.uniform(-3, 3, 2).tolist()) for end in ends]
            things = [rod(ends[0], ends[1], viewpoint, 0.02)]
            things += [Placed(tag(n, 0.15), pose) for n, pose in zip((3, 7), spun, strict=True)]
        for name, camera in CAMERAS.items():
            seen = [one.seen_from(POSES[name]) for one in things]
            file = f"{name}/{number:04}.png"
            files[file] = encoded(photograph(camera, 110.0, seen, OUTDOORS, rng))
            truth[file] = camera.project(POSES[name].apply(ends))
    return files, truth
