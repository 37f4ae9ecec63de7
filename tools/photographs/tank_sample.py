"""The sample of a tank: `python -m tools.photographs.tank_sample --out sample_data/tank`."""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_description import DATASET_FORMAT, DESCRIPTION
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.rig.window import WATER, Window, moved_window
from stereocal.simulation.rigs import looking
from stereocal.simulation.simulate import TRUTH, Scene
from stereocal.system.atomic_files import write_atomically
from tools.photographs.backgrounds import indoors
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import PhotographSettings, Picture, turned
from tools.photographs.sample import jpeg

BAR_M, FRAMES = 0.2, 24
THICKNESS_M, ACRYLIC = 0.01, 1.49
BASELINE_SIGMA_M = 0.001
DEPTHS_M = (0.58, 1.0)
"""Of the targets, from the cameras; the wall is at 0.38 to 0.5 m."""
SIZE = (800, 600)
JPEG_QUALITY = 50
BAR = BarSettings(board_m=0.05, rod_m=0.006)
MURKY = 0.5
"""Of the contrast of what is seen at the back of the tank."""


def sample_rig() -> Rig:
    """The rig that takes the photographs, its cameras with the window as each sees it.

    The world's origin is on the dry face of the wall, z leads into the water.
    """
    lens = np.array([-0.12, 0.06, 0.0004, -0.0006, 0.0])
    left = Camera(np.array([[962.0, 0, 404.5], [0, 960.5, 296.0], [0, 0, 1]]), lens, SIZE)
    right = Camera(np.array([[955.0, 0, 396.0], [0, 956.5, 303.5], [0, 0, 1]]), lens, SIZE)
    wall = Window((0.0, 0.0, 1.0), 1.0, THICKNESS_M, ACRYLIC, WATER)
    places = (np.array([-0.253, 0.004, -0.395]), np.array([0.249, -0.011, -0.408]))
    aims = (np.array([-0.1075, 0.012, 0.0]), np.array([0.1005, -0.004, 0.0]))
    poses, cameras = [], []
    for camera, place, aim, roll in zip((left, right), places, aims, (0.02, -0.015), strict=True):
        level = looking(place, aim)
        pose = Pose(turned((0.0, 0.0, roll)), np.zeros(3)) @ level
        # The wall is at the world's origin; a window needs a distance, so that it is measured.
        seen = moved_window(replace(wall, distance_m=1e-12), pose)
        poses.append(pose)
        cameras.append(replace(camera, window=seen))
    return Rig(cameras[0], cameras[1], poses[1] @ poses[0].inverse())


def write_tank_sample(out: Path, frames: int = FRAMES) -> None:
    """Write the data set without its points, which `detect` finds; 0.3 MB as it is shipped."""
    rng, rig = np.random.default_rng(0), sample_rig()
    scene = place_visible_bars(rig, rng, frames, BAR_M, BAR.board_m, DEPTHS_M, margin_px=45.0)
    behind = tuple(_murky(indoors(camera, rng)) for camera in (rig.primary, rig.secondary))
    truth = []
    for pair in photograph_bars(scene, (behind[0], behind[1]), BAR, PhotographSettings(), rng):
        row: dict[str, object] = {"frame": pair.frame}
        for which in CAMERAS:
            content = jpeg(getattr(pair, which), JPEG_QUALITY)
            write_atomically(out / which / f"{pair.frame:04d}.jpg", content)
            row[which] = np.round(getattr(pair, f"centres_{which}"), 4).tolist()
        truth.append(row)
    for name, content in _described(rig).items():
        write_atomically(out / name, content)
    write_atomically(out / TRUTH, (json.dumps(_true(scene, truth)) + "\n").encode())


def _murky(picture: Picture) -> Picture:
    return np.asarray(picture.mean() + MURKY * (picture - picture.mean()), dtype=np.float32)


def _described(rig: Rig) -> dict[str, bytes]:
    """`dataset.json`, and the lenses as calibrated in air."""
    window = {"thickness_m": THICKNESS_M, "glass": ACRYLIC, "medium": WATER}
    description = {
        "format": DATASET_FORMAT,
        "name": "tank",
        "baseline_m": round(rig.pose.baseline, 3),
        "baseline_sigma_m": BASELINE_SIGMA_M,
        "target_distance_m": BAR_M,
        "window": {"cameras": CAMERAS, **window},
        "notes": f"Simulated photographs, seed 0; the truth is in {TRUTH}.",
        "cameras": {which: f"{which}.json" for which in CAMERAS},
    }
    files = {DESCRIPTION: (json.dumps(description, indent=2) + "\n").encode()}
    for which in CAMERAS:
        files[f"{which}.json"] = write_camera(replace(getattr(rig, which), window=None))
    return files


def _true(scene: Scene, images: list[dict[str, object]]) -> dict[str, Any]:
    rig = scene.rig
    seen = [camera.window for camera in (rig.primary, rig.secondary)]
    windows = [window.to_json() for window in seen if window is not None]
    return {
        "R": rig.pose.R.tolist(),
        "T": rig.pose.T.tolist(),
        "windows": dict(zip(CAMERAS, windows, strict=True)),
        "ends_m": scene.ends_m.round(6).tolist(),
        "images": images,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the data set")
    write_tank_sample(parser.parse_args().out)
