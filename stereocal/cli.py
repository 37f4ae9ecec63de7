"""`python -m stereocal`: the calibrations from the command line."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from stereocal import __version__
from stereocal.calibrate import METHODS, Calibration, CalibrationSettings, calibrate
from stereocal.engines import engine
from stereocal.errors import StereocalError
from stereocal.evaluation import EvaluationSettings, evaluate
from stereocal.evaluation_files import (
    summary_json,
    unique_names,
    validation_in_summary,
)
from stereocal.formats.dataset_files import read_dataset
from stereocal.montecarlo import SearchSettings
from stereocal.nineteen import write_nineteen
from stereocal.report import report_html
from stereocal.simulate import write_field
from stereocal.summary import summarise_all
from stereocal.tables import validation_answer
from stereocal.writing import write_all

FILES: dict[Literal["2d", "3d"], str] = {"2d": "parameters_2d.json", "3d": "parameters_3d.json"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it is done, 2 with one sentence on stderr for bad input."""
    parsed = _parser().parse_args(arguments)
    try:
        commands = {"calibrate": _calibrate, "evaluate": _evaluate, "simulate": _simulate}
        commands[parsed.command](parsed)
    except StereocalError as error:
        print(f"stereocal: {error}", file=sys.stderr)
        return 2
    return 0


def add_search_options(parser: argparse.ArgumentParser) -> None:
    """The settings of the search and of the essential method, as options."""
    paper = SearchSettings()
    for option, kind, default, text in (
        ("--seed", int, paper.seed, "source of the random numbers"),
        ("--delta", float, paper.delta, "first step of an angle, rad"),
        ("--delta-min", float, paper.delta_min, "the search ends below this step, rad"),
        ("--acceptance", float, paper.acceptance, "the step shrinks below this acceptance ratio"),
        ("--shrink", float, paper.shrink, "factor of a shrinking step"),
        ("--minimum-moves", int, paper.minimum_moves, "moves before the ratio is looked at"),
    ):
        parser.add_argument(
            option, type=kind, default=default, metavar="N", help=f"{text} (default: {default:g})"
        )
    parser.add_argument(
        "--essential",
        choices=("constrained", "linear"),
        default="constrained",
        help="solver of the essential method (default: constrained)",
    )


def settings_from(
    parsed: argparse.Namespace, calibration_frames: int | None
) -> CalibrationSettings:
    """The settings of `add_search_options`, with the further ones."""
    return CalibrationSettings(
        search=SearchSettings(
            delta=parsed.delta,
            delta_min=parsed.delta_min,
            acceptance=parsed.acceptance,
            shrink=parsed.shrink,
            minimum_moves=parsed.minimum_moves,
            seed=parsed.seed,
        ),
        essential=parsed.essential,
        calibration_frames=calibration_frames,
        known_points=parsed.known_points,
    )


def table_of(calibration: Calibration) -> str:
    """The results of the methods, a line each."""
    lines = [
        f"{'method':<10} {'reprojection px':>15} {'length mean %':>14} {'length 95 %':>12} "
        f"{'evaluations':>12} {'seconds':>8}  stopped because"
    ]
    for name in METHODS:
        found, errors = calibration.methods[name], calibration.errors[name]
        lines.append(
            f"{name:<10} {errors.mean_reprojection_px:>15.4f} "
            f"{_percent(errors.mean_length):>14} {_percent(errors.p95_length):>12} "
            f"{found.evaluations:>12} {found.seconds:>8.3f}  {found.stop_reason}"
        )
    return "\n".join(lines)


def _percent(fraction: float) -> str:
    return "none" if math.isnan(fraction) else f"{100 * fraction:.4f}"


