"""`stereocal calibrate`: the parameter files of a data set, and whether it needs two sets."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace

from stereocal.calibration.methods import Method
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    PAIR,
    SEARCH,
    dataset_from,
    refine_settings_from,
    settings_from,
)
from stereocal.commands.parser import Options
from stereocal.commands.progress import ProgressBar, report
from stereocal.commands.warming import compile_apart
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.formats.description import DESCRIPTION
from stereocal.formats.evaluation_files import Evaluation, validation_in_summary
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.refined.stated_inputs import Input, undetectable_errors
from stereocal.refined.uncertainty import standard_errors
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import CAMERAS
from stereocal.rig.lengths_in_words import question_about_units, rig_in_words
from stereocal.system.atomic_files import write_all
from stereocal.system.executors import engine
from stereocal.verdict.forecast import outlook_of
from stereocal.verdict.in_words import digits, interval, listed, percent
from stereocal.verdict.predictive import Predictive
from stereocal.workflow import answer, calibrate, conclusions_of_seeds, usual_frames

FILES: dict[Method, str] = {
    "2d": "parameters_2d.json",
    "3d": "parameters_3d.json",
    "refined": "parameters_refined.json",
}


OPTIONS: Options = {
    "dataset": "folder or zip with dataset.json",
    "--out OUT": "folder for the files",
    **SEARCH,
    **LENSES_AND_LENGTHS,
    **PAIR,
    "--calibration-frames K": "calibrate with K frames drawn at random, test with the others "
    "(default: all)",
    "--known-points": "3D cost: known points (columns x_m, y_m, z_m, or the corners of a board) "
    "instead of distances",
    "--runs N": "random splits of the validation; 0 for none (default: 100)",
    "--no-refined": {
        "help": "the two sets of the paper only",
        "dest": "refined",
        "action": "store_false",
    },
    "--free-distortion CAMERA...": {
        "help": "refined set: estimate the distortion of primary, secondary, or both",
        "choices": CAMERAS,
    },
    "--validation SUMMARY.JSON": "summary.json of evaluate: copies its figures and threshold into "
    "the files",
    "--kit": "also write paper_kit.zip: methods, figures, table, and an archive for reproduce",
}
DEFAULTS = {"runs": 100, "free_distortion": ()}


def run(parsed: argparse.Namespace) -> None:
    """Calibrate, validate, write the files, print the table and the recommendation."""
    if parsed.kit and parsed.validation:
        raise StereocalError(
            "A paper kit holds what computes its files again: give --kit or --validation."
        )
    dataset = dataset_from(parsed, parsed.dataset)
    if parsed.kit:
        from stereocal.paper_kit.kit import paper_kit  # Matplotlib: 0.4 s

        compile_apart()
    settings = settings_from(parsed, parsed.calibration_frames)
    free = tuple(parsed.free_distortion)
    refined = refine_settings_from(parsed, free) if parsed.refined else None
    figures = validation_in_summary(parsed.validation, dataset) if parsed.validation else {}
    calibration = calibrate(dataset, settings, refined=refined)
    evaluation = validate(calibration, refined, parsed.runs) if parsed.runs else None
    found = answer(calibration, outlook_of(calibration), evaluation, figures)
    files = {parsed.out / FILES[name]: own.dumps().encode() for name, own in found.sets.items()}
    if parsed.kit:
        files[parsed.out / "paper_kit.zip"] = paper_kit(found)
    write_all(files)
    rows = dataset.correspondences
    print(
        f"{dataset.name}: {len(rows)} pairs, {len(rows.bars)} bars in {len(rows.frames)} frames; "
        f"calibrated with {len(calibration.frames)} frames; errors are of all frames not left out."
    )
    pose = found.sets[found.recommendation.measure.method].pose
    print(rig_in_words(dataset, pose))
    print(table_of(calibration))
    if (volume := found.sets["3d"].volume) is not None:
        print(volume.sentence())
    if calibration.refined is not None:
        print(refined_lines(calibration.refined))
    if found.outlook:
        print(forecast_lines(found.outlook.predictive, found.thresholds_px))
    print_notes(calibration, found.inputs, question_about_units(dataset, pose))
    if found.outlook:
        seeds = conclusions_of_seeds(calibration, found.outlook)
        report(notes=filter(None, (seeds, found.outlook.advice)))
    report(f"Recommendation: {found.recommendation.text}", written=files)


def validate(
    calibration: Calibration, refined: RefineSettings | None, runs: int
) -> Evaluation | None:
    """Random splits of the frames not left out; None, and the reason, if there are too few."""
    kept = calibration.screening.dataset
    settings = EvaluationSettings(
        replace(calibration.settings, calibration_frames=None),
        runs,
        usual_frames(len(kept.correspondences.frames)),
        refined,
    )
    try:
        return evaluation_of(calibration, settings)
    except StereocalError as error:
        print(f"No validation: {error}")
        return None


def evaluation_of(calibration: Calibration, settings: EvaluationSettings) -> Evaluation:
    """A validation of the frames not left out, with its progress on stderr."""
    kept = calibration.screening.dataset
    with engine() as executor, ProgressBar("random splits") as bar:
        found = evaluate([kept], settings, executor, bar.show)
    assert found is not None  # nobody cancels here
    return Evaluation(found, settings, [kept.name], [calibration.dataset.sha256])


def print_notes(calibration: Calibration, inputs: list[Input], question: str) -> None:
    """Warnings, inputs that disagree, and errors that cannot be detected.

    Args:
        question: whether the lengths are in metres; or empty. A script cannot answer: it is a note.
    """
    if question:
        question += f" If not, correct {DESCRIPTION}: no residual shows a wrong unit."
    accused = [item.advice for item in inputs if item.accused]
    timing = calibration.screening.time_note
    notes = [question, timing, *calibration.warnings, *accused, undetectable_errors(inputs)]
    report(notes=filter(None, notes))


def refined_lines(result: RefinedResult) -> str:
    """Noise and left-out frames of the refined set."""
    lines = [
        f"refined: noise {result.sigma_px.value:.3f} px ({result.sigma_px.source}), scatter of the "
        f"bar {1000 * result.scatter_m.value:.2f} mm ({result.scatter_m.source}), "
        f"baseline {result.pose.baseline:.4f} ± {standard_errors(result)['baseline_m'].sigma:.4f} m"
    ]
    if result.outlying_frames:
        named = listed([str(frame) for frame in result.outlying_frames])
        lines.append(f"refined: left out as well, given its stated uncertainties: {named}")
    return "\n".join(lines)


def forecast_lines(predictive: Predictive, thresholds: Mapping[Method, float | None]) -> str:
    """What each file will do on frames to come.

    Args:
        thresholds: of the files, px.
    """
    lines = ["Expected on new frames with similar bars (95 % intervals):"]
    for method, found in predictive.forecasts.items():
        fcp, length = found.fcp_reprojection, found.median_error_3d
        lines.append(
            f"{method:<10} wrong pairs that look right {percent(fcp.value)} % ({interval(fcp)}), "
            f"length error (median) {percent(length.value)} % ({interval(length)})"
            + (f", threshold {digits(own, 2)} px" if (own := thresholds.get(method)) else "")
        )
    return "\n".join(lines)


def table_of(calibration: Calibration) -> str:
    """The results of the methods, one per line."""
    lines = [
        f"{'method':<10} {'reprojection px':>15} {'length mean %':>14} {'length 95 %':>12} "
        f"{'evaluations':>12} {'seconds':>8}  stopped because"
    ]
    told: dict[Method, tuple[int, float, str]] = {
        name: (own.evaluations, own.seconds, own.stop_reason)
        for name, own in calibration.methods.items()
    }
    if (refined := calibration.refined) is not None:
        told["refined"] = (refined.steps, refined.seconds, refined.stop_reason)
    for name, (evaluations, seconds, stopped) in told.items():
        errors = calibration.errors[name]
        lines.append(
            f"{name:<10} {errors.mean_reprojection_px:>15.4f} "
            f"{_percent(errors.mean_length):>14} {_percent(errors.p95_length):>12} "
            f"{evaluations:>12} {seconds:>8.3f}  {stopped}"
        )
    return "\n".join(lines)


def _percent(fraction: float) -> str:
    return "none" if math.isnan(fraction) else f"{100 * fraction:.4f}"
