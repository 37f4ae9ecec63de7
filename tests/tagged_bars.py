"""Small photographs of a bar with a tag at each end, with known centres."""

from functools import lru_cache

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from tests.files import encoded
from tools.photographs.bars import facing, place_visible_bars, rod
from tools.photographs.objects import tag
from tools.photographs.rendering import HERE, PhotographSettings, Placed, photograph

TAG_M, BAR_M, IDS = 0.1, 0.6, (3, 7)
LENS = np.array([-0.2, 0.1, 0.001, -0.001, 0.0])
CAMERA = Camera(np.array([[900.0, 0, 400], [0, 900, 300], [0, 0, 1]]), LENS, (800, 600))
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 1.2))


def tags_in(
    camera: Camera,
    camera_from_here: Pose,
    ends: FloatArray,
    poses: list[Pose],
    settings: PhotographSettings,
    rng: np.random.Generator,
) -> tuple[np.ndarray, FloatArray]:
    """The photograph of both tags on their bar, and the true centres (2, 2) px."""
    eye = camera_from_here.inverse().T
    things = [rod(ends[0], ends[1], eye, 0.02)]
    things += [Placed(tag(n, TAG_M), pose) for n, pose in zip(IDS, poses, strict=True)]
    seen = [one.seen_from(camera_from_here) for one in things]
    image = photograph(camera, 110.0, seen, settings, rng)
    return image, camera.project(camera_from_here.apply(ends))


@lru_cache(maxsize=1)
def tagged_bars(frames: int) -> tuple[dict[str, bytes], dict[str, FloatArray]]:
    """Photographs by name (primary/0001.png), and the true centres of A and B in each."""
    rng = np.random.default_rng(2)
    files, truth = {}, {}
    scene = place_visible_bars(RIG, rng, frames, BAR_M, TAG_M, (1.2, 2.0), margin_px=60.0)
    viewpoint = 0.5 * RIG.pose.inverse().T
    for number, ends in enumerate(scene.ends_m, start=1):
        poses = [
            facing(end, viewpoint, *rng.uniform((0, -3, -3), (0.7, 3, 3)).tolist()) for end in ends
        ]
        for which, pose in (("primary", HERE), ("secondary", RIG.pose)):
            name = f"{which}/{number:04}.png"
            image, truth[name] = tags_in(CAMERA, pose, ends, poses, PhotographSettings(), rng)
            files[name] = encoded(image)
    return files, truth
