"""`stereocal detect`: find the targets in photographs and write the table of points."""

import argparse

from stereocal.commands.console import Number, Options, report, say
from stereocal.commands.options import LENSES_AND_LENGTHS, WORKERS, refuse_given, workers_from
from stereocal.commands.photographs import PAIR_BY, SPLIT, in_search, write_recording
from stereocal.detection.target import BOARDS, EXAMPLES, parse_board, parse_target
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.points_csv import write_points
from stereocal.frames.frame import correspondences_of, report_line
from stereocal.frames.search import compile_detection
from stereocal.system.atomic_files import write_atomically

LONGEST_S = 1e9
"""Between two clocks: 30 years."""
OPTIONS: Options = {
    "dataset": "folder or zip with dataset.json and photographs",
    "--out OUT": "the table: correspondences.csv; of a board, or of three cameras and more, "
    "points.csv, or a folder for a data set",
    "--target KIND": f"what is on the bar: {EXAMPLES} (default: bar2x2); or a board: {BOARDS}",
    "--videos VIDEO...": "take frames of the videos first, of the primary and the secondary, or of "
    "more cameras in the order of dataset.json, into a folder of each in that of the data set",
    "--every N": "of the videos, every N-th frame (default: the sharpest still one of each second)",
    "--clock-ahead S": {
        "type": Number(float, -LONGEST_S, LONGEST_S),
        "help": "by how many seconds the secondary's time stamps are ahead (default: both "
        "videos start at the same moment)",
    },
    "--doubtful": "doubtful frames go into the table too",
    **PAIR_BY,
    **SPLIT,
    **LENSES_AND_LENGTHS,
    **WORKERS,
}
DEFAULTS = {"target": "bar2x2"}


def run(parsed: argparse.Namespace) -> None:
    """Find the targets, print a line per frame, write the table."""
    if parsed.videos is None:
        refuse_given(parsed, "is for --videos", "every", "clock_ahead")
    board = parse_board(parsed.target)
    target = board or parse_target(parsed.target)
    if board is not None:
        refuse_given(parsed, "is for a bar, not for a board", "doubtful")
    with workers_from(parsed, compile_detection) as executor:
        search, targets = in_search(parsed, executor, target)
    frames = targets.frames
    for frame in frames:
        say(report_line(frame))
    if parsed.doubtful:
        frames = [frame.used(frame.state != "refused") for frame in frames]
    if frames:
        table = write_table(correspondences_of(frames))
    elif parsed.out.suffix.lower() == ".csv":
        table = write_points(search.recording(targets))
    else:
        write_recording(parsed.out, search.recording(targets))
        return
    write_atomically(parsed.out, table)
    report(written=[parsed.out])
