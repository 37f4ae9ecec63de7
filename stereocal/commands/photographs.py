"""The photographs of two cameras for a command: their pairs, and frames of videos as such."""

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, say
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_cameras
from stereocal.frames.pairing import Pairing
from stereocal.frames.proposal import WAYS, Choice, Way, propose
from stereocal.frames.video.extract import VideoSettings, extract
from stereocal.rig.recording import Recording
from stereocal.system.atomic_files import write_atomically
from stereocal.system.taken import when_taken

PAIR_BY: Options = {
    "--pair-by": {
        "choices": [*WAYS],
        "help": "how photographs belong together (default: by name, else by the time taken, else "
        "in order if both cameras have as many)",
    }
}


def two_cameras_of(parsed: argparse.Namespace) -> Recording:
    """The cameras of a data set of two, and its lengths."""
    known = read_cameras(parsed.dataset, parsed.lens_model)
    if len(known.cameras) > 2:
        raise StereocalError(
            f"{parsed.dataset}: it has {len(known.cameras)} cameras; targets and boards are found "
            "in the photographs of two."
        )
    return known


def pairing_of(photographs: Mapping[str, Path], source: Path, way: Way | None = None) -> Pairing:
    """The pairs of photographs.

    Args:
        way: how to pair, if it is stated.

    Raises:
        StereocalError: there are no pairs in this way; or, if none is stated, no way is sure.
    """
    proposal = propose(when_taken(photographs), Choice(way))
    pairing = proposal.pairing
    if way is not None and proposal.way != way:
        raise StereocalError(f"{source}: no two photographs can be paired by --pair-by {way}.")
    if not pairing.pairs:
        raise StereocalError(f"{source}: {pairing.sentence}")
    if pairing.ambiguous and way is None:
        ways = " or ".join(f"--pair-by {each}" for each in proposal.ways)
        raise StereocalError(f"{source}: {pairing.sentence} Or state how to pair them: {ways}.")
    return pairing


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
