"""`stereocal intrinsics`: calibrate the lens of a camera from photographs of a board."""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import Executor
from pathlib import Path

from stereocal.commands.boards import lenses_of, search, write_recording
from stereocal.commands.options import BOARD, WORKERS, pattern_of, settings_options, workers_from
from stereocal.commands.parser import Options
from stereocal.commands.progress import ProgressBar, report
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.frames.pairing import pair_names
from stereocal.intrinsics import quality
from stereocal.intrinsics.boards import BoardSearch, find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration, LensSettings, calibrate_lens
from stereocal.intrinsics.files import about
from stereocal.intrinsics.stereo_boards import recording_of
from stereocal.rig.board_pattern import BoardPattern
from stereocal.system.atomic_files import write_atomically
from stereocal.system.described import descriptions
from stereocal.system.photograph_files import Photographs, photographs_in

OPENCV_SUFFIXES = (".yml", ".yaml")


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
    pattern = pattern_of(parsed)
    settings = LensSettings(**{name: getattr(parsed, name) for name in descriptions(LensSettings)})
    with tempfile.TemporaryDirectory() as store, workers_from(parsed) as executor:
        photographs = _photographs(parsed.images, Path(store), parsed.leave_out)
        if not parsed.out.suffix and pair_names(photographs).pairs:
            _both_cameras(parsed.out, photographs, pattern, settings, executor)
            return
        with ProgressBar("photographs searched") as bar:
            search = find_boards(photographs, pattern, executor, bar.show)
        assert search is not None  # nobody cancels here
        with ProgressBar("draws calibrated") as bar:
            lens = calibrate_lens(search, settings, executor, bar.show)
        assert lens is not None
    write_atomically(parsed.out, _file_of(lens, parsed.out))
    _print(search, lens)
    print(f"wrote {parsed.out}")


def _both_cameras(
    folder: Path,
    photographs: Photographs,
    pattern: BoardPattern,
    settings: LensSettings,
    executor: Executor,
) -> None:
    """The lenses of two cameras and, where both see the board, the data set for their pose."""
    boards = search(photographs, pattern, executor)
    first, second = lenses_of(boards, settings, executor)
    recording = recording_of(boards, (first.camera, second.camera), folder.name)
    write_recording(folder, recording)
    print(f"wrote {folder}")


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
    print(quality.lens_answer(lens))
    print(" ".join(f"{title:>16}" for title in quality.LENS_COLUMNS))
    for row in quality.lens_rows(lens):
        print(" ".join(f"{cell:>16}" for cell in row))
    model = quality.note_on_model(search, lens.settings)
    report(notes=filter(None, (*quality.advice(lens), quality.hint(lens), model)))
