"""`stereocal calibrate`: the two parameter files of a data set."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Literal

from stereocal.calibrate import METHODS, Calibration, calibrate
from stereocal.commands.options import add_search_options, settings_from
from stereocal.evaluation_files import validation_in_summary
from stereocal.formats.dataset_files import read_dataset
from stereocal.writing import write_all

FILES: dict[Literal["2d", "3d"], str] = {"2d": "parameters_2d.json", "3d": "parameters_3d.json"}


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The options of the command."""
    command = commands.add_parser("calibrate", help="the two parameter files of a data set")
    command.set_defaults(run=run)
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


def run(parsed: argparse.Namespace) -> None:
    """Calibrate, write the files, print the table."""
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
