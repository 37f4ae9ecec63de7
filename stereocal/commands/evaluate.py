"""`stereocal evaluate`: FCP and 3D error over random splits."""

import argparse
from contextlib import suppress
from functools import partial

from stereocal.commands.console import Options, with_bar
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    PAIR,
    WORKERS,
    dataset_from,
    finish,
    refine_settings_from,
    settings_from,
    settings_options,
    workers_from,
)
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate, evaluate_runs
from stereocal.evaluation.summary import summarise_all
from stereocal.figures.report import report_html
from stereocal.formats.evaluation_files import summary_json, unique_names, validation_figures
from stereocal.verdict.in_words import (
    left_out_line,
    refuse_unknown_frames,
    why_held_out_not_trusted,
)
from stereocal.verdict.validation_in_words import validation_answer
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun

OPTIONS: Options = {
    "datasets DATASET...": "folders, zips",
    "--out OUT": "folder for the two files",
    **settings_options(EvaluationSettings),
    **LENSES_AND_LENGTHS,
    **PAIR,
    "--known-points": "as for calibrate",
    "--no-refined": "the paper's three methods only",
    **WORKERS,
}


def run(parsed: argparse.Namespace) -> None:
    datasets = [dataset_from(parsed, path) for path in parsed.datasets]
    search = settings_from(parsed, calibration_frames=None)
    refuse_unknown_frames(search, datasets)
    refined = refine_settings_from(parsed) if parsed.refined else None
    settings = EvaluationSettings(
        search, parsed.runs, parsed.calibration_frames, parsed.splits, refined
    )
    pair_runs = [PairRun(dataset, settings.calibration, settings.refined) for dataset in datasets]
    screenings = [run.screening for run in pair_runs]
    screened = [screening.dataset for screening in screenings]
    with workers_from(parsed, partial(evaluate_runs, screened[0], settings, 0, [0])) as executor:
        runs = with_bar("runs", partial(evaluate, screened, settings, executor))
    pooled, by_dataset = summarise_all(unique_names(datasets), runs)
    answers = [
        PairAnswer(run, figures=validation_figures(summaries, settings))
        for run, summaries in zip(pair_runs, by_dataset.values(), strict=True)
    ]
    calibrated = [answer for answer in answers if _is_calibrated(answer.run)]
    forecasts = [answer.forecast_entries if answer in calibrated else {} for answer in answers]
    only = calibrated[0] if len(calibrated) == len(pair_runs) == 1 else None
    recommended = (only.run.calibration, only.recommendation) if only else None
    summary = summary_json(pooled, by_dataset, datasets, settings, screenings, forecasts)
    report = report_html(pooled, by_dataset, datasets, settings, screenings, recommended)
    files = {"summary.json": summary, "report.html": report.encode()}
    lines = [
        f"{screening.full_dataset.name}: {line}"
        for screening in screenings
        for line in (screening.time_note, left_out_line(screening))
        if line
    ]
    errors = [summary.reconstruction.p95 for summary in pooled.values()]
    if caution := why_held_out_not_trusted(screenings, errors):
        lines.append(f"Do not rely on this result: {caution}")
    recommendation = [f"Recommendation: {only.recommendation.text}"] if only else []
    finish(parsed.out, files, *lines, validation_answer(pooled), *recommendation)


def _is_calibrated(run: PairRun) -> bool:
    """Whether all frames give the files that `calibrate` writes."""
    with suppress(StereocalError):
        return bool(run.calibration)
    return False
