"""Results of the Validate page: answer, figure, downloads, table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import Method
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.summary import MethodSummary, summarise_all
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.report import report_html
from stereocal.figures.tables import validation_table
from stereocal.figures.validation import describe_validation, note_on_intervals, plot_validation
from stereocal.fit.screening.screen import Screening
from stereocal.formats.evaluation_files import Evaluation, summary_json
from stereocal.projects.project import Project
from stereocal.rig.lengths_in_words import as_held
from stereocal.rig.pair import Pair
from stereocal.system import latest
from stereocal.system.latest import once
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, setting, yes_or_no
from stereocal.ui.figure import is_narrow, show_figure
from stereocal.ui.forms import describe_settings
from stereocal.ui.messages import button, fragment, readable, show_stale
from stereocal.ui.press import final_answer
from stereocal.ui.screening import screenings_of
from stereocal.ui.texts import escape_markdown
from stereocal.ui.validation import (
    USUAL_WIDTH,
    bin_width,
    changed_since,
    current_validation,
    follow_validation,
    validation_so_far,
)
from stereocal.verdict.further_recording import note_on_splits
from stereocal.verdict.in_words import left_out_line, why_held_out_not_trusted
from stereocal.verdict.validation_in_words import validation_answer

COLUMNS = {
    "residual": "Residual",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}
FORMATS = ("SVG", "PNG")
FCP = (
    "Where the curves of correct and wrong pairs overlap, a wrong pair looks right: the overlap is "
    "the false correspondence probability (FCP)."
)
EVERY_S = 0.5
"""Between two looks at a job."""
Summaries = dict[Method, MethodSummary]


def with_refined(project: Project) -> Field:
    """Whether the figure has a row of the refined method: where that is to be used, or chosen."""
    usual = "refined" in (project.recommended or ())
    return setting(project, "with_refined", usual, yes_or_no, tabs_own=True)


@dataclass(frozen=True)
class Places:
    """Where parts of a validation stand that are not with its figure.

    Each an `st.empty`: a part of a page that is redrawn alone adds to any other container.
    """

    answer: DeltaGenerator
    table: DeltaGenerator


def show_validation(
    project: Project, datasets: Sequence[Pair], settings: EvaluationSettings, places: Places
) -> None:
    """The validation of these settings: the first runs at once, the others as they come."""
    last, job = current_validation(project, datasets), None
    if last is None:
        job = follow_validation(project, datasets, settings, with_refined(project).value())
        if job.state == "done":
            last, job = current_validation(project, datasets), None
        else:
            last = readable(lambda: project.evaluation, warn=False)
    # Only while runs come: a permanent timer would interrupt every longer run of the page.
    every = EVERY_S if job is not None and job.state == "running" else None
    running = every is not None
    fragment(_show, run_every=every)(project, datasets, settings, places, last, job, running)


def _show(
    project: Project,
    datasets: Sequence[Pair],
    settings: EvaluationSettings,
    places: Places,
    last: Evaluation | None,
    job: jobs.Job | None,
    running: bool,
) -> None:
    """What there is: the whole validation, runs of a job, or the last validation."""
    head, shown = places.answer.container(), None
    if job is not None:
        if running and job.state != "running":
            st.rerun()
        if job.state == "failed":
            st.error(escape_markdown(job.sentence))
            button("Try again", "validate", jobs.abandon, project, "evaluation")
        elif (shown := _so_far(job, datasets, with_refined(project).value())) is None:
            head.info("The first runs are on their way.")
    if shown is None and last is not None:
        if job is not None:
            with head:
                show_stale(changed_since(last, datasets, settings))
        shown = Shown(last, last.digest, "")
    if shown is not None:
        _show_evaluation(project, shown, datasets, head, places.table)


@dataclass(frozen=True)
class Shown:
    """A validation as it is shown."""

    evaluation: Evaluation
    key: str
    """Identifies what is made of it, in memory."""
    so_far: str
    """How many of its runs there are, while they come; empty if all."""

    @property
    def runs(self) -> int:
        """Their number."""
        return sum(map(len, self.evaluation.runs))


def _so_far(job: jobs.Job, datasets: Sequence[Pair], refined: bool) -> Shown | None:
    """The runs of a job; None before the first.

    As shown before until there are half as many more: the figure takes as long as some runs.
    """
    key = f"{job.work.digest} {refined} shown"
    before: Shown | None = latest.get("validation shown", key)
    runs_found = validation_so_far(job, datasets, refined)
    if runs_found is None:
        return before
    evaluation, total = runs_found
    count = sum(map(len, evaluation.runs))
    if before is not None and before.runs <= count < min(1.5 * before.runs, total):
        return before
    all_runs = f"{total} runs{', not yet all refined' * refined}"
    words = f"{count} of {total} runs" if count < total else all_runs
    shown = Shown(evaluation, f"{job.work.digest} {refined} {count}", words)
    latest.keep("validation shown", key, shown)
    return shown


def _summaries(
    shown: Shown, bin_width: float, refined: bool
) -> tuple[Summaries, dict[str, Summaries]]:
    """Pooled and by data set."""
    evaluation = shown.evaluation

    def make() -> tuple[Summaries, dict[str, Summaries]]:
        if bin_width == USUAL_WIDTH and len(evaluation.names) == 1:
            pooled = evaluation.summaries  # made once for all pages
            return pooled, {evaluation.names[0]: pooled}
        return summarise_all(evaluation.names, evaluation.runs, bin_width)

    def chosen(summaries: Summaries) -> Summaries:
        return {m: s for m, s in summaries.items() if refined or m != "refined"}

    pooled, by_dataset = once("validation shown", f"{shown.key} {bin_width}", make)
    return chosen(pooled), {name: chosen(summaries) for name, summaries in by_dataset.items()}


def _note(evaluation: Evaluation, screening: Screening) -> str:
    """Whether single frames and whole runs left out give different figures."""
    key = f"{evaluation.digest} note"
    if (note := latest.get("validation shown", key)) is None:
        settings, summaries = evaluation.settings, evaluation.summaries
        with st.spinner("Leaving out the other way."):
            note = jobs.compute(note_on_splits, screening.dataset, settings, summaries)
        latest.keep("validation shown", key, note)
    return str(note)


def _show_evaluation(
    project: Project,
    shown: Shown,
    datasets: Sequence[Pair],
    head: DeltaGenerator,
    table: DeltaGenerator,
) -> None:
    """Answer and figure; of a whole validation also downloads and table.

    Args:
        datasets: what the form says now.
        head, table: where the answer and the table stand.
    """
    evaluation, whole = shown.evaluation, not shown.so_far
    bins, refined = bin_width(project).value(), with_refined(project)
    pooled, by_dataset = _summaries(shown, bins, refined.value())
    screenings = _screenings(project, evaluation, datasets)
    with head:
        _show_answer(pooled, screenings)
        with st.container(key="runs_so_far" if shown.so_far else "runs_all"):
            st.caption(f"**{shown.so_far or f'{shown.runs} runs'}**")
    columns, picture = _choose_view(project, refined)
    st.caption(" ".join([*[FCP] * (columns != ["reconstruction"]), note_on_intervals(pooled)]))
    charts = {"validation": columns}
    if is_narrow() and len(columns) > 1:
        charts = {f"validation_{column}": [column] for column in columns}
    for name, parts in charts.items():
        key = f"{shown.key} {bins} {refined.value()} {parts}"
        figure = once("validation shown", key, partial(plot_validation, pooled, parts))
        words, config = describe_validation(pooled, parts), _saved_as(picture, name)
        show_figure(figure, words, name, config=config)
    of_files = readable(lambda: project.calibration_evaluation)
    if of_files is not None and not (whole and of_files.digest == evaluation.digest):
        why = "The parameter files keep the threshold and the figures of their own validation"
        st.caption(f"{why}: {_describe_protocol(of_files)}")
    if not whole:
        return
    if len(screenings) == 1 and (note := _note(evaluation, screenings[0])):
        st.info(escape_markdown(note))
    if len(evaluation.names) > 1:
        st.subheader("Data set by data set")
        words, config = describe_comparison(by_dataset), _saved_as(picture, "comparison")
        show_figure(plot_comparison(by_dataset), words, "comparison", config=config)
    st.caption(f"Made with: {_describe_protocol(evaluation)}")
    if screenings:
        _downloads(project, screenings, evaluation, pooled, by_dataset)
    with table.expander("Figures as a table"):
        st.table(validation_table(pooled))


def _choose_view(project: Project, refined: Field) -> tuple[list[str], str]:
    panels = ["All three", *COLUMNS.values()]
    with st.container(
        horizontal=True, vertical_alignment="bottom", horizontal_alignment="distribute"
    ):
        wide = choose(project, "columns", "Show", panels)
        hint = "One set, fitted to images and lengths at once. The paper has the other three."
        st.toggle("With the refined method", help=hint, **refined.widget())
        title, hint = "Save pictures as", "The camera at the top right of a figure saves it."
        picture = choose(project, "picture_format", title, FORMATS, help=hint)
    return [key for key, title in COLUMNS.items() if wide in ("All three", title)], picture


def _saved_as(picture: str, name: str) -> dict[str, Any]:
    """Plotly's options for a button that saves a figure in the browser, as it is seen."""
    return {
        "displayModeBar": True,
        "modeBarButtons": [["toImage"]],
        "toImageButtonOptions": {"format": picture.lower(), "filename": name, "scale": 2},
    }


