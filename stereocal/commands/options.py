"""Options that several commands share."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stereocal.calibration.methods import CalibrationSettings
from stereocal.commands.console import Number, Options, report
from stereocal.errors import StereocalError, disk_errors, naming
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.dataset_files import read_recording
from stereocal.formats.exchange.options import QUESTIONS
from stereocal.formats.inputs import read_input
from stereocal.formats.world_file import read_world
from stereocal.rig.camera import CameraName
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.atomic_files import write_all
from stereocal.system.executors import engine
from stereocal.system.limits import Limits
from stereocal.system.settings import Settings, asked
from stereocal.system.tables import LARGEST_WHOLE


def settings_options(kind: type[Settings]) -> Options:
    """An option for each setting, as it describes itself."""
    options: dict[str, Any] = {}
    for name, setting in asked(kind).items():
        usual, arguments = setting.default, dict[str, Any](dest=name, help=setting.help)
        if isinstance(usual, bool):
            arguments["action"] = "store_true"
        elif isinstance(usual, tuple):
            frame = Number(int, -LARGEST_WHOLE, LARGEST_WHOLE)
            arguments |= {"type": frame, "nargs": "+", "default": usual, "metavar": "FRAME"}
        else:
            number = {"type": Number(type(usual), setting.low, setting.high), "metavar": "N"}
            arguments |= {"choices": [*setting.choices]} if setting.choices else number
            arguments["default"] = usual
            arguments["help"] += f" (default: {usual})"
        options[f"--{(setting.option or name).replace('_', '-')}"] = arguments
    return options


def questions(*names: str) -> Options:
    """What files of other programs may not say, as options that `answers` reads."""
    return {
        question.option: {"dest": name, "help": question.help}
        | (
            {"choices": [*question.choices]}
            if question.choices
            else {"type": Number(float, *question.between), "metavar": "N"}
        )
        for name, question in QUESTIONS.items()
        if name in names
    }


MOST_WORKERS = 1000
LARGEST_SIDE_PX = 1_000_000
SEARCH = settings_options(CalibrationSettings)
LENSES_AND_LENGTHS: Options = {
    **questions("lens_model"),
    "--baseline-sigma S": "standard error of the baseline, m",
    "--distance-sigma S": "standard error of the distance between the targets, m",
}
WITH_RIG = "is for two cameras: leave it out with a rig"
PAIR: Options = {"--pair LEFT-RIGHT": "two cameras of a data set with more than two"}
PAIRS: Options = {
    "--pairs": "of every pair also the two sets of the paper, with forecast and threshold"
}
BOARD: Options = {
    "--board 18x12": {"required": True, "help": "inner corners, where four squares meet"},
    "--square M": {"required": True, "help": "side of a square, in metres"},
    "--charuco DICT": "a ChArUco board, such as DICT_4X4_250",
    "--marker M": "side of its markers, in metres",
}
WORLD: Options = {
    "--world FILE": "world.json of the command world, or a 4x4 matrix (JSON or CSV) from the "
    "primary camera's coordinates to yours"
}
WORKERS: Options = {
    "--workers N": {"type": Number(int, 1, MOST_WORKERS), "help": "N processes (default: threads)"},
    "--scheduler ADDRESS": "a Dask cluster: tcp://host:8786",
}


def finish(
    folder: Path, files: Mapping[str, bytes], *lines: str, notes: Iterable[str | None] = ()
) -> None:
    """Write files into a folder, then print what was found, its notes, and the files."""
    placed = {folder / name: content for name, content in files.items()}
    write_all(placed)
    report(*lines, notes=notes, written=placed)


def refuse_given(parsed: argparse.Namespace, why: str, *names: str) -> None:
    """Reject options that have no effect here, rather than ignore them.

    Args:
        why: the rest of the sentence that begins with the option.
        names: of the options, whose default is None or False.
    """
    for name in names:
        if getattr(parsed, name) not in (None, False):
            raise StereocalError(f"--{name.replace('_', '-')} {why}.")


def changed(
    parsed: argparse.Namespace, options: Options, defaults: Mapping[str, Any]
) -> Iterator[str]:
    """The options of a command that were given another value than their default, as written."""
    for text, described in options.items():
        option = text.split()[0]
        arguments = described if isinstance(described, Mapping) else {}
        off, name = option.startswith("--no-"), option.removeprefix("--no-").removeprefix("--")
        name = arguments.get("dest", name.replace("-", "_"))
        value, usual = getattr(parsed, name), arguments.get("default", defaults.get(name, off))
        if option.startswith("--") and value is not off and value not in (usual, None):
            yield option


def answers(parsed: argparse.Namespace) -> dict[str, Any]:
    """The answers to all of `QUESTIONS` that the command asks, by name."""
    return {name: value for name, value in vars(parsed).items() if name in QUESTIONS}


def contents(paths: Sequence[Path]) -> dict[str, bytes]:
    """The contents of files by name; of a second file of a name by its path."""
    limits = Limits.from_environment()
    limits.check_count(len(paths), "The command")
    files: dict[str, bytes] = {}
    for path in paths:
        with disk_errors(f"{path} cannot be read"):
            limits.check_size(path.stat().st_size, str(path))
            content = path.read_bytes()
        name = path.name if path.name not in files else str(path)
        if name in files:
            raise StereocalError(f"{path}: the file is given twice.")
        files[name] = content
    return files


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
    if not (1 <= width <= LARGEST_SIDE_PX and 1 <= height <= LARGEST_SIDE_PX):
        raise StereocalError(f'The image size "{text}" is not possible.')
    return width, height


def two_cameras(text: str) -> tuple[str, str]:
    """The primary and the secondary of `--cameras`."""
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2:
        raise StereocalError(f'--cameras is "{text}"; it must name two, as 1,2.')
    return names[0], names[1]


def pattern_of(parsed: argparse.Namespace) -> BoardPattern:
    """The board of `BOARD`."""
    return BoardPattern.parse(parsed.board, parsed.square, parsed.charuco, parsed.marker)


def world_from(parsed: argparse.Namespace) -> Pose | None:
    """The world frame of `WORLD`; None: the primary's."""
    return None if parsed.world is None else read_world(parsed.world)


