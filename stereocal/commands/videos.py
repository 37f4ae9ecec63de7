"""The frames of two videos as photographs of a data set."""

import argparse
from functools import partial

from stereocal.commands.console import in_stages, say
from stereocal.errors import StereocalError
from stereocal.frames.video.extract import VideoSettings, extract
from stereocal.system.atomic_files import write_atomically


def take_frames(parsed: argparse.Namespace, coloured: bool) -> None:
    """Write frames of two videos into the folder of the data set."""
    if parsed.dataset.exists() and not parsed.dataset.is_dir():
        raise StereocalError(f"{parsed.dataset}: with --videos, the data set must be a folder.")
    every, ahead = parsed.every, parsed.clock_ahead
    if every is not None and every < 1:
        raise StereocalError(f"--every is {every}: it must be 1 or more.")
    settings = VideoSettings("every" if every else "still", every or 1, ahead, coloured)
    first, second = parsed.videos

    def write(name: str, content: bytes) -> None:
        write_atomically(parsed.dataset / name, content)

    for sentence in in_stages(partial(extract, (first, second), settings, write)).sentences:
        say(sentence)