def _screenings(
    project: Project, evaluation: Evaluation, datasets: Sequence[Pair]
) -> list[Screening]:
    """The screenings of the validated data sets; empty if one was removed."""
    used = {dataset.sha256: dataset for dataset in datasets}
    if not used.keys() >= {*evaluation.sha256}:
        return []
    validated = [used[digest] for digest in evaluation.sha256]
    calibration = readable(lambda: project.calibration)
    return screenings_of(validated, evaluation.settings.calibration, calibration)


def _show_answer(
    summaries: Mapping[Method, MethodSummary], screenings: Sequence[Screening]
) -> None:
    """The answer; green only if it is reliable."""
    for screening in screenings:
        if screening.time_note:
            st.info(escape_markdown(screening.time_note))
        if screening.left_out and len(screenings) > 1:  # of one, Calibrate names them
            line = f"{screening.full_dataset.name}: {left_out_line(screening)}"
            st.warning(escape_markdown(line))
    errors = [summary.reconstruction.p95 for summary in summaries.values()]
    if caution := why_held_out_not_trusted(screenings, errors):
        st.error(escape_markdown(f"Do not rely on this result: {caution}"))
    answer = validation_answer(summaries)
    if len(screenings) == 1:
        answer = as_held(answer, screenings[0].dataset)
    (st.info if caution else st.success)(answer)


def _describe_protocol(evaluation: Evaluation) -> str:
    settings, names = evaluation.settings, evaluation.names
    named = escape_markdown(", ".join(names[:3])) + " and more" * (len(names) > 3)
    return (
        f"{named}; {settings.runs} runs, {settings.calibration_frames} calibration frames, "
        f"{describe_settings(settings.calibration)}."
    )


def _downloads(
    project: Project,
    screenings: Sequence[Screening],
    evaluation: Evaluation,
    pooled: Summaries,
    by_dataset: dict[str, Summaries],
) -> None:
    left, right = st.columns(2)
    datasets = [screening.full_dataset for screening in screenings]
    settings = evaluation.settings
    # With the answer of Calibrate, if that is of the same data and final.
    answer = final_answer(project)

    def report() -> str:
        recommended = None
        if answer is not None and evaluation.is_of([answer.run.dataset]):
            recommended = answer.run.calibration, answer.recommendation
        return report_html(pooled, by_dataset, datasets, settings, screenings, recommended)

    offer("Download report.html", report, "report.html", "download_report", place=left)
    summary = summary_json(pooled, by_dataset, datasets, settings, screenings)
    offer("Download summary.json", summary, "summary.json", "download_summary", place=right)
