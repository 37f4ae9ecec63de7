"""A board in the photographs of two cameras, for `stereocal detect` and `stereocal intrinsics`."""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from stereocal.commands.options import workers_from
from stereocal.commands.progress import Stages, say
from stereocal.detection.target import Board
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_cameras
from stereocal.formats.description import DESCRIPTION
from stereocal.formats.recording_files import pack_recording, write_points
from stereocal.intrinsics.calibrate_lens import LensCalibration, LensSettings
from stereocal.intrinsics.proposed_board import proposed_board
from stereocal.intrinsics.quality import lens_answer
from stereocal.intrinsics.stereo_boards import (
    StereoBoards,
    find_stereo_boards,
    lenses_of_boards,
    recording_of,
)
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import CAMERAS
from stereocal.rig.recording import Recording
from stereocal.system.atomic_files import write_all, write_atomically
from stereocal.system.photograph_files import Photographs, of_the_bar, photographs_in


def detect_board(parsed: argparse.Namespace, target: Board) -> None:
    """Find the boards, write the table, or a whole data set.

    The lenses are those of the data set; without one, they come from the same photographs.
    """
    if parsed.videos is not None or parsed.doubtful:
        raise StereocalError("--videos and --doubtful are for a bar, not for a board.")
    table = parsed.out.suffix.lower() == ".csv"
    known = _described(parsed)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as store:
        photographs = of_the_bar(photographs_in(parsed.dataset, Path(store)))
        pattern = target.pattern(target.size or _size_found(photographs))
        with workers_from(parsed) as executor:
            boards = search(photographs, pattern, executor)
            if known is None:
                lenses = lenses_of(boards, LensSettings(), executor)
                cameras = lenses[0].camera, lenses[1].camera
            else:
                first, second = known.cameras.values()
                cameras = first, second
    recording = recording_of(boards, cameras, parsed.dataset.stem)
    if known is not None:
        names = ("name", "baselines_m", "baseline_sigma_m", "notes")
        recording = replace(recording, **{name: getattr(known, name) for name in names})
        recording = replace(recording, cameras=known.cameras)
    if table:
        write_atomically(parsed.out, write_points(recording))
    else:
        write_recording(parsed.out, recording)
    print(f"wrote {parsed.out}")


def search(photographs: Photographs, pattern: BoardPattern, executor: Executor) -> StereoBoards:
    """The boards of both cameras, with progress; says what was found."""
    with Stages() as stages:
        boards = find_stereo_boards(photographs, pattern, executor, stages.begin, stages.show)
    assert boards is not None  # nobody cancels here
    say(f"{boards.pairing.sentence} {boards.sentence}")
    return boards


def lenses_of(
    boards: StereoBoards, settings: LensSettings, executor: Executor
) -> tuple[LensCalibration, LensCalibration]:
    """The lenses from the same boards, with progress; says how good they are."""
    with Stages() as stages:
        stages.begin("draws calibrated")
        lenses = lenses_of_boards(boards, settings, executor, stages.show)
    assert lenses is not None  # nobody cancels here
    for which, lens in zip(CAMERAS, lenses, strict=True):
        say(f"The {which}'s lens: {lens_answer(lens)}")
    return lenses


def write_recording(folder: Path, recording: Recording) -> None:
    """Write a data set into a folder."""
    files = pack_recording(recording)
    write_all({folder / name: content for name, content in files.items()})


def _described(parsed: argparse.Namespace) -> Recording | None:
    """The cameras of the data set and its baseline; None without a description."""
    if not (parsed.dataset.is_dir() and (parsed.dataset / DESCRIPTION).is_file()):
        return None
    known = read_cameras(parsed.dataset, parsed.lens_model)
    if len(known.cameras) > 2:
        raise StereocalError(
            f"{parsed.dataset}: it has {len(known.cameras)} cameras; boards are found in the "
            "photographs of two."
        )
    return known


def _size_found(photographs: Photographs) -> str:
    board = proposed_board(photographs)
    if board is None:
        raise StereocalError(
            "The size of the board cannot be found in the first photographs: count the inner "
            "corners, where four squares meet, and state them, as board:9x6:0.03."
        )
    say(f"The board has {board} inner corners, as the first photographs show; else state them.")
    return str(board)
