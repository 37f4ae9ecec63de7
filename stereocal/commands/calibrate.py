"""`stereocal calibrate`: the parameter files of two cameras, and whether these need two sets; of
more cameras one rig."""

import argparse
import math
from dataclasses import replace
from functools import partial

from stereocal.calibration.methods import Method
from stereocal.commands.console import Number, Options, with_bar
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    PAIR,
    PAIRS,
    SEARCH,
    changed,
    finish,
    pair_from,
    refine_settings_from,
    refuse_given,
    settings_from,
)
from stereocal.errors import StereocalError, naming
from stereocal.evaluation.evaluate import MOST_RUNS, EvaluationSettings
from stereocal.fit.errors.stated_inputs import undetectable_errors
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.parameter_file import errors_of_set
from stereocal.fit.results import Calibration
from stereocal.fit.timing.to_calibrate import in_step
from stereocal.formats.dataset_description import DESCRIPTION
from stereocal.formats.evaluation_files import Evaluation, validation_in_summary
from stereocal.formats.inputs import read_input
from stereocal.paper_kit.kit import paper_kit
from stereocal.rig.camera import CAMERAS
from stereocal.rig.lengths_in_words import question_about_units, rig_in_words, word_of
from stereocal.rig.recording import REFINED_ONLY, Recording
from stereocal.system.executors import engine
from stereocal.system.numbers import count
from stereocal.verdict.file_figures import stated_in
from stereocal.verdict.in_words import digits, in_percent, listed, refuse_unknown_frames
from stereocal.verdict.recommendation import frames_to_come
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun, usual_frames
from stereocal.workflow.run import Run

OPTIONS: Options = {
    "dataset": "folder or zip with dataset.json",
    "--out OUT": "folder for the files",
    **SEARCH,
    **LENSES_AND_LENGTHS,
    **PAIR,
    **PAIRS,
    "--calibration-frames K": "calibrate with K frames drawn at random, test with the others "
    "(default: all)",
    "--known-points": "3D cost: known points (columns x_m, y_m, z_m, or the corners of a board) "
    "instead of distances",
    "--runs N": {
        "type": Number(int, 0, MOST_RUNS),
        "help": "random splits of the validation; 0 for none (default: 100)",
    },
    "--no-refined": "the two sets of the paper only",
    "--free-distortion CAMERA...": {
        "help": "refined set: estimate the distortion of primary, secondary, or both",
        "choices": CAMERAS,
    },
    "--validation SUMMARY.JSON": "summary.json of evaluate: copies its figures and threshold into "
    "the files",
    "--kit": "also write paper_kit.zip: methods, references, table, data set and parameter files",
}
DEFAULTS = {"runs": 100, "free_distortion": ()}
OF_ALL = ("--pairs", "--baseline-sigma", "--time-offset", "--time-drift", "--lens-model", "--out")
OF_FRAMES = ("--all-frames", "--put-back", "--leave-out")
OF_TWO = "is for two cameras: choose them with --pair, as --pair left-right"
OF_SEARCHES = "is for the paper's two sets: add --pairs, or choose two cameras with --pair"


def run(parsed: argparse.Namespace) -> None:
    if parsed.kit and parsed.validation:
        raise StereocalError(
            "A paper kit describes the validation of its own run: give --kit or --validation."
        )
    recording = read_input(parsed.dataset, parsed.lens_model)
    if parsed.pair is None and (len(recording.cameras) > 2 or recording.has_windows):
        _all(recording, parsed)
        return
    refuse_given(parsed, "is for three cameras and more", "pairs")
    dataset = pair_from(parsed, parsed.dataset, recording)
    settings = settings_from(parsed, parsed.calibration_frames)
    refuse_unknown_frames(settings, [dataset])
    free = tuple(parsed.free_distortion)
    refined = refine_settings_from(parsed, free) if parsed.refined else None
    figures = validation_in_summary(parsed.validation, dataset) if parsed.validation else {}
    calibrated = PairRun(dataset, settings, refined)
    validation = _validation(calibrated, parsed.runs) if parsed.runs else None
    answer = PairAnswer(calibrated, validation, figures)
    files = answer.parameter_files
    if parsed.kit:
        files["paper_kit.zip"] = paper_kit(answer)
    notes = (f"Note: {note}" for note in _notes_on(answer) if note)
    recommended = f"Recommendation: {answer.recommendation.text}"
    finish(parsed.out, files, *_lines_of(answer), *notes, recommended)


def _all(recording: Recording, parsed: argparse.Namespace) -> None:
    """Calibrate all cameras as one rig."""
    from stereocal.commands.rig import write  # its report is drawn, which takes an extra

    for option in changed(parsed, OPTIONS, DEFAULTS):
        if recording.has_windows and (option not in OF_ALL or option == "--pairs"):
            raise StereocalError(f"{option} is for cameras in air: {REFINED_ONLY}.")
        if option not in OF_ALL and (option not in SEARCH or option in OF_FRAMES):
            raise StereocalError(f"{option} {OF_TWO}.")
        if option not in OF_ALL and not parsed.pairs:
            raise StereocalError(f"{option} {OF_SEARCHES}.")
    with naming(str(parsed.dataset)):
        recording = in_step(recording)
    rig = RefineSettings(baseline_sigma_m=parsed.baseline_sigma, time_drift=bool(parsed.time_drift))
    late = parsed.time_offset or parsed.time_drift or None
    searches = replace(settings_from(parsed, None), time_offset=False) if parsed.pairs else None
    write(Run(recording, rig, late, searches), parsed.out)


