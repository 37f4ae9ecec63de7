"""`stereocal rig`: one rig of all cameras of a recording, as `calibrate` of three and more."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from stereocal.calibration.methods import CalibrationSettings
from stereocal.commands.console import Options, in_stages
from stereocal.commands.options import PAIRS, finish, questions, recording_from
from stereocal.errors import StereocalError
from stereocal.figures.rig_report import rig_report
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.rig_file import RIG, RigFile
from stereocal.rig.recording import REFINED_ONLY
from stereocal.system.tasks import Progress
from stereocal.workflow.run import Run

OPTIONS: Options = {
    "inputs DATASET...": "a data set with dataset.json of format 2",
    "--out OUT": "folder for the files",
    "--time-offset": "bring the cameras into step; each its offset",
    **PAIRS,
    "--baseline-sigma S": "of baselines, m",
    **questions("lens_model"),
}


def run(parsed: argparse.Namespace) -> None:
    if len(parsed.inputs) > 1 or parsed.inputs[0].suffix == ".json":
        raise StereocalError(
            "A rig is calibrated from its recording, not from the parameter files of its pairs: "
            "give one data set, a folder or a zip with dataset.json of format 2."
        )
    recording = recording_from(parsed, parsed.inputs[0])
    settings = RefineSettings(baseline_sigma_m=parsed.baseline_sigma)
    if parsed.pairs and recording.has_windows:
        raise StereocalError(f"--pairs is for cameras in air: {REFINED_ONLY}.")
    searches = CalibrationSettings() if parsed.pairs else None
    write(Run(recording, settings, parsed.time_offset or None, searches), parsed.out)


def write(run: Run, out: Path) -> None:
    """Write rig.json, report.html and the pairs' files, print the answer."""

    def made(begin: Callable[[str], None], show: Progress) -> tuple[Run, RigFile]:
        shown_run = replace(run, begin=begin, progress=show)
        return shown_run, shown_run.rig

    calibrated, rig = in_stages(made)
    report = rig_report(rig, run.recording.name)
    files = {RIG: rig.dumps().encode(), "report.html": report.encode(), **calibrated.pair_files}
    finish(out, files, *calibrated.sentences, notes=calibrated.notes)
