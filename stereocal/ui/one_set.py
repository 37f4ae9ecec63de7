"""The page One set or two: verdict, what disagrees, trade-off, accuracy, parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import count_set
from stereocal.evaluation.summary import figures_of_set
from stereocal.figures import (
    describe_accuracy,
    describe_disagreement,
    describe_trade_off,
    plot_accuracy,
    plot_disagreement,
    plot_trade_off,
)
from stereocal.figures.accuracy import Quantity
from stereocal.figures.style import count
from stereocal.figures.tables import parameters_table, refined_table
from stereocal.formats.evaluation_files import Evaluation, validation_figures
from stereocal.projects.project import Project
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening
from stereocal.refined.stated_inputs import Input, undetectable_errors
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.ui.fields import number, one_of, setting, yes_or_no
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import escape_markdown
from stereocal.ui.refined import calibrated, curves_of, inputs_of, map_of
from stereocal.ui.validation import kept_protocol
from stereocal.verdict.forecast import Outlook
from stereocal.verdict.in_words import digits, left_out_line, percent, why_validation_not_trusted
from stereocal.verdict.tradeoff import TradeOff, costs_of

FIXED, FREED = "As given", "Freed"
MOST_NAMED = 12
"""Maximum number of left-out frames listed on the page."""


def show_verdict(
    screening: Screening, evaluation: Evaluation | None, outlook: Outlook | None
) -> None:
    """The verdict of the forecast; green if it decides and may be relied on.

    Args:
        screening: of the data set; the forecast and the runs leave out the same frames.
        evaluation: the last validation, for its warning if it is of these data.
        outlook: the forecast of all files.
    """
    dataset = screening.full_dataset
    if outlook is None:
        st.info("There are too few bars with both targets for a forecast: record at least 3.")
        return
    of_these = evaluation is not None and list(evaluation.sha256) == [dataset.sha256]
    answer = outlook.verdict
    caution = (
        why_validation_not_trusted(evaluation.summaries, [screening])
        if evaluation is not None and of_these
        else ""
    )
    if caution:
        st.error(escape_markdown(f"Do not rely on this result: {caution}"))
    (st.info if caution or answer.kind == "level" else st.success)(answer.text)
    if answer.check is not None and answer.check.holds:
        st.caption(escape_markdown(answer.check.text))
    st.caption(escape_markdown(outlook.advice))


def show_disagreement(inputs: list[Input]) -> None:
    """Which input values the images contradict."""
    accused = [item for item in inputs if item.accused]
    for item in accused:
        st.warning(escape_markdown(item.advice))
    unknown = undetectable_errors(inputs)
    if unknown:
        st.info(escape_markdown(unknown))
        st.page_link("pages/data.py", label="State it on the Data page")
    elif inputs and not accused:
        st.success("Nothing that was typed or measured disagrees with the images.")
    show_figure(plot_disagreement(inputs), describe_disagreement(inputs), "disagreement")


def show_frames_left_out(screening: Screening, result: RefinedResult) -> None:
    """The frames that contradict the others, and those that only the refined set left out."""
    if screening.left_out:
        st.warning(escape_markdown(left_out_line(screening)))
    left_out = result.outlying_frames
    if not left_out and screening.left_out:
        return
    if not left_out:
        st.markdown(f"All {len(result.frames)} frames fit; none was left out.")
        return
    named = [f"{frame} ({digits(100 * part, 2)} %)" for frame, part in left_out.items()]
    more = f" and {len(named) - MOST_NAMED} more, all named in the file" * (len(named) > MOST_NAMED)
    st.warning(
        f"Left out of the refined set, because they do not fit: {count(len(named), 'frame')} of "
        f"{len(result.frames)}, in brackets their share of chi-square: "
        f"{', '.join(named[:MOST_NAMED])}{more}. Look at "
        "them on the Data page."
    )


@st.fragment  # the slider redraws this part only
def show_trade_off(
    project: Project,
    dataset: Dataset,
    result: RefinedResult,
    settings: RefineSettings,
    calibration: Calibration | None,
) -> None:
    """The trade-off curve with all methods, and one point of it to inspect and download."""
    try:
        _show_trade_off(project, dataset, result, settings, calibration)
    except StereocalError as error:  # for example a bad frame that the refined set leaves out
        st.info(f"There is no trade-off to show. {escape_markdown(str(error))}")


def _show_trade_off(
    project: Project,
    dataset: Dataset,
    result: RefinedResult,
    settings: RefineSettings,
    calibration: Calibration | None,
) -> None:
    curves = curves_of(dataset, settings)
    if calibration is None or calibration.screening.dataset.sha256 != dataset.sha256:
        calibration = calibrated(dataset, kept_protocol(project, [dataset]).calibration)
    sets: dict[Method, tuple[Pose, Camera, Camera]] = {
        "refined": (result.pose, result.primary, result.secondary)
    }
    for method, found in calibration.methods.items():
        sets[method] = (found.pose, dataset.primary, dataset.secondary)
    costs = costs_of(dataset, sets)
    curve = setting(project, "curve", FREED, one_of((FREED, FIXED)))
    along = setting(project, "along", 50, number(0, 100))
    left, right = st.columns(2)
    which = left.segmented_control("Lenses", [FREED, FIXED], required=True, **curve.widget())
    share = right.slider("From matching (0) to measuring (100)", 0, 100, **along.widget())
    points = _points(curves, which)
    chosen = points[round(share / 100 * (len(points) - 1))]
    show_figure(
        plot_trade_off(curves, costs, chosen), describe_trade_off(curves, costs), "trade_off"
    )
    own = chosen.parameters(dataset)
    fcp, median = figures_of_set(count_set(own_view(dataset, own.primary, own.secondary), own.pose))
    st.markdown(
        f"At the slider's point: wrong pairs that look right (FCP) **{percent(fcp)} %**, 3D error "
        f"(median) **{percent(median)} %**, on the frames it was fitted to."
    )
    with st.expander("Its parameters"):
        st.table(parameters_table(own))
    st.download_button(
        "Download the slider's point", own.dumps(), "parameters_refined_point.json",
        "application/json", on_click="ignore", icon=":material/download:", key="download_point",
    )  # fmt: skip


def _points(curves: TradeOff, which: str | None) -> Any:
    return curves.fixed if which == FIXED else curves.freed


def own_view(dataset: Dataset, primary: Camera, secondary: Camera) -> Dataset:
    """The data set seen through other lenses."""
    return replace(dataset, primary=primary, secondary=secondary)


def show_accuracy(
    project: Project, result: RefinedResult, dataset: Dataset, settings: RefineSettings
) -> None:
    """A map of the rig's accuracy."""
    kinds = ("a distance", "a point")
    of = setting(project, "accuracy_of", kinds[0], one_of(kinds), tabs_own=True)
    shown = st.segmented_control("Predicted error of", kinds, required=True, **of.widget())
    quantity: Quantity = "point" if shown == "a point" else "distance"
    found = map_of(dataset, settings)
    show_figure(
        plot_accuracy(found, result, quantity), describe_accuracy(found, quantity), "accuracy"
    )


