"""How well and how fast a flock is matched: `python -m benchmarks.matching [--frames 200]`.

Prints two Markdown tables: recall and precision of the three sets against threshold and number of
points, and CPU time and memory of 200 frames.
"""

import os
import resource
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from benchmarks.flock import FlockFrame, flock, parameter_sets
from benchmarks.studies import numbers_asked
from stereocal.calibration.essential import Solver
from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.evaluation.summary import summarise_all
from stereocal.matching.match_tables import match_tables
from stereocal.matching.matching import ANY_DEPTH, match_points
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.matching.threshold import choose_threshold
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.system.executors import engine

COUNTS = (10, 100, 300, 1000)
THRESHOLDS = (0.3, 1.0, 3.0, 10.0, 40.0)
DEPTHS_M = (12.0, 15.0)
NAMES = {"essential": "essential", "2d": "2D", "3d": "3D"}


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


def file_thresholds(solver: Solver) -> Mapping[str, float]:
    """What `evaluate` writes into the parameter files, from 100 runs on the rig's own data set."""
    settings = EvaluationSettings(CalibrationSettings(essential=solver), 100, 20)
    with engine(None, None) as executor:
        runs = evaluate([simulate_nineteen(0)[9][1]], settings, executor)
    pooled, _ = summarise_all(["flock"], runs)
    return {method: summary.reprojection.threshold for method, summary in pooled.items()}


def quality(solver: Solver, most_frames: int) -> None:
    """The table of recall and precision."""
    rig, sets = parameter_sets(solver)
    thresholds = file_thresholds(solver)
    print(f"\nEssential solver: {solver}\n")
    print("| points | set | " + " | ".join(f"{t:g} px" for t in THRESHOLDS) + " | file | auto |")
    print("|---|---|" + "---|" * (len(THRESHOLDS) + 2))
    for count in COUNTS:
        frames = list(flock(rig, count, min(most_frames, max(20, 20_000 // count)), 0))
        sample = [(frame.primary_px, frame.secondary_px) for frame in frames]
        for name, parameters in sets.items():
            cells = [_cell(score(parameters, frames, t)) for t in THRESHOLDS]
            own = thresholds[name]
            cells.append(f"{_cell(score(parameters, frames, own))} at {own:.2g}")
            try:
                chosen = choose_threshold(parameters, sample[:200]).threshold_px
                cells.append(f"{_cell(score(parameters, frames, chosen))} at {chosen:.2g}")
            except StereocalError:
                cells.append("none")
            print(f"| {count} | {NAMES[name]} | " + " | ".join(cells) + " |", flush=True)


def flags_and_depth(most_frames: int) -> None:
    """The 2D set at auto: with the flag, and with a depth range."""
    rig, sets = parameter_sets("linear")
    print("\n| points | auto, px | recall | precision | flagged | precision of the others |")
    print("|---|---|---|---|---|---|")
    for count in COUNTS:
        frames = list(flock(rig, count, min(most_frames, max(20, 20_000 // count)), 0))
        sample = [(frame.primary_px, frame.secondary_px) for frame in frames[:200]]
        chosen = choose_threshold(sets["2d"], sample).threshold_px
        got = score(sets["2d"], frames, chosen)
        print(
            f"| {count} | {chosen:.2f} | {got.recall:.3f} | {got.precision:.3f} | "
            f"{got.ambiguous:.3f} | {got.precision_of_sure:.3f} |",
            flush=True,
        )
    print("\nA flock between 12 and 15 m, 1,000 points, 2D set, 0.7 px:\n")
    frames = list(flock(rig, 1000, 20, 0, DEPTHS_M))
    for label, depths in (("no depth range", ANY_DEPTH), ("12 to 15 m", DEPTHS_M)):
        got = score(sets["2d"], frames, 0.7, depths)
        print(f"- {label}: recall {got.recall:.3f}, precision {got.precision:.3f}")


def _cell(got: Score) -> str:
    return f"{got.recall:.3f} / {got.precision:.3f}"


def speed(frames: int) -> None:
    """CPU time and memory of `match_tables` on 1,000 points a camera."""
    rig, sets = parameter_sets("linear")
    print("\n| set | threshold | CPU s | wall s | load |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sides: tuple[list[pd.DataFrame], list[pd.DataFrame]] = ([], [])
        for k, frame in enumerate(flock(rig, 1000, frames, 0)):
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


def main() -> None:
    """Print all tables."""
    frames = numbers_asked(__doc__, frames=200).frames
    speed(frames)
    flags_and_depth(frames)
    quality("linear", frames)
    quality("constrained", frames)


if __name__ == "__main__":
    main()
