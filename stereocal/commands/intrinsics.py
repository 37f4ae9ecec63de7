"""`stereocal intrinsics`: lenses from photographs, or a video, of a board."""

import argparse
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, report, say, with_bar
from stereocal.commands.options import BOARD, WORKERS, pattern_of, settings_options, workers_from
from stereocal.commands.photographs import write_recording
from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.frames.proposal import propose
from stereocal.frames.video.extract import with_frames
from stereocal.intrinsics.boards import find_boards
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.files import about
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.photograph_search import PhotographSearch
from stereocal.intrinsics.quality import (
    LENS_COLUMNS,
    advice,
    hint,
    lens_answer,
    lens_rows,
    note_on_model,
)
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.system.atomic_files import write_atomically
from stereocal.system.photograph_files import photographs_of
from stereocal.system.settings import asked
from stereocal.system.taken import when_taken
from stereocal.verdict.in_words import listed

OPTIONS: Options = {
    "images IMAGES...": "photographs, folders, zips; or a video, whose sharpest still frames are "
    "taken",
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
        take = partial(with_frames, parsed.images, Path(store))
        every = photographs_of(in_stages(take), Path(store))
        if missing := [name for name in parsed.leave_out if name not in every]:
            raise StereocalError(
                f"--leave-out: there is no photograph {listed(missing)}; there are "
                f"{listed([*every])}."
            )
        photographs = {name: path for name, path in every.items() if name not in parsed.leave_out}
        proposal = propose(when_taken(photographs))
        if not out.suffix and proposal.pairing.pairs and proposal.way != "order":
            lenses: dict[str, Camera | None] = dict.fromkeys(CAMERAS)
            two = PhotographSearch(proposal.pairing, photographs, lenses, pattern, settings)
            calibrated = in_stages(lambda begin, show: two.run(executor, begin, show, tell=say))
            write_recording(out, replace(calibrated.recording, name=out.stem))
            return
        boards_in = partial(find_boards, photographs, pattern, executor)
        search = with_bar("photographs searched", boards_in)
        lens = with_bar("draws calibrated", partial(calibrate_lens, search, settings, executor))
    of_opencv, camera = out.suffix.lower() in (".yml", ".yaml"), lens.camera
    content = write_opencv_camera(camera) if of_opencv else write_camera(camera, about(lens))
    write_atomically(out, content)
    refused = (f"Not used: {item.name}: {item.reason}." for item in search.refused)
    table = (LENS_COLUMNS, *lens_rows(lens))
    rows = (" ".join(f"{cell:>16}" for cell in row) for row in table)
    notes = (*advice(lens), hint(lens), note_on_model(search, lens.settings))
    report(*refused, lens_answer(lens), *rows, notes=notes, written=[out])
