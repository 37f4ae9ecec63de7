"""`stereocal intrinsics`: lenses from photographs, or a video, of a board."""

import argparse
import tempfile
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, report, say, with_bar
from stereocal.commands.options import BOARD, WORKERS, pattern_of, settings_options, workers_from
from stereocal.commands.photographs import SPLIT, write_recording
from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.frames.proposal import propose
from stereocal.frames.several_cameras import cameras_told
from stereocal.frames.video.extract import with_frames
from stereocal.frames.which_camera import Series
from stereocal.intrinsics.boards import find_boards
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.files import about
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.photograph_search import PhotographSearch, share_in_one_pose
from stereocal.intrinsics.proposed_board import split_of
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
from stereocal.system.photograph_files import named_photographs
from stereocal.system.settings import asked
from stereocal.system.split_photographs import split_into
from stereocal.system.taken import when_taken
from stereocal.verdict.in_words import listed

OPTIONS: Options = {
    "images IMAGES...": "photographs, folders, zips; or a video, whose sharpest still frames are "
    "taken",
    **BOARD,
    "--out FILE": "camera.json, or .yml for OpenCV; of two cameras a folder, for a data set or the "
    "lenses",
    **settings_options(LensSettings),
    "--leave-out NAME...": "photographs not to use",
    "--one-camera": "all photographs are of one camera, whatever their names say",
    **SPLIT,
    **WORKERS,
}
DEFAULTS = {"leave_out": ()}
CONSISTENT, NEAR_PX = 0.8, 2.0
"""Part of all corners that lie so near to the epipolar lines of one pose, at least, where it is not
sure which photographs belong together: of 8 true pairs all do, of the same mixed up 0.19."""


def run(parsed: argparse.Namespace) -> None:
    """Find the boards, calibrate, write the file or the folder, print the table."""
    out: Path = parsed.out
    with tempfile.TemporaryDirectory() as store, workers_from(parsed) as executor:
        photographs, cameras = _given(parsed, Path(store))
        if cameras and out.suffix:
            whose = "; ".join(
                f"{camera}: {series.names[0]} to {series.names[-1]}, {len(series.names)}"
                for camera, series in cameras.items()
            )
            raise StereocalError(
                f"The photographs are of {len(cameras)} cameras ({whose}), and {out} holds one "
                f"lens. For all lenses give a folder, --out {out.with_suffix('')}; for one, the "
                "photographs of one camera. If one camera took them all, state --one-camera."
            )
        may_be_pairs = not (out.suffix or parsed.one_camera)
        if may_be_pairs and _write_pairs(parsed, executor, photographs, cameras):
            return
        for camera, series in cameras.items():
            say(f"The {camera} camera: {series}.")
            of_camera = {name: photographs[name] for name in series.names}
            _write_lens(parsed, executor, of_camera, out / f"{camera}.json")
        if not cameras:
            _write_lens(parsed, executor, photographs, out)


def _given(parsed: argparse.Namespace, store: Path) -> tuple[dict[str, Path], dict[str, Series]]:
    """The photographs to use, and those of each camera if they are of two or more."""
    take = partial(with_frames, parsed.images, store)
    every = named_photographs(in_stages(take), store)
    names = {name for *both, _ in every for name in both}
    if missing := [name for name in parsed.leave_out if name not in names]:
        raise StereocalError(
            f"--leave-out: there is no photograph {listed(missing)}; there are "
            f"{listed([name for name, *_ in every])}."
        )
    used = [item for item in every if not {*item[:2]} & {*parsed.leave_out}]
    photographs, by_path = {n: path for n, _, path in used}, {n: path for _, n, path in used}
    if parsed.split:
        photographs = by_path = split_into(store, photographs, parsed.split)
    cameras = {} if parsed.one_camera else cameras_told(when_taken(by_path))
    return by_path if cameras else photographs, cameras


def _write_pairs(
    parsed: argparse.Namespace,
    executor: Executor,
    photographs: Mapping[str, Path],
    cameras: Mapping[str, Series],
) -> bool:
    """Write the data set of two cameras, if it is sure which photographs belong together."""
    proposal = propose(when_taken(photographs))
    pairing, is_sure = proposal.pairing, proposal.way != "order" and len(cameras) == 2
    if len(cameras) > 2 or not pairing.pairs or (not cameras and proposal.way == "order"):
        return False
    if cameras and not is_sure and pairing.ambiguous:
        say(pairing.sentence)
        return False
    lenses: dict[str, Camera | None] = dict.fromkeys(CAMERAS)
    sentences, settings = list[str](), _settings(parsed)
    search = PhotographSearch(pairing, photographs, lenses, pattern_of(parsed), settings)
    try:
        calibrated = in_stages(
            lambda begin, show: search.run(executor, begin, show, tell=sentences.append)
        )
    except StereocalError:
        if cameras:
            raise
        return False
    share = 1.0 if is_sure else share_in_one_pose(calibrated.recording, NEAR_PX)
    if share < CONSISTENT:
        say(
            f"{100 * share:.0f} % of the corners fit one pose of two cameras: these photographs "
            f"are not of the same moments. {'Lenses alone are' if cameras else 'One lens is'} made."
        )
        return False
    for sentence in sentences:
        say(sentence)
    write_recording(parsed.out, replace(calibrated.recording, name=parsed.out.stem))
    return True


def _write_lens(
    parsed: argparse.Namespace, executor: Executor, photographs: Mapping[str, Path], out: Path
) -> None:
    """Calibrate one lens, write its file, print the table."""
    if not parsed.one_camera and (split := split_of(photographs)) is not None:
        raise StereocalError(
            f"{min(photographs)} and others show the board in both halves: each photograph holds "
            f"the images of two cameras, {split}. With --split {split} and a folder as --out, both "
            "lenses are made. If one camera took them, state --one-camera."
        )
    boards_in = partial(find_boards, photographs, pattern_of(parsed), executor)
    search = with_bar("photographs searched", boards_in)
    calibrate = partial(calibrate_lens, search, _settings(parsed), executor)
    lens = with_bar("draws calibrated", calibrate)
    of_opencv, camera = out.suffix.lower() in (".yml", ".yaml"), lens.camera
    content = write_opencv_camera(camera) if of_opencv else write_camera(camera, about(lens))
    write_atomically(out, content)
    refused = (f"Not used: {item.name}: {item.reason}." for item in search.refused)
    table = (LENS_COLUMNS, *lens_rows(lens))
    rows = (" ".join(f"{cell:>16}" for cell in row) for row in table)
    notes = (*advice(lens), hint(lens), note_on_model(search, lens.settings))
    report(*refused, lens_answer(lens), *rows, notes=notes, written=[out])


def _settings(parsed: argparse.Namespace) -> LensSettings:
    return LensSettings(**{name: getattr(parsed, name) for name in asked(LensSettings)})
