"""How well targets are found in photographs whose truth is known.

    python -m benchmarks.photographs [clutter|balls|balls-in-clutter] [--trials N]

- clutter: full-size pairs (2336x1728) with houses, a fence, leaves, grass and a chessboard about:
  backgrounds with 10 pairs each, boards leaning up to 60 degrees, blur 0.5 to 2 px, read noise 0.5
  to 6 grey levels (`--seed`);
- balls: two balls (`tools.photographs.balls`, which knows nothing of the detector) for each radius,
  in even light and with light from the side; half of the photographs have linear grey levels, half
  are coded for a screen;
- balls-in-clutter: scenes of 20 pairs before clutter of all hues.
"""

import time
from collections import Counter

import cv2
import numpy as np

from benchmarks.studies import Asked, rms, run_studies, spread
from stereocal.detection.ball_colours import colour_at
from stereocal.detection.balls import find_balls
from stereocal.detection.detect import detect_targets
from stereocal.detection.target import BAR, Balls, Sighting, Target, parse_target
from stereocal.frames.frame import Frame
from stereocal.frames.labelling import label_frames
from stereocal.frames.pairing import PhotographPair
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import field_rig, place_bars
from stereocal.system.array_types import FloatArray
from tools.photographs.backgrounds import outdoors
from tools.photographs.balls import (
    RED,
    YELLOW,
    BallSettings,
    clutter,
    photograph_balls,
    seen_by,
    side_light,
)
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import HERE, PhotographSettings

PER_SCENE = 10
"""Pairs of one background: the geometry of all of them tells A and B apart."""
WRONG_PX = 1.0
SIZE = (1280, 1024)
LENS = np.array([-0.2, 0.1, 0.001, -0.001, 0.0])
CAMERA = Camera(np.array([[1200.0, 0, 640], [0, 1200, 512], [0, 0, 1]]), LENS, SIZE)
RIG = Rig(CAMERA, CAMERA, Pose.from_angles(Angles(0.3, -0.03, 0.04, 0.1, 3.1), 1.2))
BALL_M, BAR_M, BALL_PAIRS = 0.03, 0.6, 20
RADII = (6.0, 10.0, 15.0, 20.0, 30.0)
Truth = dict[str, FloatArray]
"""By photograph, the true centres (2, 2)."""


def judged(frame: Frame, truth: Truth, orders: tuple[int, ...]) -> tuple[str, FloatArray]:
    """Right or wrong with the frame's state, and the errors (2, 2, 2); NaN of what is not found.

    Args:
        orders: 1, and -1 where A and B may be exchanged in both photographs.
    """
    found = np.array(
        [[(c.u, c.v) if c else (np.nan, np.nan) for c in own] for own in frame.centres]
    )
    true = np.stack([truth[name] for name in frame.files])
    errors = [found - true[:, ::order] for order in orders]
    least = min(errors, key=lambda error: float(np.nan_to_num(np.abs(error), nan=np.inf).max()))
    right = bool(np.abs(least).max() < WRONG_PX)
    return f"{'right' if right else 'WRONG'}, {frame.state}", least


def label(seen: dict[str, Sighting], cameras: tuple[Camera, Camera], target: Target) -> list[Frame]:
    """The frames of photographs p1, s1, p2 ..."""
    count = len(seen) // 2
    pairs = [PhotographPair(k, f"p{k}", f"s{k}") for k in range(1, count + 1)]
    return label_frames(pairs, seen, cameras, target)


