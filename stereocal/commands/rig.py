"""`stereocal rig`: one rig of three cameras and more."""

import argparse
from dataclasses import replace
from functools import partial

from stereocal.calibration.methods import CalibrationSettings
from stereocal.commands.console import Options, with_bar
from stereocal.commands.options import finish, questions, recording_from
from stereocal.errors import StereocalError
from stereocal.figures.rig_report import rig_report
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.fit import RigSettings
from stereocal.network.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.network.pair_of_rig import Sets, files_of_sets, refined_set, sets_of_pairs
from stereocal.network.rig_file import RIG, rig_file
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.workflow import Run

OPTIONS: Options = {
    "inputs DATASET...": "a data set with dataset.json of format 2",
    "--out OUT": "folder for the files",
    "--time-offset": "bring the cameras into step; each its offset",
    "--pairs": "of every pair also the two sets of the paper, with forecast and threshold",
    "--baseline-sigma S": "of baselines, m",
    **questions("lens_model"),
}


FIGURES = (
    *("fcp_reprojection", "median_error_3d", "p95_error_3d", "p95_metric_error_3d"),
    "threshold_px",
)
"""Of the forecast of a pair, in rig.json."""


def paper_sets(dataset: Dataset, settings: RefineSettings) -> Sets:
    """The refined set of a pair of a rig and the paper's two, with the forecast."""
    # The rig has left out the frames that contradict it.
    found = Run(dataset, CalibrationSettings(all_frames=True), settings)
    if found.forecast is None:
        raise StereocalError("there is no forecast for it.")
    return found.sets


def run(parsed: argparse.Namespace) -> None:
    """Calibrate, write rig.json, report.html and the pairs' files, print the answer."""
    if len(parsed.inputs) > 1 or parsed.inputs[0].suffix == ".json":
        raise StereocalError(
            "A rig is calibrated from its recording, not from the parameter files of its pairs: "
            "give one data set, a folder or a zip with dataset.json of format 2."
        )
    recording = recording_from(parsed, parsed.inputs[0])
    sigma = parsed.baseline_sigma
    settings = RigSettings(baseline_sigma_m=sigma, time_offsets=parsed.time_offset or None)
    rig = rig_file(with_bar("steps", partial(calibrate_rig, recording, settings)))
    sets_of = paper_sets if parsed.pairs else refined_set
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
    finish(parsed.out, files, *sentences, notes=(*rig_notes(rig), *notes))
