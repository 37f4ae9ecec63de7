"""`stereocal sync`: bring cameras that were started by hand into step."""

import argparse

from stereocal.commands.console import Options
from stereocal.commands.options import finish, questions
from stereocal.errors import naming
from stereocal.figures.html import html_page, html_plot
from stereocal.figures.started_by_hand import describe_offsets, plot_offsets
from stereocal.fit.readings.lost_frames import lost_in_step
from stereocal.fit.timing.started_by_hand import bring_into_step
from stereocal.formats.dataset_files import pack_recording, read_recording

OPTIONS: Options = {
    "dataset": "folder or zip with dataset.json of format 2, whose cameras counted their own "
    "frames: its points.csv with the column camera_frame, or a table for each camera",
    "--out OUT": "folder for the data set in step, and sync.html",
    **questions("lens_model"),
}


def run(parsed: argparse.Namespace) -> None:
    """Find the offsets, write the data set with one count of frames, print what was found."""
    counted = read_recording(parsed.dataset, parsed.lens_model, as_counted=True)
    with naming(str(parsed.dataset)):
        in_step = bring_into_step(counted)
        lost = lost_in_step(in_step.recording)
    notes = [*in_step.recording.step_notes, *filter(None, [lost])]
    plots = {
        "-".join(pair): html_plot(plot_offsets(offset), describe_offsets(offset))
        for pair, offset in in_step.pairs.items()
    }
    page = html_page(f"{counted.name}: cameras started by hand", " ".join(notes), plots)
    finish(parsed.out, {**pack_recording(in_step.recording), "sync.html": page.encode()}, *notes)