def _lines_of(answer: PairAnswer) -> list[str]:
    """The data, and what each method made of them."""
    calibration = answer.run.calibration
    dataset, rows = calibration.dataset, calibration.dataset.correspondences
    lines = [
        f"{dataset.name}: {count(len(rows), 'pair')}, {count(len(rows.bars), 'bar')} in "
        f"{count(len(rows.frames), 'frame')}; calibrated with "
        f"{count(len(calibration.frames), 'frame')}; errors are of all frames not left out.",
        rig_in_words(dataset, answer.sets[answer.recommendation.measure.method].pose),
        *_table_of(calibration),
    ]
    if (volume := answer.sets["3d"].volume) is not None:
        lines.append(volume.sentence())
    if (result := calibration.refined) is not None:
        noise, scatter = result.sigma_px, result.scatter_m
        baseline = errors_of_set(result)["baseline_m"]
        lines.append(
            f"refined: noise {noise.value:.3f} px ({noise.source}), scatter of the bar "
            f"{1000 * scatter.value:.2f} mm ({scatter.source}), baseline "
            f"{baseline.value:.4f} ± {baseline.sigma:.4f} m"
        )
        if result.outlying_frames:
            named = listed([str(frame) for frame in result.outlying_frames])
            lines.append(f"refined: left out as well, given its stated uncertainties: {named}")
    if answer.run.forecast:
        of = frames_to_come(calibration, answer.run.forecast)
        lines += _forecast_lines(answer, of)
    return lines


def _notes_on(answer: PairAnswer) -> list[str]:
    """Warnings, inputs that disagree, errors that cannot be detected, advice; or empty."""
    calibration, inputs = answer.run.calibration, answer.run.inputs
    pose = answer.sets[answer.recommendation.measure.method].pose
    # Whether the lengths are in metres: a script cannot answer, so it is a note.
    question = question_about_units(calibration.dataset, pose)
    if question:
        question += f" If not, correct {DESCRIPTION}: no residual shows a wrong unit."
    accused = [item.advice for item in inputs if item.accused]
    timing = calibration.screening.time_note
    step = calibration.dataset.recording.step_notes
    remarks = *step, question, timing, *calibration.warnings, *accused, undetectable_errors(inputs)
    return [*remarks, answer.run.advice]


def _validation(run: PairRun, runs: int) -> Evaluation | None:
    """Random splits of the frames not left out; None if there are too few."""
    search = replace(run.settings, calibration_frames=None)
    drawn = usual_frames(len(run.calibration.screening.dataset.correspondences.frames))
    try:
        settings = EvaluationSettings(search, runs, drawn, refined=run.refined)
        with engine() as executor:  # with its progress on stderr
            return with_bar("random splits", partial(run.validate, settings, executor))
    except StereocalError as error:
        print(f"No validation: {error}")
        return None


def _forecast_lines(answer: PairAnswer, of: str) -> list[str]:
    lines = [f"Forecast for {of} (95 % intervals), with the threshold in each file:"]
    held, thresholds = word_of(answer.run.calibration.dataset), answer.thresholds_px
    for method, entries in answer.forecast_entries.items():
        fcp, length, metric = (
            in_percent(stated_in(entries, name))
            for name in ("fcp_reprojection", "p95_error_3d", "p95_metric_error_3d")
        )
        threshold = thresholds.get(method)
        lines.append(
            f"{method:<10} overlap of correct and wrong pairs {fcp}, 95 % of lengths within "
            f"{length} relative to the {held}, in metres within {metric}"
            + (f", threshold {digits(threshold, 2)} px" if threshold else "")
        )
    return lines


def _table_of(calibration: Calibration) -> list[str]:
    lines = [
        f"{'method':<10} {'reprojection px':>15} {'length mean %':>14} {'length 95 %':>12} "
        f"{'evaluations':>12} {'seconds':>8}  stopped because"
    ]
    searches: dict[Method, tuple[int, float, str]] = {
        name: (result.evaluations, result.seconds, result.stop_reason)
        for name, result in calibration.methods.items()
    }
    if (refined := calibration.refined) is not None:
        searches["refined"] = (refined.steps, refined.seconds, refined.stop_reason)
    for name, (evaluations, seconds, stopped) in searches.items():
        errors = calibration.errors[name]
        lengths = errors.mean_length, errors.p95_length
        mean, p95 = ("none" if math.isnan(part) else f"{100 * part:.4f}" for part in lengths)
        lines.append(
            f"{name:<10} {errors.mean_reprojection_px:>15.4f} {mean:>14} {p95:>12} "
            f"{evaluations:>12} {seconds:>8.3f}  {stopped}"
        )
    return lines
