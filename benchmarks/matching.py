"""How well and how fast points are matched: simulated flocks, whose partners are known.

    python -m benchmarks.matching [speed|flags|quality|points] [--frames 200] [--rigs 8]
        [--noise 0.05 0.2 0.5 2] [--counts 4 40]

- speed: CPU time and memory of 200 frames of 1,000 points a camera;
- flags: the 2D set at the automatic threshold, with the flag, and with a depth range;
- quality: recall and precision of three sets against threshold and number of points, with both
  essential solvers; one rig of the nineteen, noise of 0.3 px;
- points: points less exact than the targets, rigs calibrated with 25 bars of 0.02 px
  (`refined_rigs`): 600 points between 4 and 10 m, a tenth missing in each camera. The noise is
  estimated and the threshold chosen as `match` does; z is the error of a reconstructed right pair
  over its stated standard error, by coordinate.
"""

import os
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.studies import Asked, run_studies
from stereocal.calibration.essential import Solver
from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.library.calibrations import calibrate
from stereocal.matching.match_tables import match_tables
from stereocal.matching.matching import ANY_DEPTH, match_points
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction import midpoints
from stereocal.matching.settled import Stated
from stereocal.matching.threshold import ThresholdChoice, choose_threshold
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.simulation.simulate import FIELD_DEPTHS_M, place_bars
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.rigs.refined_rigs import DEPTHS_M as POINT_DEPTHS_M
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

COUNTS = (10, 100, 300, 1000)
THRESHOLDS = (1.0, 10.0, 40.0)
DEPTHS_M = (12.0, 15.0)
NAMES = {"essential": "essential", "2d": "2D", "3d": "3D"}
NOISE_PX, MISSING, SPURIOUS = 0.3, 0.10, 0.05
TARGETS_PX, ROWS = 0.02, 600
SETS = {"refined": "refined", "2d": "3d"}
"""The set that matches, and the one that measures."""


@dataclass(frozen=True, eq=False)
class FlockFrame:
    """What both cameras see in one frame, shuffled."""

    primary_px: FloatArray
    secondary_px: FloatArray
    primary_of: IntArray
    """Which bird each point is; -1 for a spurious one."""
    secondary_of: IntArray

    places_m: FloatArray
    """Of each bird."""

    @property
    def pairs(self) -> int:
        """How many birds both cameras see."""
        return len(np.intersect1d(self.primary_of, self.secondary_of)) - int(
            (self.primary_of < 0).any() and (self.secondary_of < 0).any()
        )


def flock(
    rig: Rig,
    points: int,
    frames: int,
    rng: np.random.Generator,
    depths_m: tuple[float, float] = FIELD_DEPTHS_M,
    noise_px: float = NOISE_PX,
    spurious: float = SPURIOUS,
) -> Iterator[FlockFrame]:
    """Frames with about `points` points a camera, everywhere in the common view."""
    birds = round(points * (1 - spurious) / (1 - MISSING)) if spurious else points
    for _ in range(frames):
        places = place_bars(rig, rng, birds, 0.1, depths_m).ends_m[:, 0]
        sides = []
        for camera, seen in ((rig.primary, places), (rig.secondary, rig.pose.apply(places))):
            size = np.array(camera.image_size)
            kept = np.flatnonzero(rng.random(birds) >= MISSING)
            pixels = camera.project(seen[kept]) + noise_px * rng.standard_normal((len(kept), 2))
            wrong = rng.uniform(-0.5, size - 0.5, (round(points * spurious), 2))
            order = rng.permutation(len(kept) + len(wrong))
            names = np.concatenate([kept, np.full(len(wrong), -1)])
            both = np.concatenate([pixels.clip(-0.5, size - 0.5), wrong])
            sides.append((both[order], names[order]))
        yield FlockFrame(sides[0][0], sides[1][0], sides[0][1], sides[1][1], places)


def parameter_sets(solver: Solver) -> tuple[Rig, Mapping[str, RigParameters]]:
    """One rig of the nineteen (lenses misjudged by 0.1 to 0.3 %, 3 to 5 px) and its sets.

    The essential pose is put into a 2D file, for it has no file of its own.
    """
    scene, dataset = simulate_nineteen(0)[9]
    calibration = calibrate(dataset, CalibrationSettings(essential=solver))
    matching, measuring = calibration.parameters("2d"), calibration.parameters("3d")
    essential = replace(matching, pose=calibration.methods["essential"].pose)
    return scene.rig, {"essential": essential, "2d": matching, "3d": measuring}


@dataclass(frozen=True)
class Score:
    """Recall and precision, and the part of the pairs that is flagged as ambiguous."""

    recall: float
    precision: float
    ambiguous: float
    precision_of_sure: float


def score(
    rig: RigParameters,
    frames: Sequence[FlockFrame],
    threshold: float,
    depths_m: tuple[float, float] = ANY_DEPTH,
) -> Score:
    """Match all frames and count the right pairs."""
    right = found = possible = unsure = sure_right = 0
    for frame in frames:
        pairs = match_points(rig, frame.primary_px, frame.secondary_px, threshold, depths_m)
        first, second = frame.primary_of[pairs.primary], frame.secondary_of[pairs.secondary]
        good = (first == second) & (first >= 0)
        right += int(good.sum())
        found += len(pairs)
        possible += frame.pairs
        unsure += int(pairs.ambiguous.sum())
        sure_right += int((good & ~pairs.ambiguous).sum())
    sure = max(found - unsure, 1)
    return Score(right / possible, right / max(found, 1), unsure / max(found, 1), sure_right / sure)


