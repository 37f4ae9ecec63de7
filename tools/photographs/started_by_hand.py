"""Small videos of a bar with two balls, of two cameras or three that were started by hand.

    python -m tools.photographs.started_by_hand --out FOLDER [--cameras 3]

The right camera was started `START_S` after the left, its clock is slow by `DRIFT`, the third was
started `THIRD_S` after the left, and all microphones hear claps. `dataset.json` and the camera
files are beside them.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from stereocal.formats.camera_file import write_camera
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.system.photograph import GreyImage
from tools.photographs.rendering import HERE
from tools.photographs.videos import HERTZ, write_video

START_S, THIRD_S, DRIFT, RATE, SECONDS = 2.17, 1.33, 40e-6, 30, 9
BAR_M, BALL_M, MIDDLE_M = 0.5, 0.03, (0.13, -0.07, 2.0)
CAMERA = Camera(np.array([[400.0, 0, 160], [0, 400, 120], [0, 0, 1]]), np.zeros(5), (320, 240))
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 0.9))
THIRD = Pose.from_angles(Angles(0.16, 0.02, -0.1, 0.6, 3.0), 0.5)
RED, YELLOW = (230, 40, 40), (230, 220, 40)


class Bar:
    """A bar that is waved before both cameras, and claps."""

    def __init__(self, seed: int = 3, seconds: float = START_S + SECONDS + 2) -> None:
        rng = np.random.default_rng(seed)
        knots = np.arange(-1.0, seconds + 1.0, 0.6)
        places = rng.uniform(-1, 1, (len(knots), 3)) * (0.2, 0.2, 0.3) + MIDDLE_M
        turns = np.column_stack([np.ones(len(knots)), rng.uniform(-1.2, 1.2, (len(knots), 2))])
        self.path = CubicSpline(knots, np.column_stack([places, turns]))
        self.claps_s = rng.uniform(0.0, seconds, 7)

    def ends_m(self, at_s: float) -> FloatArray:
        """(2, 3): red and yellow."""
        found = self.path(at_s)
        half = 0.5 * BAR_M * found[3:] / np.linalg.norm(found[3:])
        return np.stack([found[:3] - half, found[:3] + half])

    def picture(self, pose: Pose, at_s: float) -> GreyImage:
        """What a camera at a pose sees, in colours."""
        image = np.full((*CAMERA.image_size[::-1], 3), 90, np.uint8)
        there = pose.apply(self.ends_m(at_s))
        for (u, v), z, colour in zip(
            CAMERA.project(there), there[:, 2], (RED, YELLOW), strict=True
        ):
            at, radius = (round(16 * u), round(16 * v)), round(16 * 400 * BALL_M / z)
            cv2.circle(image, at, radius, colour, -1, cv2.LINE_AA, 4)
        return image

    def sound(self, start_s: float, late_s: float = 0.0) -> FloatArray:
        """The claps as a camera hears them."""
        rng = np.random.default_rng(round(1000 * abs(start_s)))
        found = rng.normal(0.0, 0.003, SECONDS * HERTZ)
        for clap in self.claps_s:
            at = round((clap - start_s + late_s) * HERTZ)
            if 0 <= at < len(found) - 800:
                found[at : at + 800] += rng.normal(0, 0.3, 800) * np.exp(-np.arange(800) / 150)
        return found


def write_sample(
    out: Path, late_s: float = 0.02, cameras: int = 2, seconds: int = SECONDS
) -> list[Path]:
    """Write the videos, `dataset.json` and the camera files.

    Args:
        late_s: by how much the others store their sound later than the left camera.
    """
    bar, paths = Bar(), list[Path]()
    out.mkdir(parents=True, exist_ok=True)
    started = ("left", HERE, 0.0, 0.0), ("right", RIG.pose, START_S, DRIFT)
    for name, pose, start, drift in (*started, ("third", THIRD, THIRD_S, 0.0))[:cameras]:
        own = np.arange(seconds * RATE) / RATE
        true = start + own * (1 + drift)

        def draw(k: int, pose: Pose = pose, true: FloatArray = true) -> GreyImage:
            return bar.picture(pose, float(true[k]))

        sound = bar.sound(start, late_s if start else 0.0)[: seconds * HERTZ]
        path = out / f"{name}.mp4"
        paths.append(write_video(path, own.tolist(), draw=draw, preset="ultrafast", sound=sound))
    (out / "camera.json").write_bytes(write_camera(CAMERA))
    if cameras == 2:
        format_of, names = "stereocal-dataset/1", ["primary", "secondary"]
        lengths: Any = {"baseline_m": RIG.pose.baseline, "target_distance_m": BAR_M}
    else:
        format_of, names = "stereocal-dataset/2", [path.stem for path in paths]
        lengths = {"object": {"red": [0, 0, 0], "yellow": [BAR_M, 0, 0]}}
    about = {"format": format_of, "cameras": dict.fromkeys(names, "camera.json")}
    (out / "dataset.json").write_text(json.dumps(about | lengths))
    return paths


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the videos")
    parser.add_argument("--cameras", type=int, default=2, choices=(2, 3), help="how many")
    parsed = parser.parse_args()
    write_sample(parsed.out, cameras=parsed.cameras)
