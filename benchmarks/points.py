"""Points less exact than the targets: partners found, wrong pairs, and the errors of 3D points.

python -m benchmarks.points [--rigs 8] [--noise 0.05 0.2 0.5 2] [--points 4 40]

Rigs as in `tests.rigs.refined_rigs`, calibrated with 25 bars of 0.02 px. Points everywhere between
4 and 10 m, a tenth missing in each camera; frames until there are some 600 points. The noise is
estimated and the threshold chosen as `match` does; z is the error of a reconstructed right pair
over its stated standard error, by coordinate.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.flock import FlockFrame
from benchmarks.studies import numbers_asked
from stereocal.matching.matching import match_points
from stereocal.matching.reconstruction import midpoints
from stereocal.matching.threshold import ThresholdChoice, choose_threshold
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import place_bars
from stereocal.system.array_types import FloatArray
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.rigs.refined_rigs import DEPTHS_M, Misjudged, random_scene, stated

TARGETS_PX = 0.02
MISSING = 0.1
ROWS = 600
SETS = {"refined": "refined", "2d": "3d"}
"""The set that matches, and the one that measures."""


@dataclass(frozen=True, eq=False)
class PlacedFrame(FlockFrame):
    """A frame with the places of its points."""

    places_m: FloatArray


@dataclass(frozen=True, eq=False)
class Outcome:
    """One rig, noise, and number of points."""

    choice: ThresholdChoice
    found: float
    """Share of the partners that were found."""
    wrong: float
    """Share of wrong pairs among those found."""
    z: FloatArray
    """(n, 3) errors of right pairs over their standard errors."""


def calibrated(seed: int) -> tuple[Rig, Mapping[str, RigParameters]]:
    """A random rig, and the files of its calibration."""
    rng, off = np.random.default_rng([seed, 99]), Misjudged(noise_px=TARGETS_PX)
    scene = random_scene(rng)
    found = PairAnswer(PairRun(stated(scene, rng, off), refined=off.settings()))
    return scene.rig, {str(k): v for k, v in found.sets.items()}


def seen_frames(
    rig: Rig, points: int, frames: int, noise_px: float, rng: np.random.Generator
) -> list[PlacedFrame]:
    """Frames of points in the common view."""
    found = []
    for _ in range(frames):
        places = place_bars(rig, rng, points, 0.1, DEPTHS_M).ends_m[:, 0]
        sides = []
        for camera, at in ((rig.primary, places), (rig.secondary, rig.pose.apply(places))):
            kept = rng.permutation(np.flatnonzero(rng.random(points) >= MISSING))
            pixels = camera.project(at[kept]) + noise_px * rng.standard_normal((len(kept), 2))
            sides.append((pixels.clip(-0.5, np.array(camera.image_size) - 0.5), kept))
        (first, one), (second, two) = sides
        found.append(PlacedFrame(first, second, one, two, places))
    return found


def outcome(
    matching: RigParameters, measuring: RigParameters, frames: list[PlacedFrame]
) -> Outcome:
    """Choose a threshold, match and measure."""
    choice = choose_threshold(matching, [(each.primary_px, each.secondary_px) for each in frames])
    right = total = possible = 0
    z = []
    for frame in frames:
        pairs = match_points(matching, frame.primary_px, frame.secondary_px, choice.threshold_px)
        own, other = frame.primary_of[pairs.primary], frame.secondary_of[pairs.secondary]
        good = own == other
        right, total = right + int(good.sum()), total + len(pairs)
        possible += frame.pairs
        pixels = frame.primary_px[pairs.primary[good]], frame.secondary_px[pairs.secondary[good]]
        assert choice.noise is not None
        found = midpoints(measuring, np.stack(pixels, axis=1), choice.noise.sigma_px)
        points = found.in_frame(None, measuring.volume, with_errors=True)
        assert points.sigma_m is not None
        z.append((points.xyz - frame.places_m[own[good]]) / points.sigma_m)
    return Outcome(choice, right / possible, 1 - right / max(total, 1), np.concatenate(z))


def main() -> None:
    """Print the table."""
    asked = numbers_asked(__doc__, rigs=8, noise=[0.05, 0.2, 0.5, 2.0], points=[4, 40])
    rigs = [calibrated(seed) for seed in range(asked.rigs)]
    print(
        "| points | noise, px | match, measure | estimated | threshold | found | wrong | "
        "wrong, as stated | rms of z: x, y, z |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for points, noise in ((p, n) for p in asked.points for n in asked.noise):
        rng = np.random.default_rng([points, round(1000 * noise)])
        data = [seen_frames(rig, points, ROWS // points, noise, rng) for rig, _ in rigs]
        for matching, measuring in SETS.items():
            found = [
                outcome(sets[matching], sets[measuring], frames)
                for (_, sets), frames in zip(rigs, data, strict=True)
            ]
            print(_row(points, noise, f"{matching}, {measuring}", found), flush=True)


def _row(points: int, noise: float, sets: str, found: list[Outcome]) -> str:
    sigmas = [each.choice.noise.sigma_px for each in found if each.choice.noise is not None]
    thresholds = [each.choice.threshold_px for each in found]
    stated_wrong = [each.choice.shares.wrong for each in found if each.choice.shares is not None]
    z = np.sqrt(np.mean([np.mean(each.z**2, axis=0) for each in found], axis=0))
    return (
        f"| {points} | {noise:g} | {sets} | {np.mean(sigmas):.3g} ({np.std(sigmas):.2g}) | "
        f"{np.mean(thresholds):.3g} | {100 * np.mean([e.found for e in found]):.1f} % (least "
        f"{100 * min(e.found for e in found):.1f}) | {100 * np.mean([e.wrong for e in found]):.2f} "
        f"% | {100 * np.mean(stated_wrong):.2f} % | {', '.join(f'{each:.2f}' for each in z)} |"
    )


if __name__ == "__main__":
    main()
