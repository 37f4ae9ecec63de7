"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.errors import StereocalError, disk_errors
from stereocal.formats.exchange.options import QUESTIONS
from stereocal.formats.world_file import read_world
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import CameraName
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.system.described import descriptions
from stereocal.system.executors import engine
from stereocal.system.limits import Limits


def add_search_options(parser: argparse.ArgumentParser) -> None:
    """The settings of the search and of the calibration."""
    add_settings(parser, SearchSettings, CalibrationSettings)


def add_settings(parser: argparse.ArgumentParser, *kinds: type) -> None:
    """An option for each setting, as it describes itself."""
    for settings in kinds:
        for name, about in descriptions(settings).items():
            option = f"--{(about.option or name).replace('_', '-')}"
            usual, told = about.default, dict[str, Any](dest=name, help=about.help)
            if isinstance(usual, bool):
                parser.add_argument(option, action="store_true", **told)
            elif isinstance(usual, tuple):
                parser.add_argument(
                    option, type=int, nargs="+", default=usual, metavar="FRAME", **told
                )
            else:
                told["help"] += f" (default: {usual})"
                told |= {"choices": about.choices} if about.choices else {"metavar": "N"}
                parser.add_argument(option, type=type(usual), default=usual, **told)


def add_lens_model(parser: argparse.ArgumentParser) -> None:
    """The option of the lens model, and those of the standard errors of the lengths."""
    add_questions(parser, "lens_model")
    for option, what in (
        ("--baseline-sigma", "the baseline"),
        ("--distance-sigma", "the distance between the targets"),
    ):
        parser.add_argument(option, type=float, metavar="S", help=f"standard error of {what}, m")


def add_pair(parser: argparse.ArgumentParser) -> None:
    """The option of the two cameras of a data set that has more."""
    parser.add_argument(
        "--pair", metavar="LEFT-RIGHT", help="two cameras of a data set with more than two"
    )


def add_questions(parser: argparse._ActionsContainer, *names: str) -> None:
    """What files of other programs may not say, as options that `answers` reads."""
    for name in names:
        asked = QUESTIONS[name]
        kind: dict[str, Any] = (
            {"choices": tuple(asked.choices)} if asked.choices else {"type": float, "metavar": "N"}
        )
        parser.add_argument(asked.option, dest=name, help=asked.help, **kind)


def answers(parsed: argparse.Namespace) -> dict[str, Any]:
    """The answers to all of `QUESTIONS` that the command asks, by name."""
    return {name: value for name, value in vars(parsed).items() if name in QUESTIONS}


def contents(paths: Sequence[Path]) -> dict[str, bytes]:
    """The contents of files by name; of a second file of a name by its path."""
    limits = Limits.from_environment()
    limits.check_count(len(paths), "The command")
    found: dict[str, bytes] = {}
    for path in paths:
        with disk_errors(f"{path} cannot be read"):
            limits.check_size(path.stat().st_size, str(path))
            content = path.read_bytes()
        name = path.name if path.name not in found else str(path)
        if name in found:
            raise StereocalError(f"{path}: the file is given twice.")
        found[name] = content
    return found


def image_size(text: str | None) -> tuple[int, int] | None:
    """An image size written as 1280x1024; None if there is none."""
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


def add_board(parser: argparse.ArgumentParser) -> None:
    """The options of a board, which `pattern_of` reads."""
    parser.add_argument(
        "--board", required=True, metavar="18x12", help="inner corners, where four squares meet"
    )
    parser.add_argument(
        "--square", type=float, required=True, metavar="M", help="side of a square, in metres"
    )
    parser.add_argument("--charuco", metavar="DICT", help="a ChArUco board, such as DICT_4X4_250")
    parser.add_argument("--marker", type=float, metavar="M", help="side of its markers, in metres")


def pattern_of(parsed: argparse.Namespace) -> BoardPattern:
    """The board of `add_board`."""
    return BoardPattern.parse(parsed.board, parsed.square, parsed.charuco, parsed.marker)


def add_world(parser: argparse._ActionsContainer) -> None:
    """The option of the world frame of points, which `world_from` reads."""
    parser.add_argument(
        "--world",
        type=Path,
        metavar="FILE",
        help="world.json of the command world, or a 4x4 matrix (JSON or CSV) from the primary "
        "camera's coordinates to yours",
    )


def world_from(parsed: argparse.Namespace) -> Pose | None:
    """The world frame of `add_world`; None: the primary's."""
    return None if parsed.world is None else read_world(parsed.world)


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
    """
    with engine(parsed.workers, parsed.scheduler) as executor:
        if parsed.workers and compile_first is not None:
            compile_first()
        yield executor


def with_sigmas(dataset: Dataset, parsed: argparse.Namespace) -> Dataset:
    """The data set with the standard errors of its lengths from the options."""
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
    described = (*descriptions(SearchSettings), *descriptions(CalibrationSettings))
    return CalibrationSettings.from_json(
        {
            **{name: getattr(parsed, name) for name in described},
            "calibration_frames": calibration_frames,
            "known_points": parsed.known_points,
            "time_offset": parsed.time_offset or parsed.time_drift,
        }
    )