def in_clutter(asked: Asked) -> None:
    """Pairs of the bar outdoors: labels, errors and seconds."""
    detect_targets(np.zeros((64, 64), np.uint8))  # compiled before anything is timed
    rig, states, frames = field_rig(), Counter[str](), Counter[str]()
    errors, seconds = list[FloatArray](), list[float]()
    for number in range(asked.trials // PER_SCENE or 1):
        rng = np.random.default_rng([asked.first, number])
        scene = place_visible_bars(rig, rng, PER_SCENE, 0.9)
        backgrounds = outdoors(rig, rng, softness_px=float(rng.uniform(0, 2)))
        black, white = rng.uniform(20, 60), rng.uniform(110, 220)
        bar = BarSettings(black=black, white=white, tilt_rad=(0.0, float(np.deg2rad(60))))
        settings = PhotographSettings(
            blur_px=float(rng.uniform(0.5, 2)), read_noise=float(rng.uniform(0.5, 6))
        )
        seen: dict[str, Sighting] = {}
        truth: Truth = {}
        for pair in photograph_bars(scene, backgrounds, bar, settings, rng):
            for name, image, centres in (
                (f"p{pair.frame}", pair.primary, pair.centres_primary),
                (f"s{pair.frame}", pair.secondary, pair.centres_secondary),
            ):
                began = time.thread_time()
                found = detect_targets(image)
                seconds.append(time.thread_time() - began)
                states[found.state] += 1
                seen[name], truth[name] = found.sighting, centres
        for frame in label(seen, (rig.primary, rig.secondary), BAR):
            word, error = judged(frame, truth, (1, -1))
            frames[word] += 1
            errors += [error.ravel()] if word.startswith("right") else []
    every = np.concatenate(errors)
    print(f"  photographs {dict(states)}; frames {dict(frames)}")
    print(
        f"  error of a coordinate: RMS {rms(every):.4f} px, median {np.median(np.abs(every)):.4f} "
        f"px, largest {np.abs(every).max():.3f} px; {spread(seconds)} s of CPU a photograph"
    )


def balls(asked: Asked) -> None:
    """A line for each radius and light."""
    for side, radius in ((side, radius) for side in (False, True) for radius in RADII):
        off, sigma = plain_errors(radius, side, asked.trials)
        print(
            f"  {'side' if side else 'even'} light, radius {radius:.0f} px: error {rms(off):.3f} "
            f"px rms, at most {np.abs(off).max():.2f}, stated {np.median(sigma):.3f}, error over "
            f"stated {rms(off / sigma):.2f}"
        )


def plain_errors(radius: float, side: bool, photographs: int) -> tuple[FloatArray, FloatArray]:
    """Errors (n, 2) and stated sigmas (n, 1) px of the balls."""
    rng = np.random.default_rng([int(radius), side])
    target = named("balls:#a02f35,#b79b2f")
    off, sigma = [], []
    for _ in range(photographs):
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
        colours = RED, YELLOW
        image = photograph_balls(CAMERA, behind, ends, BALL_M, colours, settings, rng, rod_m=0.01)
        found = find_balls(image, target, CAMERA)
        for spot, true in zip(found.spots, CAMERA.project(ends), strict=True):
            if spot:
                off.append((spot.u - true[0], spot.v - true[1]))
                sigma.append([spot.sigma_px])
    return np.array(off), np.array(sigma)


def balls_in_clutter(asked: Asked) -> None:
    """How many cluttered pairs are right, doubtful and wrong."""
    rng, counts, z = np.random.default_rng(0), Counter[str](), list[FloatArray]()
    for _ in range(0, asked.trials, BALL_PAIRS):
        frames, truth = ball_scene(rng)
        for frame in frames:
            word, error = judged(frame, truth, (1,))
            counts[word] += 1
            if word.startswith("right"):
                sigma = [[c.sigma_px if c else np.nan for c in own] for own in frame.centres]
                z.append(error / np.array(sigma, dtype=np.float64)[..., None])
    print(f"  {dict(counts)}; error over stated error {rms(z):.2f} rms")


def ball_scene(rng: np.random.Generator) -> tuple[list[Frame], Truth]:
    """Frames before one cluttered background a camera, and the true centres by photograph."""
    behind = [clutter(SIZE, rng) for _ in range(2)]
    light = side_light(rng, 20.0, 90.0)
    target: Balls | None = None
    seen: dict[str, Sighting] = {}
    truth: Truth = {}
    for number, ends in enumerate(place_bars(RIG, rng, BALL_PAIRS, BAR_M, (1.4, 4.0)).ends_m, 1):
        blur, gloss = float(rng.uniform(0.7, 2.0)), float(rng.choice([0.0, 0.5]))
        for k, (name, pose) in enumerate(((f"p{number}", HERE), (f"s{number}", RIG.pose))):
            there = pose.apply(ends)
            settings = BallSettings(seen_by(light, pose), ambient=0.2, gloss=gloss, blur_px=blur)
            image = photograph_balls(
                CAMERA, behind[k], there, BALL_M, (RED, YELLOW), settings, rng, rod_m=0.012
            )
            truth[name] = CAMERA.project(there)
            if target is None:
                # Clicked half a radius from the centre, on the lit side.
                lit = CAMERA.project(there + 0.5 * BALL_M * light)
                a, b = (colour_at(image, (float(u), float(v))) for u, v in lit)
                target = named(f"balls:{a},{b}")
            seen[name] = find_balls(image, target, CAMERA)
    assert target is not None
    return label(seen, (CAMERA, CAMERA), target), truth


def named(text: str) -> Balls:
    """The balls that a text describes."""
    target = parse_target(text)
    assert isinstance(target, Balls)
    return target


if __name__ == "__main__":
    cv2.setNumThreads(1)
    studies = {
        "clutter": (in_clutter, 200),
        "balls": (balls, 100),
        "balls-in-clutter": (balls_in_clutter, 200),
    }
    run_studies(studies, __doc__)
