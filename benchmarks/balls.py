"""How well two balls are found: `python -m benchmarks.balls [cluttered pairs]`.

Renders balls (`tools.photographs.balls`, which knows nothing of the detector) before plain
backgrounds, in even light and with light from the side, and pairs of photographs before clutter of
all hues. Half of the plain ones have linear grey levels, half are coded for a screen.
"""

import sys
import time
from collections import Counter

import cv2
import numpy as np

from stereocal.detection.ball_colours import colour_at
from stereocal.detection.balls import find_balls
from stereocal.detection.target import Balls, Sighting, parse_target
from stereocal.frames.frame import Frame
from stereocal.frames.labelling import label_frames
from stereocal.frames.pairing import PhotographPair
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import place_bars
from stereocal.system.array_types import FloatArray
from tools.photographs.balls import (
    RED,
    YELLOW,
    BallSettings,
    ColourPhotograph,
    clutter,
    photograph_balls,
    seen_by,
    side_light,
)
from tools.photographs.rendering import HERE

SIZE = (1280, 1024)
LENS = np.array([-0.2, 0.1, 0.001, -0.001, 0.0])
CAMERA = Camera(np.array([[1200.0, 0, 640], [0, 1200, 512], [0, 0, 1]]), LENS, SIZE)
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 1.2))
BALL_M, BAR_M = 0.03, 0.6
RADII = (6.0, 10.0, 15.0, 20.0, 30.0)
PHOTOGRAPHS = 100
"""For each radius and light."""
SCENE = 20
"""Cluttered pairs before the same background."""


def main() -> None:
    """Print a line for each radius and light, and the cluttered pairs."""
    for side in (False, True):
        for radius in RADII:
            off, sigma = plain_errors(radius, side)
            print(
                f"{'side' if side else 'even'} light, radius {radius:.0f} px: error {rms(off):.3f} "
                f"px rms, at most {np.abs(off).max():.2f}, stated {np.median(sigma):.3f}, "
                f"z {stated(off / sigma)}"
            )
    cluttered(int(sys.argv[1]) if len(sys.argv) > 1 else 200)


def plain_errors(radius: float, side: bool) -> tuple[FloatArray, FloatArray]:
    """Errors (n, 2) and stated sigmas (n, 1) px of the balls in `PHOTOGRAPHS` photographs."""
    rng = np.random.default_rng([int(radius), side])
    target = named("balls:#a02f35,#b79b2f")
    off, sigma = [], []
    for _ in range(PHOTOGRAPHS):
        corners = (rng.uniform((-0.45, -0.35), (-0.15, 0.35)), rng.uniform((0.15, -0.35), 0.45))
        ends = 1200 * BALL_M / radius * np.array([[*corner, 1.0] for corner in corners])
        settings = BallSettings(
            side_light(rng) if side else np.array([0.0, 0.0, -1.0]),
            direct=0.9 if side else 0.0,
            ambient=0.12 if side else 0.7,
            blur_px=float(rng.uniform(0.7, 1.6)),
            gamma=float(rng.choice([1.0, 2.2])),
        )
        grey = np.clip(rng.uniform(0.05, 0.5) * (1 + rng.normal(0, 0.1, 3)), 0, 1)
        behind = np.broadcast_to(grey.astype(np.float32), (SIZE[1], SIZE[0], 3))
        image = photograph_balls(
            CAMERA, behind, ends, BALL_M, (RED, YELLOW), settings, rng, rod_m=0.01
        )
        found = find_balls(image, target, CAMERA)
        for spot, true in zip(found.spots, CAMERA.project(ends), strict=True):
            if spot:
                off.append((spot.u - true[0], spot.v - true[1]))
                sigma.append([spot.sigma_px])
    return np.array(off), np.array(sigma)


def cluttered(pairs: int) -> None:
    """Print how many cluttered pairs are found, doubtful and wrong, and how fast."""
    rng = np.random.default_rng(0)
    counts: Counter[str] = Counter()
    seconds: list[float] = []
    z: list[FloatArray] = []
    for _ in range(0, pairs, SCENE):
        frames, truth = scene(rng, seconds)
        for frame in frames:
            right = all(
                centre is not None and np.hypot(centre.u - u, centre.v - v) < 2.0
                for name, centres in zip(frame.files, frame.centres, strict=True)
                for centre, (u, v) in zip(centres, truth[name], strict=True)
            )
            counts[f"{'right' if right else 'wrong'}, {frame.state}"] += 1
            z += [
                np.array([centre.u - u, centre.v - v]) / centre.sigma_px
                for name, centres in zip(frame.files, frame.centres, strict=True)
                for centre, (u, v) in zip(centres, truth[name], strict=True)
                if right and centre is not None and centre.sigma_px
            ]
    print(f"{counts.total()} cluttered pairs: {dict(counts)}")
    print(f"error over stated error {stated(np.array(z))}")
    print(f"{1.0 / np.median(seconds):.0f} photographs of 1280x1024 px a second, one thread")


def scene(
    rng: np.random.Generator, seconds: list[float]
) -> tuple[list[Frame], dict[str, FloatArray]]:
    """Frames before one cluttered background a camera, and the true centres by photograph."""
    behind = [clutter(SIZE, rng) for _ in range(2)]
    light = side_light(rng, 20.0, 90.0)
    target: Balls | None = None
    pairs, truth = [], {}
    seen: dict[str, Sighting] = {}
    for number, ends in enumerate(place_bars(RIG, rng, SCENE, BAR_M, (1.4, 4.0)).ends_m):
        pairs.append(PhotographPair(number, f"p{number}", f"s{number}"))
        blur, gloss = float(rng.uniform(0.7, 2.0)), float(rng.choice([0.0, 0.5]))
        for k, (name, pose) in enumerate(((f"p{number}", HERE), (f"s{number}", RIG.pose))):
            there = pose.apply(ends)
            settings = BallSettings(seen_by(light, pose), ambient=0.2, gloss=gloss, blur_px=blur)
            image = photograph_balls(
                CAMERA, behind[k], there, BALL_M, (RED, YELLOW), settings, rng, rod_m=0.012
            )
            truth[name] = CAMERA.project(there)
            target = target or clicked(image, there, light)
            start = time.process_time()
            seen[name] = find_balls(image, target, CAMERA)
            seconds.append(time.process_time() - start)
    assert target is not None
    return label_frames(pairs, seen, (CAMERA, CAMERA), target), truth


def clicked(image: ColourPhotograph, ends: FloatArray, light: FloatArray) -> Balls:
    """The colours where a person clicks: half a radius from the centre, on the lit side."""
    lit = CAMERA.project(ends + 0.5 * BALL_M * light)
    a, b = (colour_at(image, (float(u), float(v))) for u, v in lit)
    return named(f"balls:{a},{b}")


def named(text: str) -> Balls:
    """The balls that a text describes."""
    target = parse_target(text)
    assert isinstance(target, Balls)
    return target


def stated(z: FloatArray) -> str:
    """RMS of errors over stated errors (n, 2), its spread over balls drawn with replacement, and
    what it is by the median."""
    drawn = np.random.default_rng(0).integers(len(z), size=(1000, len(z)))
    spread = np.std(np.sqrt((z**2).mean(axis=1)[drawn].mean(axis=1)))
    middle = np.median(np.abs(z)) / 0.674
    return f"{rms(z):.2f} +- {spread:.2f} rms, {middle:.2f} by the median of {len(z)} balls"


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
