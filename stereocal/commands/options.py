"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.errors import StereocalError
from stereocal.formats.lens_model import LENS_MODELS
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import CameraName
from stereocal.rig.dataset import Dataset
from stereocal.system.executors import engine


def add_search_options(parser: argparse.ArgumentParser) -> None:
    """The settings of the search and of the essential method, as options."""
    paper = SearchSettings()
    for option, kind, default, text in (
        ("--seed", int, paper.seed, "source of the random numbers"),
        ("--delta", float, paper.delta, "first step of an angle, rad"),
        ("--delta-min", float, paper.delta_min, "the search ends below this step, rad"),
        ("--acceptance", float, paper.acceptance, "the step shrinks below this acceptance ratio"),
        ("--shrink", float, paper.shrink, "factor of a shrinking step"),
        ("--minimum-moves", int, paper.minimum_moves, "moves before the ratio is tested"),
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
    parser.add_argument(
        "--all-frames",
        action="store_true",
        help="use every frame, as the paper does, even those that contradict the others",
    )
    parser.add_argument(
        "--put-back",
        type=int,
        nargs="+",
        default=[],
        metavar="FRAME",
        help="frames to keep though they contradict the others",
    )
    parser.add_argument(
        "--leave-out",
        type=int,
        nargs="+",
        default=[],
        metavar="FRAME",
        help="frames to leave out, whatever the screening finds",
    )
    add_time_offset(parser)


def add_time_offset(parser: argparse.ArgumentParser) -> None:
    """The options of the time offset between the cameras."""
    parser.add_argument(
        "--time-offset",
        action="store_true",
        help="find the time offset between the cameras, and shift the secondary points by it",
    )
    parser.add_argument(
        "--time-drift",
        action="store_true",
        help="the same, and find how the offset drifts (frames per frame)",
    )


def add_lens_model(parser: argparse.ArgumentParser) -> None:
    """The option of the lens model, and those of the standard errors of the lengths."""
    parser.add_argument(
        "--lens-model",
        choices=LENS_MODELS,
        help="the model of four distortion coefficients, if the file does not state it: brown is "
        "OpenCV's usual k1 k2 p1 p2",
    )
    for option, what in (
        ("--baseline-sigma", "the baseline"),
        ("--distance-sigma", "the distance between the targets"),
    ):
        parser.add_argument(option, type=float, metavar="S", help=f"standard error of {what}, m")


def image_size(text: str | None) -> tuple[int, int] | None:
    """An image size written as 1280x1024; None if there is none.

    Raises:
        StereocalError: the text is no such size.
    """
    if text is None:
        return None
    try:
        width, height = (int(side) for side in text.lower().split("x"))
    except ValueError:
        raise StereocalError(
            f'The image size "{text}" is not width x height, as 1280x1024.'
        ) from None
    if width < 1 or height < 1:
        raise StereocalError(f'The image size "{text}" is not possible.')
    return width, height


def add_workers(parser: argparse.ArgumentParser) -> None:
    """The options of a long command's executor."""
    parser.add_argument("--workers", type=int, metavar="N", help="N processes (default: threads)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster: tcp://host:8786")


@contextmanager
def workers_from(
    parsed: argparse.Namespace, compile_first: Callable[[], object] | None = None
) -> Iterator[Executor]:
    """The executor of `add_workers`.

    Args:
        compile_first: called before worker processes start, to fill the cache of compiled code.

    Raises:
        StereocalError: both options, fewer than 1 worker, or a cluster that cannot be used.
    """
    with engine(parsed.workers, parsed.scheduler) as executor:
        if parsed.workers and compile_first is not None:
            compile_first()
        yield executor


def with_sigmas(dataset: Dataset, parsed: argparse.Namespace) -> Dataset:
    """The data set with the standard errors of its lengths from the options.

    Raises:
        StereocalError: one that is not above 0.
    """
    stated = {
        name: value
        for name, value in (
            ("baseline_sigma_m", parsed.baseline_sigma),
            ("target_distance_sigma_m", parsed.distance_sigma),
        )
        if value is not None
    }
    return replace(dataset, **stated) if stated else dataset


def refine_settings_from(
    parsed: argparse.Namespace, free_distortion: tuple[CameraName, ...] = ()
) -> RefineSettings:
    """The settings of the refined method, of the command."""
    return RefineSettings(
        free_distortion=free_distortion,
        time_offset=parsed.time_offset or parsed.time_drift,
        time_drift=parsed.time_drift,
    )


def settings_from(
    parsed: argparse.Namespace, calibration_frames: int | None
) -> CalibrationSettings:
    """The settings of `add_search_options`, and of the command."""
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
        all_frames=parsed.all_frames,
        frames_put_back=tuple(sorted(parsed.put_back)),
        frames_left_out=tuple(sorted(parsed.leave_out)),
        time_offset=parsed.time_offset or parsed.time_drift,
        time_drift=parsed.time_drift,
    )
