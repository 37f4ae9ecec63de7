"""`stereocal intrinsics`: calibrate the lens of a camera from photographs of a board."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from stereocal.commands.options import add_workers, workers_from
from stereocal.commands.progress import ProgressBar
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.intrinsics.board_pattern import BoardPattern
from stereocal.intrinsics.boards import BoardSearch, find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration, LensSettings, calibrate_lens
from stereocal.intrinsics.files import about
from stereocal.intrinsics.quality import advice, hint
from stereocal.intrinsics.tables import LENS_COLUMNS, lens_answer, lens_rows
from stereocal.system.atomic_files import write_atomically
from stereocal.system.photograph_files import Photographs, photographs_in

OPENCV_SUFFIXES = (".yml", ".yaml")


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The options of the command."""
    command = commands.add_parser("intrinsics", help="the lens, from photographs of a board")
    command.set_defaults(run=run)
    command.add_argument(
        "images", type=Path, nargs="+", metavar="IMAGES", help="photographs, folders, zips"
    )
    command.add_argument(
        "--board", required=True, metavar="18x12", help="inner corners, where four squares meet"
    )
    command.add_argument(
        "--square", type=float, required=True, metavar="M", help="side of a square, in metres"
    )
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="camera.json, or .yml for OpenCV"
    )
    paper = LensSettings()
    for option, default, text in (
        ("--subset", paper.subset, "photographs of each draw; of no more, two thirds"),
        ("--repeats", paper.repeats, "draws"),
        ("--seed", paper.seed, "source of the random numbers"),
    ):
        command.add_argument(
            option, type=int, default=default, metavar="N", help=f"{text} (default: {default})"
        )
    command.add_argument("--fix-k3", action="store_true", help="hold k3 at 0")
    command.add_argument("--zero-tangential", action="store_true", help="hold p1 and p2 at 0")
    command.add_argument("--charuco", metavar="DICT", help="a ChArUco board, such as DICT_4X4_250")
    command.add_argument("--marker", type=float, metavar="M", help="side of its markers, in metres")
    command.add_argument(
        "--leave-out", nargs="+", default=[], metavar="NAME", help="photographs not to use"
    )
    add_workers(command)


def run(parsed: argparse.Namespace) -> None:
    """Find the boards, calibrate, write the file, print the table."""
    pattern = BoardPattern.parse(parsed.board, parsed.square, parsed.charuco, parsed.marker)
    settings = LensSettings(
        parsed.subset, parsed.repeats, parsed.seed, parsed.fix_k3, parsed.zero_tangential
    )
    with tempfile.TemporaryDirectory() as store, workers_from(parsed) as executor:
        photographs = _photographs(parsed.images, Path(store), parsed.leave_out)
        with ProgressBar("photographs searched") as bar:
            search = find_boards(photographs, pattern, executor, bar.show)
        assert search is not None  # nobody cancels here
        with ProgressBar("draws calibrated") as bar:
            lens = calibrate_lens(search, settings, executor, bar.show)
        assert lens is not None
    write_atomically(parsed.out, _file_of(lens, parsed.out))
    _print(search, lens)
    print(f"wrote {parsed.out}")


def _photographs(sources: list[Path], store: Path, leave_out: list[str]) -> Photographs:
    found: dict[str, Path] = {}
    for source in sources:
        if source.is_file() and source.suffix.lower() != ".zip":
            own = {source.name: source}
        else:
            own = photographs_in(source, store)
        for name, path in own.items():
            found[name if name not in found else str(source / name)] = path
    return {name: path for name, path in found.items() if name not in leave_out}


def _file_of(lens: LensCalibration, path: Path) -> bytes:
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return write_opencv_camera(lens.camera)
    return write_camera(lens.camera, about(lens))


def _print(search: BoardSearch, lens: LensCalibration) -> None:
    for item in search.refused:
        print(f"Not used: {item.name}: {item.reason}.")
    print(lens_answer(lens))
    print(" ".join(f"{title:>16}" for title in LENS_COLUMNS))
    for row in lens_rows(lens):
        print(" ".join(f"{cell:>16}" for cell in row))
    for sentence in filter(None, (*advice(lens), hint(lens))):
        print(f"Note: {sentence}")
