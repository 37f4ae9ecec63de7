"""The Validate page: choice of data and protocol, computation and results."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts, evaluate
from stereocal.evaluation.kept_fits import KeptFits, evaluate_with_kept_fits
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import Evaluation, unique_names
from stereocal.projects.project import Project
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.system.resources import ROOT
from stereocal.ui import jobs
from stereocal.ui.answer import wait_for_answer
from stereocal.ui.fields import Field, Number, choose, setting
from stereocal.ui.forms import ABOUT, ask, changed_settings, field_of, search_form, search_values
from stereocal.ui.intake import take_one
from stereocal.ui.messages import callback, readable, show_refusal
from stereocal.ui.refined import refine_settings
from stereocal.ui.screening import is_long, screenings_of
from stereocal.ui.texts import escape_markdown
from stereocal.workflow import usual_frames

NINETEEN = ROOT / "sample_data" / "nineteen"
MINE, ALL, PAPER = "My data set", "All my data sets", "Nineteen synthetic rigs"
RUNS = (10, 500)
"""Ends of the slider of the runs."""
FEWEST_FRAMES = 3
"""Bars of two points whose pose can be solved for: five points."""
STAGES = ("runs",)
INSTANT = 120
"""Runs of 25 frames that take under a second, and so are computed as the controls move."""
Runs = Sequence[Sequence[RunCounts]]
_read = cache(read_dataset)
_FITS = KeptFits()


def choose_data(project: Project, own: Dataset) -> list[Dataset]:
    """The data sets to validate on."""
    more = project.more_datasets
    kinds = [MINE, *([ALL] if more else []), *([PAPER] if NINETEEN.is_dir() else [])]
    choose(project, "validate_on", "Validate on", kinds, tabs_own=False)
    with st.expander(f"Further data sets to pool and compare ({len(more)} loaded)"):
        uploads = st.file_uploader(
            "Zips with dataset.json", type=["zip"], accept_multiple_files=True, key="upload_more"
        )
        for upload in uploads:
            take_one(upload, project.add_dataset)
        show_refusal()
        for dataset in more:
            st.markdown(f"- {escape_markdown(dataset.name)}")
        if more:
            st.button("Forget them", on_click=callback(project.drop_datasets), key="drop_more")
    return chosen_data(project, own)


def chosen_data(project: Project, own: Dataset) -> list[Dataset]:
    """The data sets to validate on, as last chosen."""
    kind = project.settings.get("validate_on", MINE)
    if kind == PAPER and NINETEEN.is_dir():
        return [_read(path) for path in sorted(NINETEEN.iterdir()) if path.is_dir()]
    return [own, *project.more_datasets] if kind == ALL else [own]


def choose_protocol(project: Project, datasets: Sequence[Dataset]) -> EvaluationSettings:
    """The form of the protocol: number of runs and of frames."""
    runs, frames, splits, bounds = _protocol_fields(project, datasets)
    left, right = st.columns(2)
    about = ABOUT["runs"]
    left.slider(about.title, *RUNS, step=10, help=about.help, **runs.widget())
    about = ABOUT["calibration_frames"]
    right.slider(about.title, *bounds, help=about.help, **frames.widget())
    ask(st.container(), ABOUT["splits"], splits)
    search_form(project)
    return kept_protocol(project, datasets)


def _protocol_fields(
    project: Project, datasets: Sequence[Dataset]
) -> tuple[Field, Field, Field, tuple[int, int]]:
    """Fields of runs, calibration frames and splits, and the bounds of the frames."""
    if not any(map(is_long, datasets)):
        screenings = screenings_of(datasets, CalibrationSettings.from_json(search_values(project)))
        datasets = [each.dataset for each in screenings]
    fewest = min(len(each.correspondences.frames) for each in datasets)
    most = max(fewest - 2, 2)
    bounds = min(FEWEST_FRAMES, most), most
    return (
        setting(project, "validate_runs", ABOUT["runs"].default, Number(*RUNS)),
        setting(project, "validate_frames", min(usual_frames(fewest), most), Number(*bounds)),
        field_of(project, "validate_splits", ABOUT["splits"]),
        bounds,
    )


def kept_protocol(project: Project, datasets: Sequence[Dataset]) -> EvaluationSettings:
    """The protocol in the form, also for pages that do not show it."""
    runs, frames, splits, _ = _protocol_fields(project, datasets)
    own = refine_settings(project, datasets[0])
    if len(datasets) > 1:
        own = RefineSettings(time_offset=own.time_offset, time_drift=own.time_drift)
    search = CalibrationSettings.from_json(search_values(project))
    return EvaluationSettings(search, runs.value(), frames.value(), splits.value(), own)


def without_refined(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> Evaluation | None:
    """The paper's methods alone, which take a tenth of the time.

    None if the last validation is current, if the work is long, or if it fails: then
    `update_validation` shows what there is.
    """
    last, own = last_validation(project, datasets, settings), replace(settings, refined=None)
    if is_current(last, datasets, settings) or not is_short(datasets, settings):
        return None
    if not is_current(last, datasets, own):
        try:
            kept = [each.dataset for each in screenings_of(datasets, settings.calibration)]
            # Kept at once: the next move of a slider may end this run before the refined sets come.
            _keep(project, datasets, own, evaluate(kept, own, jobs.pool()))
        except StereocalError:
            return None
    return _last(project)


def last_validation(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> Evaluation | None:
    """The last validation; that of the calibration instead, if it is what the form asks for.

    So that a look at other data sets leaves a calibrated project validated.
    """
    of_calibration = readable(lambda: project.calibration_evaluation, told=False)
    return of_calibration if is_current(of_calibration, datasets, settings) else _last(project)


def update_validation(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> None:
    """Compute short work at once; for long work show a button and progress."""
    last = last_validation(project, datasets, settings)
    current, short = is_current(last, datasets, settings), is_short(datasets, settings)
    if not (current or short) and wait_for_answer(project):
        return  # the press on Calibrate ends in a validation
    run = partial(_validate, project, datasets, settings)
    work = jobs.PageWork(project, "evaluation", STAGES, run)
    label = f"Validate ({settings.runs * len(datasets)} runs)"
    cancelled, stale = "Cancelled. What is shown is the last finished validation.", ""
    if last is not None and not current:
        stale = _since(last, datasets, settings)
    about_it = current, short, "Validating.", label, "validate", cancelled, stale
    jobs.bring_up_to_date(work, *about_it)


def _since(
    evaluation: Evaluation, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> str:
    """What has changed since a validation."""
    found = changed_settings(evaluation.settings.to_json(), settings.to_json())
    if not evaluation.is_of(datasets):
        found.insert(0, "data")
    return ", ".join(found)


def is_short(datasets: Sequence[Dataset], settings: EvaluationSettings) -> bool:
    """Whether a validation is computed as the controls move."""
    frames = sum(len(dataset.correspondences.frames) for dataset in datasets)
    return settings.runs * frames / 25 <= INSTANT


def _validate(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings, job: jobs.Job
) -> None:
    """Evaluate and store the result."""

    def yield_to_clicks(_done: int, _total: int) -> None:
        """Let a moved slider end this run: Streamlit looks for clicks where the session is read."""
        st.session_state.get("clicked")

    calibration = readable(lambda: project.calibration, told=False)
    kept = [each.dataset for each in screenings_of(datasets, settings.calibration, calibration)]
    runs: Runs
    if is_short(datasets, settings):  # while the page is drawn
        last, own = _last(project), replace(settings, refined=None)
        paper = last.runs if last is not None and is_current(last, datasets, own) else None
        runs = evaluate_with_kept_fits(kept, settings, job.executor, _FITS, yield_to_clicks, paper)
    else:
        runs = evaluate(kept, settings, job.executor, job.progress)
    _keep(project, datasets, settings, runs)


def _keep(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings, runs: Runs
) -> None:
    """Store a validation."""
    digests = [dataset.sha256 for dataset in datasets]
    project.keep_evaluation(Evaluation(runs, settings, unique_names(datasets), digests))


def _last(project: Project) -> Evaluation | None:
    """The last validation; None if damaged, so that it is computed again."""
    return readable(lambda: project.evaluation, told=False)


def is_current(
    evaluation: Evaluation | None, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> bool:
    """Whether an evaluation is of these data and settings."""
    return evaluation is not None and evaluation.settings == settings and evaluation.is_of(datasets)