def flocks(rig: Rig, count: int, most: int, least: int = 20) -> list[FlockFrame]:
    """As many frames as have 20,000 points."""
    frames = min(most, max(least, 20_000 // count))
    return list(flock(rig, count, frames, np.random.default_rng([0, count])))


def quality(asked: Asked) -> None:
    """The tables of recall and precision."""
    quality_of("linear", asked.frames)
    quality_of("constrained", asked.frames)


def quality_of(solver: Solver, most_frames: int) -> None:
    """The table of one essential solver."""
    rig, sets = parameter_sets(solver)
    print(f"\nEssential solver: {solver}\n")
    print("| points | set | " + " | ".join(f"{t:g} px" for t in THRESHOLDS) + " | auto |")
    print("|---|---|" + "---|" * (len(THRESHOLDS) + 1))
    for count in COUNTS:
        frames = flocks(rig, count, most_frames)
        sample = [(frame.primary_px, frame.secondary_px) for frame in frames]
        for name, parameters in sets.items():
            cells = [_cell(score(parameters, frames, t)) for t in THRESHOLDS]
            try:
                chosen = choose_threshold(parameters, sample[:200]).threshold_px
                cells.append(f"{_cell(score(parameters, frames, chosen))} at {chosen:.2g}")
            except StereocalError:
                cells.append("none")
            print(f"| {count} | {NAMES[name]} | " + " | ".join(cells) + " |", flush=True)


def flags_and_depth(asked: Asked) -> None:
    """The 2D set at auto: with the flag, and with a depth range."""
    rig, sets = parameter_sets("linear")
    print("\n| points | auto, px | recall | precision | flagged | precision of the others |")
    print("|---|---|---|---|---|---|")
    for count in COUNTS:
        frames = flocks(rig, count, asked.frames)
        sample = [(frame.primary_px, frame.secondary_px) for frame in frames[:200]]
        chosen = choose_threshold(sets["2d"], sample).threshold_px
        got = score(sets["2d"], frames, chosen)
        print(
            f"| {count} | {chosen:.2f} | {got.recall:.3f} | {got.precision:.3f} | "
            f"{got.ambiguous:.3f} | {got.precision_of_sure:.3f} |",
            flush=True,
        )
    print("\nA flock between 12 and 15 m, 1,000 points, 2D set, 0.7 px:\n")
    frames = list(flock(rig, 1000, 20, np.random.default_rng([0, 1000]), DEPTHS_M))
    for label, depths in (("no depth range", ANY_DEPTH), ("12 to 15 m", DEPTHS_M)):
        got = score(sets["2d"], frames, 0.7, depths)
        print(f"- {label}: recall {got.recall:.3f}, precision {got.precision:.3f}")


def _cell(got: Score) -> str:
    return f"{got.recall:.3f} / {got.precision:.3f}"


def speed(asked: Asked) -> None:
    """CPU time and memory of `match_tables` on 1,000 points a camera."""
    rig, sets = parameter_sets("linear")
    print("\n| set | threshold | CPU s | wall s | load |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sides: tuple[list[pd.DataFrame], list[pd.DataFrame]] = ([], [])
        for k, frame in enumerate(flocks(rig, 1000, asked.frames, asked.frames)):
            for side, px in zip(sides, (frame.primary_px, frame.secondary_px), strict=True):
                side.append(pd.DataFrame({"frame": k, "u": px[:, 0], "v": px[:, 1]}))
        for side, which in zip(sides, "ps", strict=True):
            pd.concat(side).to_csv(folder / f"{which}.csv", index=False)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for method, threshold in (("2d", 0.7), ("2d", 10.0), ("3d", 40.0)):
            tables: dict[str, PointTable] = {
                which: PointTable(folder / f"{which[0]}.csv") for which in CAMERAS
            }
            cpu, wall = time.process_time(), time.monotonic()
            match_tables(sets[method], tables, folder / "o.csv", Stated(threshold))
            cpu, wall = time.process_time() - cpu, time.monotonic() - wall
            load = os.getloadavg()[0]
            print(f"| {NAMES[method]} | {threshold:g} px | {cpu:.1f} | {wall:.1f} | {load:.1f} |")
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        more = (after - before) / 1e3
        print(f"\nMemory of the process: {after / 1e3:.0f} MB, {more:.0f} MB of it from matching.")


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


def outcome(matching: RigParameters, measuring: RigParameters, frames: list[FlockFrame]) -> Outcome:
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


def points(asked: Asked) -> None:
    """The table of points less exact than the targets."""
    rigs = [calibrated(seed) for seed in asked.numbers]
    print(
        "| points | noise, px | match, measure | estimated | threshold | found | wrong | "
        "wrong, as stated | rms of z: x, y, z |\n|---|---|---|---|---|---|---|---|---|"
    )
    for count, noise in ((p, n) for p in asked.counts for n in asked.noise):
        rng = np.random.default_rng([count, round(1000 * noise)])
        about = ROWS // count, rng, POINT_DEPTHS_M, noise, 0.0
        data = [list(flock(rig, count, *about)) for rig, _ in rigs]
        for matching, measuring in SETS.items():
            found = [
                outcome(sets[matching], sets[measuring], frames)
                for (_, sets), frames in zip(rigs, data, strict=True)
            ]
            print(_row(count, noise, f"{matching}, {measuring}", found), flush=True)


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


STUDIES = {
    "speed": (speed, 1),
    "flags": (flags_and_depth, 1),
    "quality": (quality, 1),
    "points": (points, 8),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__, frames=200, noise=[0.05, 0.2, 0.5, 2.0], counts=[4, 40])
