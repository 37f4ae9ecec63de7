"""`stereocal rig`: one rig of all cameras of a recording, as `calibrate` of three and more."""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

from stereocal.calibration.methods import CalibrationSettings
from stereocal.commands.console import Options, with_bar
from stereocal.commands.options import PAIRS, finish, questions, recording_from
from stereocal.errors import StereocalError
from stereocal.figures.rig_report import rig_report
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.network.pair_of_rig import Sets, files_of_sets, refined_set, sets_of_pairs
from stereocal.network.rig_file import RIG, rig_file
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.workflow import Run

OPTIONS: Options = {
    "inputs DATASET...": "a data set with dataset.json of format 2",
    "--out OUT": "folder for the files",
    "--time-offset": "bring the cameras into step; each its offset",
    **PAIRS,
    "--baseline-sigma S": "of baselines, m",
    **questions("lens_model"),
}


FIGURES = (
    *("fcp_reprojection", "median_error_3d", "p95_error_3d", "p95_metric_error_3d"),
    "threshold_px",
)
"""Of the forecast of a pair, in rig.json."""


def paper_sets(searches: CalibrationSettings, dataset: Pair, settings: RefineSettings) -> Sets:
    """The refined set of a pair of a rig and the paper's two, with the forecast."""
    # The rig has left out the frames that contradict it.
    found = Run(dataset, replace(searches, all_frames=True), settings)
    if found.forecast is None:
        raise StereocalError("there is no forecast for it.")
    return found.sets


def run(parsed: argparse.Namespace) -> None:
    if len(parsed.inputs) > 1 or parsed.inputs[0].suffix == ".json":
        raise StereocalError(
            "A rig is calibrated from its recording, not from the parameter files of its pairs: "
            "give one data set, a folder or a zip with dataset.json of format 2."
        )
    recording = recording_from(parsed, parsed.inputs[0])
    settings = RefineSettings(baseline_sigma_m=parsed.baseline_sigma)
    late = parsed.time_offset or None
    searches = CalibrationSettings() if parsed.pairs else None
    calibrate_all(recording, settings, late, parsed.out, searches)


def calibrate_all(
    recording: Recording,
    settings: RefineSettings,
    late: bool | None,
    out: Path,
    searches: CalibrationSettings | None,
) -> None:
    """Calibrate, write rig.json, report.html and the pairs' files, print the answer.

    Args:
        late: as of `calibrate_rig`.
        searches: of the paper's two sets of every pair; None: without these.
    """
    rig = rig_file(with_bar("steps", partial(calibrate_rig, recording, settings, late)))
    sets_of = refined_set if searches is None else partial(paper_sets, searches)
    sets, notes = with_bar("pairs", partial(sets_of_pairs, recording, rig, sets_of=sets_of))
    of_pairs = {**rig.about.pairs}
    for pair, own in sets.items():
        predicted = own["refined"].predicted or {}
        figures = {name: predicted[name] for name in FIGURES if name in predicted}
        of_pairs[pair] = replace(of_pairs[pair], **figures)
    rig = replace(rig, about=replace(rig.about, pairs=of_pairs))
    notes = [*recording.step_notes, *notes]
    files = {RIG: rig.dumps().encode(), "report.html": rig_report(rig, recording.name).encode()}
    files |= files_of_sets(sets)
    sentences = filter(None, (rig_sentence(rig), loops_sentence(rig)))
    finish(out, files, *sentences, notes=(*rig_notes(rig), *notes))