def _calibrate(parsed: argparse.Namespace) -> None:
    dataset = read_dataset(parsed.dataset)
    calibration = calibrate(dataset, settings_from(parsed, parsed.calibration_frames))
    figures = validation_in_summary(parsed.validation, dataset) if parsed.validation else {}
    files = {
        parsed.out / FILES[method]: calibration.parameters(method, figures.get(method))
        .dumps()
        .encode()
        for method in FILES
    }
    write_all(files)
    rows = dataset.correspondences
    print(
        f"{dataset.name}: {len(rows)} pairs, {len(rows.bars)} bars in {len(rows.frames)} frames; "
        f"calibrated with {len(calibration.frames)} frames; errors are of all frames."
    )
    print(table_of(calibration))
    for warning in calibration.warnings:
        print(f"Note: {warning}")
    for path in files:
        print(f"wrote {path}")


def _evaluate(parsed: argparse.Namespace) -> None:
    datasets = [read_dataset(path) for path in parsed.datasets]
    settings = EvaluationSettings(
        settings_from(parsed, calibration_frames=None), parsed.runs, parsed.calibration_frames
    )
    with engine(parsed.workers, parsed.scheduler) as executor:
        runs = evaluate(datasets, settings, executor, ProgressBar("runs").show)
    assert runs is not None  # nobody cancels here
    pooled, by_dataset = summarise_all(unique_names(datasets), runs)
    write_all(
        {
            parsed.out / "summary.json": summary_json(pooled, by_dataset, datasets, settings),
            parsed.out / "report.html": report_html(
                pooled, by_dataset, datasets, settings
            ).encode(),
        }
    )
    print(validation_answer(pooled))
    for path in (parsed.out / "summary.json", parsed.out / "report.html"):
        print(f"wrote {path}")


class ProgressBar:
    """A line on stderr that fills, with the time that is left."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()

    def show(self, done: int, total: int) -> None:
        """Draw the line; the last call ends it."""
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        filled = 30 * done // total
        line = (
            f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}, {left:.0f} s left"
        )
        print(f"\r{line:<70}", end="\n" if done == total else "", file=sys.stderr, flush=True)


def _simulate(parsed: argparse.Namespace) -> None:
    for name in ("seed", "datasets", "frames"):
        lowest = 0 if name == "seed" else 1
        if getattr(parsed, name) < lowest:
            raise StereocalError(f"--{name} must be at least {lowest}.")
    write_field(parsed.out / "field", parsed.seed)
    print(f"wrote {parsed.out / 'field'}")
    write_nineteen(parsed.out / "nineteen", parsed.seed, parsed.datasets, parsed.frames)
    print(f"wrote {parsed.out / 'nineteen'}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="stereocal", description=__doc__)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    command = commands.add_parser("calibrate", help="the two parameter files of a data set")
    command.add_argument("dataset", type=Path, help="folder or zip with dataset.json")
    command.add_argument("--out", type=Path, required=True, help="folder for the two files")
    add_search_options(command)
    command.add_argument(
        "--calibration-frames",
        type=int,
        metavar="K",
        help="calibrate with K frames drawn at random, test with the others (default: all)",
    )
    command.add_argument(
        "--known-points",
        action="store_true",
        help="3D cost: known points (columns x_m, y_m, z_m) instead of distances",
    )

    command.add_argument(
        "--validation",
        type=Path,
        metavar="SUMMARY.JSON",
        help="summary.json of evaluate: its figures and threshold go into the files",
    )

    command = commands.add_parser("evaluate", help="FCP and 3D error over random splits")
    command.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="folders, zips")
    command.add_argument("--out", type=Path, required=True, help="folder for the two files")
    add_search_options(command)
    command.add_argument("--runs", type=int, default=100, metavar="N", help="default: 100")
    command.add_argument(
        "--calibration-frames", type=int, default=20, metavar="K", help="of each run (default: 20)"
    )
    command.add_argument("--known-points", action="store_true", help="as for calibrate")
    command.add_argument("--workers", type=int, metavar="N", help="N processes (default: threads)")
    command.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster: tcp://host:8786")

    command = commands.add_parser("simulate", help="the synthetic sample data")
    command.add_argument("--datasets", type=int, default=19, metavar="N", help="default: 19")
    command.add_argument("--frames", type=int, default=25, metavar="N", help="default: 25")
    command.add_argument("--out", type=Path, required=True, help="folder for the data sets")
    command.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")
    return parser
