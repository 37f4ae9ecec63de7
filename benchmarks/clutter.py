"""Full-size pairs of the bar among houses, leaves, fences and a chessboard: labels and seconds.

python -m benchmarks.clutter [--pairs 200] [--seed 4]
"""

import os
import time
from collections import Counter
from typing import Any

import cv2
import numpy as np

from benchmarks.studies import numbers_asked
from stereocal.detection.detect import Detection, detect_targets
from stereocal.detection.target import BAR
from stereocal.frames.frame import Frame
from stereocal.frames.labelling import label_frames
from stereocal.frames.pairing import PhotographPair
from stereocal.rig.camera import Camera
from stereocal.simulation.simulate import field_rig
from stereocal.system.array_types import FloatArray
from tools.photographs.backgrounds import outdoors
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import PhotographSettings

PER_SCENE = 10
"""Pairs of one background: the geometry of all of them tells A and B apart."""
WRONG_PX = 1.0

Found = tuple[dict[int, Detection], dict[int, Detection]]
Truth = dict[int, tuple[FloatArray, FloatArray]]


def right(detection: Detection, centres: FloatArray) -> bool:
    """Both targets are where they are, in either order."""
    if detection.targets is None:
        return False
    found = np.array([corner.centre for corner in detection.targets])
    off = min(np.abs(found - centres).max(), np.abs(found - centres[::-1]).max())
    return bool(off < WRONG_PX)


def detected(seed: int, number: int) -> tuple[Found, Truth, list[float]]:
    """The detections in the pairs before one background, the truth, and CPU seconds of each."""
    rng = np.random.default_rng([seed, number])
    rig = field_rig()
    scene = place_visible_bars(rig, rng, PER_SCENE, 0.9)
    backgrounds = outdoors(rig, rng, softness_px=float(rng.uniform(0, 2)))
    black, white = rng.uniform(20, 60), rng.uniform(110, 220)
    bar = BarSettings(black=black, white=white, tilt_rad=(0.0, float(np.deg2rad(60))))
    settings = PhotographSettings(
        blur_px=float(rng.uniform(0.5, 2)), read_noise=float(rng.uniform(0.5, 6))
    )
    found: Found = ({}, {})
    truth, seconds = {}, []
    for pair in photograph_bars(scene, backgrounds, bar, settings, rng):
        truth[pair.frame] = (pair.centres_primary, pair.centres_secondary)
        for which, image in enumerate((pair.primary, pair.secondary)):
            began = time.thread_time()
            found[which][pair.frame] = detect_targets(image)
            seconds.append(time.thread_time() - began)
    return found, truth, seconds


def labelled(found: Found, cameras: tuple[Camera, Camera]) -> list[Frame]:
    """The frames of the detections."""
    pairs = [PhotographPair(frame, f"primary {frame}", f"secondary {frame}") for frame in found[0]]
    seen = {f"primary {frame}": one.sighting for frame, one in found[0].items()}
    seen |= {f"secondary {frame}": one.sighting for frame, one in found[1].items()}
    return label_frames(pairs, seen, cameras, BAR)


def judged_labels(labelling: list[Frame], found: Found, truth: Truth) -> dict[str, Any]:
    """How many pairs are whole and rightly labelled, how many wrong and sure, and the errors."""
    good = labelled = wrong_sure = 0
    errors: list[float] = []
    for frame, centres in truth.items():
        both = all(right(found[i][frame], centres[i]) for i in range(2))
        good += both
        report = next(each for each in labelling if each.frame == frame)
        if not both:
            wrong_sure += report.use
            continue
        expected = np.stack(centres, axis=1)
        off = report.places - expected
        off = off if np.abs(off).max() < WRONG_PX else report.places - expected[::-1]
        agree = bool(np.abs(off).max() < WRONG_PX)
        labelled += agree
        wrong_sure += not agree and report.use
        errors += off.ravel().tolist()
    return {"good": good, "labelled": labelled, "wrong_sure": wrong_sure, "errors": errors}


def scene_result(seed: int, number: int) -> dict[str, Any]:
    """One background."""
    rig = field_rig()
    cameras: tuple[Camera, Camera] = (rig.primary, rig.secondary)
    found, truth, seconds = detected(seed, number)
    labelling = labelled(found, cameras)
    states: Counter[str] = Counter()
    remarks, detection_wrong = [], 0
    for which, frame in np.ndindex(2, len(truth)):
        detection = found[which][frame + 1]
        states[detection.state] += 1
        if not right(detection, truth[frame + 1][which]):
            detection_wrong += detection.state == "found"
            remarks.append(f"{frame + 1} {which} {detection.state}: {detection.sentence}")
        elif detection.doubts:
            remarks.append(f"{frame + 1} {which} right, doubtful: {detection.sentence}")
    for report in labelling:
        if not report.use:
            remarks.append(f"frame {report.frame} {report.state}: {report.reason}")
    return {
        "pairs": len(truth),
        "states": dict(states),
        "frames": dict(Counter(report.state for report in labelling)),
        "photograph_wrong_sure": detection_wrong,
        "remarks": remarks,
        "seconds": seconds,
        **judged_labels(labelling, found, truth),
    }


def summary(results: list[dict[str, Any]]) -> None:
    """Print all backgrounds together."""
    states: Counter[str] = Counter()
    frames: Counter[str] = Counter()
    for result in results:
        states.update(result["states"])
        frames.update(result["frames"])
    pairs, good, labelled, photographs, wrong = (
        sum(result[key] for result in results)
        for key in ("pairs", "good", "labelled", "photograph_wrong_sure", "wrong_sure")
    )
    print(f"{pairs} pairs before {len(results)} backgrounds")
    print(f"both targets in both {good}, rightly labelled {labelled}")
    print(f"photographs {dict(states)}, wrong and sure {photographs}")
    print(f"frames {dict(frames)}, wrong and sure {wrong}")
    error = np.concatenate([result["errors"] for result in results])
    print(f"error of a coordinate: RMS {np.sqrt(np.mean(error**2)):.4f} px, median of its size ")
    print(f"{np.median(np.abs(error)):.4f} px, largest {np.abs(error).max():.3f} px")
    seconds = np.concatenate([result["seconds"] for result in results])
    middle, high = np.percentile(seconds, [50, 95])
    print(f"CPU seconds a photograph: median {middle:.3f}, 95 % below {high:.3f}")


def main() -> None:
    """Measure and print."""
    cv2.setNumThreads(1)
    asked = numbers_asked(__doc__, pairs=200, seed=4)
    detect_targets(np.zeros((64, 64), np.uint8))  # compiled before anything is timed
    results = []
    for number in range(asked.pairs // PER_SCENE):
        result = scene_result(asked.seed, number)
        results.append(result)
        print(
            f"background {number}: {result['labelled']} of {result['pairs']} rightly labelled, "
            f"{dict(result['states'])}; load {os.getloadavg()[0]:.1f}",
            *result["remarks"],
            sep="\n    ",
            flush=True,
        )
    summary(results)


if __name__ == "__main__":
    main()