def show_parameters(
    project: Project,
    screening: Screening,
    result: RefinedResult,
    inputs: list[Input],
    evaluation: Evaluation | None,
    outlook: Outlook | None,
) -> None:
    """The refined set: table, download, and what to use it for."""
    st.table(refined_table(result))
    st.caption(
        f"Noise of an image point {digits(result.sigma_px.value)} px "
        f"({result.sigma_px.source}); scatter of the bar's length "
        f"{digits(1000 * result.scatter_m.value)} mm ({result.scatter_m.source})."
    )
    figures: dict[str, dict[str, Any]] = {}
    if evaluation is not None and list(evaluation.sha256) == [screening.full_dataset.sha256]:
        figures = validation_figures(evaluation.summaries, evaluation.settings)
    forecasts = outlook.of_files(figures) if outlook else {}
    content = refined_parameters(
        result, inputs, figures.get("refined"), screening.left_out, forecasts.get("refined")
    ).dumps()
    st.download_button(
        "Download parameters_refined.json", content, "parameters_refined.json",
        "application/json", on_click="ignore", type="primary", icon=":material/download:",
        key="download_refined",
    )  # fmt: skip
    for key, job in (("refined_2d", "match"), ("refined_3d", "measure")):
        st.toggle(
            f"Also {job} with the refined set", **setting(project, key, False, yes_or_no).widget(),
            help="The download on the Calibrate page is then the refined set.",
        )  # fmt: skip


def refined_inputs(dataset: Dataset, settings: RefineSettings) -> list[Input]:
    """Which inputs disagree; empty if the test fails."""
    try:
        return inputs_of(dataset, settings)
    except StereocalError:
        return []
