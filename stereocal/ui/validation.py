"""The Validate page: choice of data and protocol, and the job that follows them."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.growing import GrowingRuns, KeptFits
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import Evaluation, unique_names
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.system.made_from import changed
from stereocal.system.resources import ROOT
from stereocal.ui import jobs
from stereocal.ui.fields import Field, Number, choose, one_of, setting
from stereocal.ui.forms import ABOUT, ask, field_of, refine_settings, search_form, search_values
from stereocal.ui.intake import take_one
from stereocal.ui.messages import button, readable, show_refusal
from stereocal.ui.screening import is_long, screenings_of
from stereocal.ui.texts import escape_markdown
from stereocal.workflow.made_from import evaluation_parts, parts_of_evaluation
from stereocal.workflow.pair_run import usual_frames

NINETEEN = ROOT / "sample_data" / "nineteen"
MINE, ALL, PAPER = "My data set", "All my data sets", "Nineteen synthetic rigs"
ALL_PAIRS = "All pairs of cameras"
"""Each refined by itself, with the lenses of the rig."""
RUNS = (10, 500)
"""Ends of the slider of the runs."""
BIN_WIDTHS, USUAL_WIDTH = (0.02, 0.04, 0.1, 0.2, 0.5), 0.1
FEWEST_FRAMES = 3
"""Bars of two points whose pose can be solved for: five points."""
STAGES = ("runs",)
LONGEST_WAIT_S = 0.3
"""How long a page waits for runs."""
_read = cache(read_dataset)
_FITS = KeptFits()


def choose_data(project: Project, pair: Pair) -> list[Pair]:
    """The data sets to validate on."""
    kinds = [
        MINE,
        *([ALL_PAIRS] if project.pair and len(project.pair_names) > 1 else []),
        *([ALL] if project.more_datasets else []),
        *([PAPER] if NINETEEN.is_dir() else []),
    ]
    choose(project, "validate_on", "Validate on", kinds, tabs_own=False)
    return chosen_data(project, pair)


def more_data(project: Project) -> None:
    """Further data sets, to be given and forgotten."""
    more = project.more_datasets
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
            button("Forget them", "drop_more", project.drop_datasets)


def chosen_data(project: Project, pair: Pair) -> list[Pair]:
    """The data sets to validate on, as last chosen."""
    kind = project.settings.get("validate_on", MINE)
    if kind == PAPER and NINETEEN.is_dir():
        return [_read(path) for path in sorted(NINETEEN.iterdir()) if path.is_dir()]
    if kind == ALL_PAIRS and project.pair:
        pairs = [project.of_pair(name).dataset for name in project.pair_names]
        return [dataset for dataset in pairs if dataset is not None] or [pair]
    return [pair, *project.more_datasets] if kind == ALL else [pair]


def choose_protocol(project: Project, datasets: Sequence[Pair]) -> EvaluationSettings:
    """The settings that the paper varies: first step, acceptance ratio, frames; and the runs."""
    with project.database.reading():  # each of the fields reads its value several times
        runs, frames, splits = _protocol_fields(project, datasets)
        search_form(project)
        left, right = st.columns(2)
        spec = ABOUT["runs"]
        left.slider(spec.title, *RUNS, step=10, help=spec.help, **runs.widget())
        spec = ABOUT["calibration_frames"]
        frames.slider(spec.title, right, help=spec.help)
        return _protocol(project, datasets, runs, frames, splits)


def other_settings(project: Project) -> None:
    """The other settings of a validation, folded."""
    with st.expander("Other settings"):
        ask(st.container(), ABOUT["splits"], _splits(project))
        hint = "Of the curves, in decades. The overlap depends on it a little."
        st.select_slider("Width of the bins", BIN_WIDTHS, help=hint, **bin_width(project).widget())
        st.page_link("pages/calibrate.py", label="Other settings of the search")


def bin_width(project: Project) -> Field:
    """The width of the bins in decades."""
    return setting(project, "bin_width", USUAL_WIDTH, one_of(BIN_WIDTHS))


def _splits(project: Project) -> Field:
    return field_of(project, "validate_splits", ABOUT["splits"])


def _protocol_fields(project: Project, datasets: Sequence[Pair]) -> tuple[Field, Field, Field]:
    """Fields of runs, calibration frames and splits."""
    if not any(map(is_long, datasets)):
        search = CalibrationSettings.from_json(search_values(project))
        calibration = readable(lambda: project.calibration, warn=False)
        screenings = screenings_of(datasets, search, calibration)
        datasets = [screening.dataset for screening in screenings]
    fewest = min(len(dataset.correspondences.frames) for dataset in datasets)
    most = max(fewest - 2, 2)
    bounds = Number(min(FEWEST_FRAMES, most), most)
    return (
        setting(project, "validate_runs", ABOUT["runs"].default, Number(*RUNS)),
        setting(project, "validate_frames", min(usual_frames(fewest), most), bounds),
        _splits(project),
    )


def kept_protocol(project: Project, datasets: Sequence[Pair]) -> EvaluationSettings:
    """The protocol in the form, also for pages that do not show it."""
    return _protocol(project, datasets, *_protocol_fields(project, datasets))


def _protocol(
    project: Project, datasets: Sequence[Pair], runs: Field, frames: Field, splits: Field
) -> EvaluationSettings:
    refined = refine_settings(project, datasets[0])
    if len(datasets) > 1:
        refined = RefineSettings(time_offset=refined.time_offset, time_drift=refined.time_drift)
    search = CalibrationSettings.from_json(search_values(project))
    return EvaluationSettings(search, runs.value(), frames.value(), splits.value(), refined)


def current_validation(project: Project, datasets: Sequence[Pair]) -> Evaluation | None:
    """The kept validation of these data and of what the form asks for; None if there is none, or
    if it is damaged. That of the calibration is one, so that a look at other data sets leaves a
    project validated.
    """
    search = CalibrationSettings.from_json(search_values(project))
    for read in (lambda: project.calibration_evaluation, lambda: project.evaluation):
        evaluation = readable(read, warn=False)
        if evaluation is None:
            continue
        if changed_since(evaluation, datasets, replace(evaluation.settings, calibration=search)):
            continue  # nothing is screened to know how many frames the form asks for
        if not changed_since(evaluation, datasets, kept_protocol(project, datasets)):
            return evaluation
    return None


def follow_validation(
    project: Project, datasets: Sequence[Pair], settings: EvaluationSettings, refined: bool
) -> jobs.Job:
    """The job that validates with these settings, begun unless it runs.

    Returns once the first runs are there, or all if they come at once; what takes longer comes
    while one looks.

    Args:
        refined: whether the refined method is shown, and so waited for.
    """
    growing = GrowingRuns(len(datasets), settings)
    run = partial(_validate, project, datasets, settings, growing)
    parts = evaluation_parts([dataset.sha256 for dataset in datasets], settings)
    work = jobs.PageWork(project, "evaluation", STAGES, run, parts, growing, follows=True)
    job, begun = jobs.start(work), time.monotonic()
    while job.state == "running" and (waited := time.monotonic() - begun) < LONGEST_WAIT_S:
        all_in_time = job.done * LONGEST_WAIT_S >= waited * job.total
        if not all_in_time and any(job.work.so_far.so_far(refined)):
            break
        time.sleep(0.01)
    return job


def validation_so_far(
    job: jobs.Job, datasets: Sequence[Pair], refined: bool
) -> tuple[Evaluation, int] | None:
    """What a job has found, and of how many runs it is a part; None before the first run.

    Args:
        refined: whether the refined method is shown.
    """
    growing: GrowingRuns = job.work.so_far
    by_dataset = zip(datasets, unique_names(datasets), growing.so_far(refined), strict=True)
    begun = [(runs, name, dataset.sha256) for dataset, name, runs in by_dataset if runs]
    if not begun:
        return None
    runs, names, digests = zip(*begun, strict=True)
    return Evaluation(runs, growing.settings, names, digests), growing.total


def changed_since(
    evaluation: Evaluation, datasets: Sequence[Pair], settings: EvaluationSettings
) -> str:
    """What has changed since a validation."""
    now = evaluation_parts([dataset.sha256 for dataset in datasets], settings)
    return changed(parts_of_evaluation(evaluation), now)


def _validate(
    project: Project,
    datasets: Sequence[Pair],
    settings: EvaluationSettings,
    growing: GrowingRuns,
    job: jobs.Job,
) -> None:
    """Evaluate, and store the result when it is whole."""
    calibration = readable(lambda: project.calibration, warn=False)
    screenings = screenings_of(datasets, settings.calibration, calibration)
    screened = [screening.dataset for screening in screenings]
    runs = growing.compute(screened, job.executor, _FITS, job.progress)
    job.progress(job.total, job.total)  # ends here if the settings have changed meanwhile
    digests = [dataset.sha256 for dataset in datasets]
    project.keep_evaluation(Evaluation(runs, settings, unique_names(datasets), digests))
