"""`stereocal intrinsics`, and boards in `stereocal detect`: lenses and poses from a board."""

import argparse
import tempfile
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, report, say, with_bar
from stereocal.commands.options import BOARD, WORKERS, pattern_of, settings_options, workers_from
from stereocal.commands.photographs import pairing_of, take_frames, two_cameras_of
from stereocal.detection.target import Board
from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.formats.recording_files import DESCRIPTION, pack_recording, write_points
from stereocal.frames.pairing import Pairing
from stereocal.frames.proposal import propose
from stereocal.intrinsics.boards import find_boards
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.files import about
from stereocal.intrinsics.held_object import held_object
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.proposed_board import ProposedBoard, proposed_board
from stereocal.intrinsics.quality import (
    LENS_COLUMNS,
    advice,
    hint,
    lens_answer,
    lens_rows,
    note_on_model,
)
from stereocal.intrinsics.stereo_boards import (
    StereoBoards,
    find_stereo_boards,
    lenses_of_boards,
    recording_of,
)
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.atomic_files import write_all, write_atomically
from stereocal.system.photograph_files import (
    Photographs,
    of_the_bar,
    photographs_in,
    photographs_of,
)
from stereocal.system.settings import asked
from stereocal.system.taken import when_taken

OPTIONS: Options = {
    "images IMAGES...": "photographs, folders, zips",
    **BOARD,
    "--out FILE": "camera.json, or .yml for OpenCV; a folder for a data set, from photographs of "
    "two cameras",
    **settings_options(LensSettings),
    "--leave-out NAME...": "photographs not to use",
    **WORKERS,
}
DEFAULTS = {"leave_out": ()}


def run(parsed: argparse.Namespace) -> None:
    """Find the boards, calibrate, write the file, print the table."""
    pattern, out = pattern_of(parsed), parsed.out
    settings = LensSettings(**{name: getattr(parsed, name) for name in asked(LensSettings)})
    with tempfile.TemporaryDirectory() as store, workers_from(parsed) as executor:
        every = photographs_of(parsed.images, Path(store))
        photographs = {name: path for name, path in every.items() if name not in parsed.leave_out}
        proposal = propose(when_taken(photographs))
        if not out.suffix and proposal.pairing.pairs and proposal.way != "order":
            boards = _search(photographs, pattern, proposal.pairing, executor)
            cameras = _lenses_of(boards, settings, executor)
            write_recording(out, _recorded(boards, cameras, out.name))
            return
        boards_in = partial(find_boards, photographs, pattern, executor)
        search = with_bar("photographs searched", boards_in)
        lens = with_bar("draws calibrated", partial(calibrate_lens, search, settings, executor))
    of_opencv, camera = out.suffix.lower() in (".yml", ".yaml"), lens.camera
    content = write_opencv_camera(camera) if of_opencv else write_camera(camera, about(lens))
    write_atomically(out, content)
    refused = (f"Not used: {item.name}: {item.reason}." for item in search.refused)
    table = (LENS_COLUMNS, *lens_rows(lens))
    rows = (" ".join(f"{each:>16}" for each in row) for row in table)
    notes = (*advice(lens), hint(lens), note_on_model(search, lens.settings))
    report(*refused, lens_answer(lens), *rows, notes=notes, written=[out])


def detect_board(parsed: argparse.Namespace, target: Board) -> None:
    """Find the boards of two cameras, write the table, or a whole data set.

    The lenses are those of the data set; without one, they come from the same photographs.
    """
    if parsed.doubtful:
        raise StereocalError("--doubtful is for a bar, not for a board.")
    known = _described(parsed)
    if parsed.videos is not None:
        take_frames(parsed, coloured=False)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as store:
        photographs = of_the_bar(photographs_in(parsed.dataset, Path(store)))
        pairing = pairing_of(photographs, parsed.dataset, parsed.pair_by)
        pattern = target.pattern(target.size or _size_found(photographs, pairing))
        with workers_from(parsed) as executor:
            boards = _search(photographs, pattern, pairing, executor)
            if known is None:
                cameras = _lenses_of(boards, None, executor)
            else:
                first, second = known.cameras.values()
                cameras = first, second
    recording = _recorded(boards, cameras, parsed.dataset.stem)
    if known is not None:
        names = ("name", "cameras", "baselines_m", "baseline_sigma_m", "notes")
        recording = replace(recording, **{name: getattr(known, name) for name in names})
    if parsed.out.suffix.lower() == ".csv":
        write_atomically(parsed.out, write_points(recording))
        report(written=[parsed.out])
    else:
        write_recording(parsed.out, recording)


def write_recording(folder: Path, recording: Recording) -> None:
    """Write a data set into a folder."""
    write_all({folder / name: content for name, content in pack_recording(recording).items()})
    report(written=[folder])


def _recorded(boards: StereoBoards, cameras: tuple[Camera, Camera], name: str) -> Recording:
    """The recording of the boards; says which points a fisheye sees too far out."""
    recording = recording_of(boards, cameras, name)
    if beyond := beyond_in_words(recording.beyond_view):
        say(beyond)
    return recording


def _search(
    photographs: Photographs, pattern: BoardPattern, pairing: Pairing, executor: Executor
) -> StereoBoards:
    search = partial(find_stereo_boards, photographs, pattern, executor, pairing=pairing)
    boards = in_stages(search)
    say(f"{boards.pairing.sentence} {boards.sentence}")
    return boards


def _lenses_of(
    boards: StereoBoards, settings: LensSettings | None, executor: Executor
) -> tuple[Camera, Camera]:
    """The lenses from the same boards; says how good they are, and which model is better.

    Args:
        settings: None: with the better model.
    """
    of_boards = partial(lenses_of_boards, boards, settings, executor)
    first, second = lenses = with_bar("draws calibrated", of_boards)
    for which, lens in zip(CAMERAS, lenses, strict=True):
        note = note_on_model(lens.search, lens.settings)
        say(f"The {which}'s lens: {lens_answer(lens)} {note}".rstrip())
    return first.camera, second.camera


def _described(parsed: argparse.Namespace) -> Recording | None:
    """The cameras of the data set and its baseline; None without a description."""
    if not (parsed.dataset.is_dir() and (parsed.dataset / DESCRIPTION).is_file()):
        return None
    return two_cameras_of(parsed)


def _size_found(photographs: Photographs, pairing: Pairing) -> str:
    """The size of the board that moves before both cameras, or else of the one that most show."""
    names = [[getattr(pair, which) for pair in pairing.pairs] for which in CAMERAS]
    held = held_object([{name: photographs[name] for name in own} for own in names])
    board = held.what if held is not None else None
    if not isinstance(board, ProposedBoard):
        board = proposed_board(photographs)
    if board is None:
        raise StereocalError(
            "The size of the board cannot be found in the first photographs: count the inner "
            "corners, where four squares meet, and state them, as board:9x6:0.03."
        )
    say(f"The board has {board} inner corners, as the first photographs show; else state them.")
    return str(board)
