"""The sample of two balls: `python -m tools.photographs.ball_sample --out sample_data/balls`."""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.system.atomic_files import write_atomically
from tools.photographs.balls import (
    RED,
    YELLOW,
    BallSettings,
    clutter,
    photograph_balls,
    seen_by,
    side_light,
)
from tools.photographs.bars import place_visible_bars
from tools.photographs.rendering import HERE

BALL_M, BAR_M, BASELINE_M, FRAMES = 0.03, 0.6, 1.1, 20
"""Radius of a ball, distance of their centres, and of the cameras."""
DEPTHS_M = (1.5, 2.6)
JPEG_QUALITY = 70
SIZE = (800, 600)
SHAPES = 45


def sample_rig() -> Rig:
    """The rig that takes the photographs."""
    lens = np.array([-0.21, 0.12, 0.0006, -0.0008, 0.0])
    left = Camera(np.array([[1010.0, 0, 404.5], [0, 1008, 296.0], [0, 0, 1]]), lens, SIZE)
    right = Camera(np.array([[1003.0, 0, 396.0], [0, 1004.5, 303.5], [0, 0, 1]]), lens, SIZE)
    return Rig(left, right, Pose.from_angles(Angles(0.33, -0.02, 0.03, 0.06, 3.08), BASELINE_M))


def write_ball_sample(out: Path, frames: int = FRAMES) -> None:
    """Write the data set; 0.8 MB as it is shipped."""
    rng = np.random.default_rng(0)
    rig = sample_rig()
    scene = place_visible_bars(rig, rng, frames, BAR_M, 2 * BALL_M, DEPTHS_M, margin_px=40.0)
    light = side_light(rng, 50.0, 70.0)
    behind = [clutter(SIZE, rng, SHAPES, grain=0.06) for _ in CAMERAS]
    truth, quality = [], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    for frame, ends in enumerate(scene.ends_m, start=1):
        row: dict[str, object] = {"frame": frame}
        for which, pose, wall in zip(CAMERAS, (HERE, rig.pose), behind, strict=True):
            camera, there = getattr(rig, which), pose.apply(ends)
            settings = BallSettings(seen_by(light, pose), ambient=0.2, gloss=0.3, blur_px=0.9)
            scene_of = camera, wall, there, BALL_M, (RED, YELLOW), settings
            image = photograph_balls(*scene_of, rng, rod_m=0.012)
            coded = cv2.imencode(".jpg", image, quality)[1].tobytes()
            write_atomically(out / which / f"{frame:04}.jpg", coded)
            row[which] = np.round(camera.project(there), 4).tolist()
        truth.append(row)
    description = {
        "format": "stereocal-dataset/1",
        "name": "two balls",
        "baseline_m": BASELINE_M,
        "target_distance_m": BAR_M,
        "notes": "Simulated photographs, seed 0; the centres are in truth.json.",
        "cameras": {which: f"{which}.json" for which in CAMERAS},
    }
    for which in CAMERAS:
        write_atomically(out / f"{which}.json", write_camera(getattr(rig, which)))
    write_atomically(out / "dataset.json", (json.dumps(description, indent=2) + "\n").encode())
    content = {"R": rig.pose.R.tolist(), "T": rig.pose.T.tolist(), "centres": truth}
    write_atomically(out / "truth.json", (json.dumps(content) + "\n").encode())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the data set")
    write_ball_sample(parser.parse_args().out)
