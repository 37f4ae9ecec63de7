"""Small photographs of a bar by three cameras, one of them rolled, with known centres."""

from functools import lru_cache

import numpy as np

from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from tests.files import encoded
from tests.photographed_rig import BAR_M, BOARD_M, OUTDOORS, PRIMARY, RIG, SECONDARY
from tools.photographs.bars import BarSettings, facing, place_boards, place_visible_bars, rod
from tools.photographs.objects import tag
from tools.photographs.rendering import HERE, Placed, photograph, turned

CAMERAS = {"left": PRIMARY, "mid": PRIMARY, "right": SECONDARY}
TAGS = "tags:4X4_50:3,7"
SEEN_M = np.array([0.15, 0.0, 2.9])
"""What all cameras look at."""
BAR = BarSettings(board_m=BOARD_M, black=60.0, white=160.0)


def _middle() -> Pose:
    """Above the line between the others, and rolled so that it sees other ends on the left."""
    centre = 0.5 * RIG.pose.inverse().T + [0.0, -0.3, 0.0]
    ahead = SEEN_M - centre
    ahead = ahead / np.linalg.norm(ahead)
    across = np.cross([0.0, 1.0, 0.0], ahead)
    across /= np.linalg.norm(across)
    R = turned([0.0, 0.0, 2.0]) @ np.vstack([across, np.cross(ahead, across), ahead])
    return Pose(R, -R @ centre)


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
