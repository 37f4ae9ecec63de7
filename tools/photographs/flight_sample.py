"""Two videos of a flight: `python -m tools.photographs.flight_sample --out sample_data/flight`."""

import argparse
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.system.atomic_files import write_atomically
from stereocal.system.resources import ROOT
from tools.photographs.balls import BallSettings, clutter, photograph_balls, seen_by, side_light
from tools.photographs.rendering import HERE

FRAMES, RATE = 10, 25
LENGTH_M, RADIUS_M, ROD_M = 0.42, 0.035, 0.02
HEAD, TAIL = (0.75, 0.75, 0.7), (0.06, 0.06, 0.07)
"""Linear red, green and blue."""
SHAPES = 60


def sample_rig() -> Rig:
    """The rig that took the sample's photographs."""
    truth = json.loads((ROOT / "sample_data" / "photographs" / "truth.json").read_text())
    first, second = (Camera.from_json(truth["cameras"][which], which) for which in CAMERAS)
    return Rig(first, second, Pose(truth["R"], truth["T"]))


def flight() -> FloatArray:
    """(n, 2, 3): head and tail in each frame, metres in the primary's frame."""
    time = np.arange(FRAMES) / RATE
    across, down = -0.2 + 2.2 * time, 0.3 - 1.2 * time + 2.5 * time**2
    head = np.column_stack([across, down, 13.0 + 1.5 * time])
    turn = 0.5 + 2.0 * time
    along = np.column_stack([-np.cos(turn), 0.4 * np.sin(turn), 0.5 * np.sin(turn)])
    along *= LENGTH_M / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([head, head + along], axis=1)


def write_flight_sample(out: Path) -> None:
    """Write both videos, and what is true."""
    import av

    rng, rig, ends = np.random.default_rng(4), sample_rig(), flight()
    light = side_light(rng, 50.0, 70.0)
    truth: dict[str, Any] = {"length_m": LENGTH_M, "ends_m": ends.round(6).tolist()}
    for which, pose in zip(CAMERAS, (HERE, rig.pose), strict=True):
        camera = getattr(rig, which)
        wall = clutter(camera.image_size, rng, SHAPES, grain=0.0)
        settings = BallSettings(seen_by(light, pose), ambient=0.3, gloss=0.2, blur_px=1.0)
        out.mkdir(parents=True, exist_ok=True)
        with av.open(str(out / f"{which}.mp4"), "w") as container:
            stream: Any = container.add_stream("libx264", rate=RATE)
            stream.width, stream.height = camera.image_size
            stream.pix_fmt, stream.options = "yuv420p", {"crf": "24", "preset": "veryslow"}
            stream.time_base = stream.codec_context.time_base = Fraction(1, 90_000)
            for number, each in enumerate(ends):
                scene = camera, wall, pose.apply(each), RADIUS_M, (HEAD, TAIL), settings
                image = photograph_balls(*scene, rng, rod_m=ROD_M)
                frame = av.VideoFrame.from_ndarray(image, "bgr24").reformat(format="yuv420p")
                frame.pts, frame.time_base = number * 90_000 // RATE, Fraction(1, 90_000)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        truth[which] = [camera.project(pose.apply(each)).round(3).tolist() for each in ends]
    write_atomically(out / "truth.json", (json.dumps(truth) + "\n").encode())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the videos")
    write_flight_sample(parser.parse_args().out)