@contextmanager
def workers_from(
    parsed: argparse.Namespace, compile_first: Callable[[], object] = lambda: None
) -> Iterator[Executor]:
    """The executor of `WORKERS`.

    Args:
        compile_first: called before worker processes start, to fill the cache of compiled code.
    """
    with engine(parsed.workers, parsed.scheduler) as executor:
        if parsed.workers:
            compile_first()
        yield executor


def with_sigmas(dataset: Pair, parsed: argparse.Namespace) -> Pair:
    """The data set with the standard errors of its lengths from the options."""
    if parsed.baseline_sigma is not None:
        dataset = dataset.changed(baseline_sigma_m=parsed.baseline_sigma)
    if parsed.distance_sigma is not None:
        dataset = dataset.changed(target_distance_sigma_m=parsed.distance_sigma)
    return dataset


def dataset_from(parsed: argparse.Namespace, path: Path) -> Pair:
    """A data set, read as the options say."""
    return pair_from(parsed, path, read_input(path, parsed.lens_model))


def pair_from(parsed: argparse.Namespace, path: Path, recording: Recording) -> Pair:
    """The data set of two cameras of a recording, as the options say."""
    with naming(str(path)):
        dataset = pair_to_calibrate(recording, parsed.pair)
    return with_sigmas(dataset, parsed)


def recording_from(parsed: argparse.Namespace, path: Path) -> Recording:
    """A recording of any number of cameras, read as the options say, and in step."""
    recording = read_recording(path, parsed.lens_model)
    with naming(str(path)):
        return in_step(recording)


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
    """The settings of `SEARCH`, and of the command."""
    stated = {option["dest"]: getattr(parsed, option["dest"]) for option in SEARCH.values()}
    stated |= {"calibration_frames": calibration_frames, "known_points": parsed.known_points}
    stated["time_offset"] = parsed.time_offset or parsed.time_drift
    return CalibrationSettings.from_json(stated)
