"""`stereocal detect`: find the targets in photographs and write the table of points."""

import argparse
import tempfile
from functools import partial
from pathlib import Path

from stereocal.commands.console import Options, in_stages, report, say, with_bar
from stereocal.commands.intrinsics import detect_board
from stereocal.commands.options import LENSES_AND_LENGTHS, WORKERS, refuse_given, workers_from
from stereocal.commands.photographs import PAIR_BY, pairing_of, take_frames, two_cameras_of
from stereocal.detection.target import BOARDS, BRIGHT, EXAMPLES, Balls, parse_board, parse_target
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames.frame import correspondences_of, describe_frames, report_line
from stereocal.frames.search import compile_detection, detect_frames
from stereocal.frames.slips import find_slip
from stereocal.system.atomic_files import write_atomically
from stereocal.system.photograph_files import of_the_bar, photographs_in

OPTIONS: Options = {
    "dataset": "folder or zip with dataset.json and photographs",
    "--out OUT": "the table: correspondences.csv; of a board points.csv, or a folder for a data "
    "set",
    "--target KIND": f"what is on the bar: {EXAMPLES} (default: bar2x2); or a board: {BOARDS}",
    "--videos PRIMARY SECONDARY": "take frames of two videos first, into primary/ and secondary/ "
    "of the folder",
    "--every N": "of the videos, every N-th frame (default: the sharpest still one of each second)",
    "--clock-ahead S": "by how many seconds the secondary's time stamps are ahead (default: both "
    "videos start at the same moment)",
    "--doubtful": "doubtful frames go into the table too",
    **PAIR_BY,
    **LENSES_AND_LENGTHS,
    **WORKERS,
}
DEFAULTS = {"target": "bar2x2"}


def run(parsed: argparse.Namespace) -> None:
    """Find the targets, print a line per frame, write the table."""
    if parsed.videos is None:
        refuse_given(parsed, "is for --videos", "every", "clock_ahead")
    if (board := parse_board(parsed.target)) is not None:
        detect_board(parsed, board)
        return
    target = parse_target(parsed.target)
    first, second = two_cameras_of(parsed).cameras.values()
    if parsed.videos is not None:
        take_frames(parsed, isinstance(target, Balls) and BRIGHT not in target.colours)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as store:
        unpack = partial(photographs_in, parsed.dataset, Path(store))
        photographs = of_the_bar(with_bar("photographs unpacked", unpack))
        pairing = pairing_of(photographs, parsed.dataset, parsed.pair_by)
        say(f"{len(photographs)} photographs. {pairing.sentence}")
        cameras = first, second
        with workers_from(parsed, compile_detection) as executor:
            about = pairing.pairs, photographs, cameras, executor
            frames = in_stages(partial(detect_frames, *about, target=target))
    for frame in frames:
        say(report_line(frame))
    if parsed.doubtful:
        frames = [frame.used(frame.state != "refused") for frame in frames]
    say(describe_frames(frames))
    if (slip := find_slip(frames, cameras)) is not None:
        say(f"{slip} Take it out of the folder, and find the targets again.")
    write_atomically(parsed.out, write_table(correspondences_of(frames)))
    report(written=[parsed.out])
