"""The photographs of two cameras for a command, and frames of videos as such."""

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, report, say
from stereocal.detection.target import BRIGHT, Balls, Board, Target
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import pack_recording
from stereocal.frames.all_cameras import Found
from stereocal.frames.proposal import WAYS
from stereocal.frames.several_cameras import chapters_in_words
from stereocal.frames.video.extract import FrameChoice, VideoSettings, extract
from stereocal.library.targets import DataSetSearch
from stereocal.rig.recording import Recording
from stereocal.system.atomic_files import write_all, write_atomically
from stereocal.system.split_photographs import SPLITS

PAIR_BY: Options = {
    "--pair-by": {
        "choices": [*WAYS],
        "help": "how photographs belong together (default: by name, else by the time taken, else "
        "in order if both cameras have as many); motion: the cameras were started by hand, and the "
        "targets tell",
    }
}
SPLIT: Options = {
    "--split": {
        "choices": [*SPLITS],
        "help": "each photograph, or frame of the one video, holds the images of two cameras: "
        "split it into left (or upper) and right",
    }
}


def in_search(
    parsed: argparse.Namespace, executor: Executor, target: Target | Board
) -> tuple[DataSetSearch, Found]:
    """What is found in the photographs of a data set, with a bar for each stage."""
    search = DataSetSearch(parsed.dataset, executor, say, parsed.pair_by, parsed.lens_model)
    search = replace(search, split=parsed.split)
    if search.is_described or not isinstance(target, Board):
        _ = search.known  # before the long work
    if parsed.doubtful and len(search.cameras) > 2:
        raise StereocalError("--doubtful is for the bars of two cameras.")
    if parsed.videos is not None:
        coloured = isinstance(target, Balls) and BRIGHT not in target.colours
        search = replace(search, heard=_take_frames(parsed, search.cameras, coloured), split=None)
    return search, in_stages(lambda begin, show: search.found(target, begin, show))


def _take_frames(
    parsed: argparse.Namespace, cameras: Sequence[str], coloured: bool
) -> Mapping[str, float]:
    """Write frames of the videos into the folder of the data set; what their sound says."""
    if parsed.dataset.exists() and not parsed.dataset.is_dir():
        raise StereocalError(f"{parsed.dataset}: with --videos, the data set must be a folder.")
    every, ahead = parsed.every, parsed.clock_ahead
    by_hand = parsed.pair_by == "motion"
    if by_hand and ahead is not None:
        raise StereocalError(
            "--clock-ahead compares the clocks of both cameras, and with --pair-by motion the "
            "targets tell: state one of them."
        )
    if chapters := chapters_in_words(map(str, parsed.videos)):
        raise StereocalError(f"--videos: {chapters}")
    if parsed.split and (len(cameras) > 2 or by_hand or ahead is not None):
        raise StereocalError("--split: a video of both cameras shows two, of the same moments.")
    of = cameras[:1] if parsed.split else cameras
    if len(parsed.videos) != len(of):
        wanted = f"one of each camera, in the order {', '.join(cameras)}"
        if len(cameras) == 2:
            wanted += f"; or one that shows both, with --split {' or '.join(SPLITS)}"
        raise StereocalError(f"--videos: these are {len(parsed.videos)}; give {wanted}.")
    choice: FrameChoice = "every" if every else "still"
    settings = VideoSettings(choice, every or 1, ahead, by_hand, coloured, parsed.split)
    videos = dict(zip(of, parsed.videos, strict=True))
    earlier = {
        path.relative_to(parsed.dataset).as_posix()
        for which in cameras
        for path in (parsed.dataset / which).glob("[0-9][0-9][0-9][0-9][0-9][0-9].*")
    }

    def write(name: str, content: bytes) -> None:
        write_atomically(parsed.dataset / name, content)
        earlier.discard(name)

    frames = in_stages(partial(extract, videos, settings, write))
    for sentence in frames.sentences:
        say(sentence)
    if earlier and by_hand:
        raise StereocalError(
            f"{parsed.dataset}: {min(earlier)} and {len(earlier) - 1} more are frames that were "
            "taken otherwise, of other moments: remove the folders of frames, and begin again."
        )
    return frames.heard


def write_recording(folder: Path, recording: Recording) -> None:
    write_all({folder / name: content for name, content in pack_recording(recording).items()})
    report(written=[folder])
