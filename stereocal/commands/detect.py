"""`stereocal detect`: find the targets in photographs and write the table of points."""

import argparse

from stereocal.commands.console import Options, report, say
from stereocal.commands.options import LENSES_AND_LENGTHS, WORKERS, refuse_given, workers_from
from stereocal.commands.photographs import PAIR_BY, in_search, write_recording
from stereocal.detection.target import BOARDS, EXAMPLES, Board, parse_board, parse_target
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.recording_files import write_points
from stereocal.frames.frame import correspondences_of, report_line
from stereocal.frames.search import compile_detection
from stereocal.system.atomic_files import write_atomically

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
    board = parse_board(parsed.target)
    if board is not None:
        refuse_given(parsed, "is for a bar, not for a board", "doubtful")
        _write_boards(parsed, board)
        return
    target = parse_target(parsed.target)
    with workers_from(parsed, compile_detection) as executor:
        frames = in_search(parsed, executor, target, lambda search: search.frames(target))
    for frame in frames:
        say(report_line(frame))
    if parsed.doubtful:
        frames = [frame.used(frame.state != "refused") for frame in frames]
    write_atomically(parsed.out, write_table(correspondences_of(frames)))
    report(written=[parsed.out])


def _write_boards(parsed: argparse.Namespace, board: Board) -> None:
    """Write the table of a board's corners, or a whole data set."""
    with workers_from(parsed) as executor:
        found = in_search(parsed, executor, board, lambda search: search.boards(board))
    if parsed.out.suffix.lower() != ".csv":
        write_recording(parsed.out, found)
        return
    write_atomically(parsed.out, write_points(found))
    report(written=[parsed.out])
