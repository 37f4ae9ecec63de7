"""The Validate page: choice of data and protocol, computation and results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.evaluation.summary import MethodSummary, summarise_all
from stereocal.figures import (
    describe_comparison,
    describe_validation,
    plot_comparison,
    plot_validation,
)
from stereocal.figures.report import report_html
from stereocal.figures.tables import validation_answer, validation_table
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import (
    Evaluation,
    pack_runs,
    summary_json,
    unique_names,
    unpack_runs,
)
from stereocal.projects.project import Project
from stereocal.refined.screening import Screening
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.ui import jobs
from stereocal.ui.downloads import on_demand
from stereocal.ui.fields import Field, number, one_of, setting, yes_or_no
from stereocal.ui.figure import show_figure
from stereocal.ui.forms import search_form, search_values, settings_of
from stereocal.ui.intake import check_uploads, escape_markdown, is_new, taking
from stereocal.ui.messages import callback
from stereocal.ui.refined import refine_settings
from stereocal.ui.screening import screenings_of
from stereocal.verdict.in_words import left_out_line, why_validation_not_trusted
from stereocal.workflow import usual_frames

NINETEEN = Path(__file__).parents[2] / "sample_data" / "nineteen"
MINE, ALL, PAPER = "My data set", "All my data sets", "Nineteen synthetic rigs"
STAGES = ("runs",)
BIN_WIDTHS = (0.02, 0.04, 0.1, 0.2, 0.5)
INSTANT = 120
"""Runs of 25 frames that take under a second, and so are computed as the controls move."""
SCROLLS = """<style>
.st-key-scrolls { overflow-x: auto; }
.st-key-scrolls > div { min-width: 54rem; }
</style>"""
"""On a narrow screen the three panels scroll sideways."""
COLUMNS = {
    "residual": "Residual",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}


def choose_data(project: Project, own: Dataset) -> list[Dataset]:
    """The data sets to validate on."""
    more = project.more_datasets
    kinds = [MINE, *([ALL] if more else []), *([PAPER] if NINETEEN.is_dir() else [])]
    chosen = setting(project, "validate_on", MINE, one_of(kinds))
    kind = st.segmented_control("Validate on", kinds, required=True, **chosen.widget())
    with st.expander(f"Further data sets to pool and compare ({len(more)} loaded)"):
        _further(project, more)
    if kind == PAPER:
        return _nineteen()
    return [own, *more] if kind == ALL else [own]


@cache
def _nineteen() -> list[Dataset]:
    return [read_dataset(path) for path in sorted(NINETEEN.iterdir()) if path.is_dir()]


@lru_cache(maxsize=8)
def _summaries(evaluation: Evaluation, bin_width: float) -> Any:
    """Pooled and by data set; of one object, which a project gives for one content."""
    return summarise_all(evaluation.names, evaluation.runs, bin_width)


def choose_protocol(project: Project, datasets: Sequence[Dataset]) -> EvaluationSettings:
    """The form of the protocol: number of runs and of frames.

    Raises:
        StereocalError: settings that contradict each other.
    """
    runs, frames, most = _protocol_fields(project, datasets)
    left, right = st.columns(2)
    left.slider(
        "Runs", 10, 500, step=10, help="How often frames are drawn again. Paper: 100.",
        **runs.widget(),
    )  # fmt: skip
    right.slider(
        "Frames to calibrate with; the others test", 1, most, help="Paper: 20 of 25.",
        **frames.widget(),
    )  # fmt: skip
    search_form(project)
    return kept_protocol(project, datasets)


def _protocol_fields(project: Project, datasets: Sequence[Dataset]) -> tuple[Field, Field, int]:
    """Fields of the runs and of the frames to calibrate with, and the maximum of the latter."""
    screenings = screenings_of(datasets, settings_of(search_values(project)))
    fewest = min(len(each.dataset.correspondences.frames) for each in screenings)
    most = max(fewest - 2, 2)
    return (
        setting(project, "validate_runs", 100, number(10, 500)),
        setting(project, "validate_frames", min(usual_frames(fewest), most), number(1, most)),
        most,
    )


def kept_protocol(project: Project, datasets: Sequence[Dataset]) -> EvaluationSettings:
    """The protocol in the form, also for pages that do not show it.

    Raises:
        StereocalError: settings that contradict each other.
    """
    runs, frames, _ = _protocol_fields(project, datasets)
    return EvaluationSettings(
        settings_of(search_values(project)),
        runs.value(),
        frames.value(),
        refine_settings(project, datasets[0]) if len(datasets) == 1 else RefineSettings(),
    )


def bring_up_to_date(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> None:
    """Compute short work at once; for long work show a button and progress."""
    work = _work(project, datasets, settings)
    if _is_current(_last(project), datasets, settings):
        jobs.discard_finished(work)
    else:
        frames = sum(len(dataset.correspondences.frames) for dataset in datasets)
        if settings.runs * frames / 25 <= INSTANT:
            try:
                with st.spinner("Validating."):
                    _validate(project, datasets, settings, jobs.on_page(STAGES))
            except StereocalError as error:
                st.error(escape_markdown(str(error)))
        elif not (jobs.is_running(project, "evaluation") or jobs.can_go_on(work)):
            label = f"Validate ({settings.runs * len(datasets)} runs)"
            st.button(label, type="primary", key="validate", on_click=jobs.start, args=(work,))
    last = "Cancelled. What is shown is the last finished validation."
    jobs.show_job(project, "evaluation", last, work)


def _work(project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings) -> jobs.Work:
    about = {
        "datasets": [
            [one.sha256, one.baseline_sigma_m, one.target_distance_sigma_m] for one in datasets
        ],
        "settings": settings.to_json(),
    }
    return jobs.Work(
        project, "evaluation", STAGES, about,
        lambda job: _validate(project, datasets, settings, job),
    )  # fmt: skip


def _validate(
    project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings, job: jobs.Job
) -> bool:
    """Evaluate and store the result; False if cancelled."""
    kept = [screening.dataset for screening in screenings_of(datasets, settings.calibration)]
    runs = evaluate(
        kept, settings, job.executor, job.progress, lambda: job.cancelled,
        pieces=job.checkpoints("runs", pack_runs, unpack_runs),
    )  # fmt: skip
    if runs is None:
        return False
    digests = [dataset.sha256 for dataset in datasets]
    project.keep_evaluation(Evaluation(runs, settings, unique_names(datasets), digests))
    return True


def show_evaluation(
    project: Project,
    evaluation: Evaluation,
    datasets: Sequence[Dataset],
    settings: EvaluationSettings,
) -> None:
    """Answer, figure, table and downloads of the last finished evaluation."""
    if not _is_current(evaluation, datasets, settings):
        st.warning(
            "The form or the data have changed since this validation. It was computed "
            f"with: {describe_protocol(evaluation)}"
        )
    bins = setting(project, "bin_width", 0.1, one_of(BIN_WIDTHS))
    pooled, by_dataset = _summaries(evaluation, bins.value())
    refined = setting(project, "with_refined", True, yes_or_no, tabs_own=True)
    if not st.toggle(
        "With the refined method", **refined.widget(),
        help="One set, fitted to images and lengths at once. The paper has the other three.",
    ):  # fmt: skip
        pooled.pop("refined", None)
        for own in by_dataset.values():
            own.pop("refined", None)
    screenings = _screenings(evaluation, datasets)
    _show_answer(pooled, screenings)
    panels = ["All three", *COLUMNS.values()]
    shown = setting(project, "columns", panels[0], one_of(panels), tabs_own=True)
    wide = st.segmented_control("Show", panels, required=True, **shown.widget())
    columns = [key for key, title in COLUMNS.items() if wide in ("All three", title)]
    if len(columns) > 1:
        st.html(SCROLLS)
    with st.container(key="scrolls" if len(columns) > 1 else "fits"):
        st.plotly_chart(plot_validation(pooled, columns), key="validation")
    st.caption(escape_markdown(describe_validation(pooled)))
    st.select_slider(
        "Width of the bins (decades)", BIN_WIDTHS, help="The overlap depends on it a little.",
        **bins.widget(),
    )  # fmt: skip
    st.table(validation_table(pooled))
    if len(evaluation.names) > 1:
        st.subheader("Data set by data set")
        show_figure(plot_comparison(by_dataset), describe_comparison(by_dataset), "comparison")
    if screenings:
        _downloads(screenings, evaluation, pooled, by_dataset)
    st.caption(f"Made with: {describe_protocol(evaluation)}")


def _screenings(evaluation: Evaluation, datasets: Sequence[Dataset]) -> list[Screening]:
    """The screenings of the validated data sets; empty if one was removed."""
    used = {dataset.sha256: dataset for dataset in datasets}
    if not all(digest in used for digest in evaluation.sha256):
        return []
    validated = [used[digest] for digest in evaluation.sha256]
    return screenings_of(validated, evaluation.settings.calibration)


def _show_answer(
    summaries: Mapping[Method, MethodSummary], screenings: Sequence[Screening]
) -> None:
    """The answer; green only if it is reliable."""
    for screening in screenings:
        if screening.left_out:
            line = f"{screening.full_dataset.name}: {left_out_line(screening)}"
            st.warning(escape_markdown(line))
    caution = why_validation_not_trusted(summaries, screenings)
    if caution:
        st.error(escape_markdown(f"Do not rely on this result: {caution}"))
    (st.info if caution else st.success)(validation_answer(summaries))


def describe_protocol(evaluation: Evaluation) -> str:
    """Data and settings of an evaluation in one line."""
    settings = evaluation.settings
    search = settings.calibration.search
    return (
        f"{escape_markdown(', '.join(evaluation.names[:3]))}"
        f"{' and more' if len(evaluation.names) > 3 else ''}; {settings.runs} runs, "
        f"{settings.calibration_frames} calibration frames, Δ {search.delta:g}, Δ min "
        f"{search.delta_min:g}, acceptance ratio {search.acceptance:g}, shrink factor "
        f"{search.shrink:g}, minimum moves {search.minimum_moves}, seed {search.seed}, "
        f"essential solver {settings.calibration.essential}."
    )


def _downloads(
    screenings: Sequence[Screening], evaluation: Evaluation, pooled: Any, by_dataset: Any
) -> None:
    left, right = st.columns(2)
    about = ([each.full_dataset for each in screenings], evaluation.settings, screenings)
    report = partial(report_html, pooled, by_dataset, *about)
    left.download_button(
        "Download report.html", on_demand(report, "report.html", "text/html"), "report.html",
        "text/html", on_click="ignore", icon=":material/download:", key="download_report",
    )  # fmt: skip
    right.download_button(
        "Download summary.json", summary_json(pooled, by_dataset, *about),
        "summary.json", "application/json", on_click="ignore", icon=":material/download:",
        key="download_summary",
    )  # fmt: skip


def _further(project: Project, more: Sequence[Dataset]) -> None:
    uploads = st.file_uploader(
        "Zips with dataset.json", type=["zip"], accept_multiple_files=True, key="upload_more"
    )
    for upload in uploads:
        if not is_new(upload):
            continue
        with taking(upload):
            try:
                check_uploads([upload])
                content = upload.getvalue()
                project.add_dataset(upload.name, content)
            except StereocalError as error:
                st.error(escape_markdown(str(error)))
                continue
        st.rerun()
    for dataset in more:
        st.markdown(f"- {escape_markdown(dataset.name)}")
    if more:
        st.button("Forget them", on_click=callback(project.drop_datasets), key="drop_more")


def _last(project: Project) -> Evaluation | None:
    """The last validation; None if damaged, so that it is computed again."""
    try:
        return project.evaluation
    except StereocalError:
        return None


def _is_current(
    evaluation: Evaluation | None, datasets: Sequence[Dataset], settings: EvaluationSettings
) -> bool:
    return (
        evaluation is not None
        and evaluation.settings == settings
        and list(evaluation.sha256) == [dataset.sha256 for dataset in datasets]
    )
