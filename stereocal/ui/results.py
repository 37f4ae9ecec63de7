"""The result on the Calibrate page: recommendation, figures, downloads, and closer looks."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go
import streamlit as st

from stereocal.calibration.methods import ALL_METHODS, METHOD_NAMES
from stereocal.figures import (
    describe_frame_errors,
    describe_rig,
    describe_traces,
    plot_frame_errors,
    plot_rig,
    plot_traces,
)
from stereocal.figures.forecast_table import forecast_table
from stereocal.figures.rig import VIEWS
from stereocal.figures.tables import angles_table, errors_table
from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.project import Project
from stereocal.rig.dataset import Dataset
from stereocal.system.zip_files import pack_zip
from stereocal.ui.fields import one_of, setting
from stereocal.ui.parameter_files import other_formats, parameter_downloads
from stereocal.ui.refined import replaced_by_refined
from stereocal.ui.screening import show_left_out
from stereocal.ui.status import describe_settings
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import digits, interval, percent
from stereocal.verdict.recommendation import Figure, Recommendation
from stereocal.workflow import Answer


def show_result(project: Project, answer: Answer) -> None:
    """Recommendation, tiles, downloads, the rig, and one closer look at a time."""
    for warning in answer.calibration.warnings:
        st.warning(escape_markdown(warning))
    show_recommendation(answer.recommendation)
    show_left_out(project, answer.calibration)
    show_tiles(answer)
    parameter_downloads(answer.sets, replaced_by_refined(project))
    _show_rig(project, answer)
    _show_views(project, answer)


def show_recommendation(recommendation: Recommendation) -> None:
    """What to use; green if it may be relied on."""
    if recommendation.caution:
        st.error(escape_markdown(f"Do not rely on this result: {recommendation.caution}"))
    first, *others = map(escape_markdown, recommendation.sentences)
    sound = recommendation.forecast_holds and not recommendation.caution
    (st.success if sound else st.info)("\n\n".join([f"**{first}**", *others]))


def show_tiles(answer: Answer) -> None:
    """Wrong pairs let in, length error, and threshold: forecast and held out."""
    found = answer.recommendation
    wrong, lengths, threshold = st.columns(3)
    match = found.match
    counted = f" of {match.wrong_pairs:,} wrong pairs"
    none = "none" + counted
    with wrong:
        _tile("Wrong pairs let in", match.wrong_let_in, found.forecast_holds, counted, none)
    with lengths:
        _tile("Length error, median", found.measure.length_median, found.forecast_holds)
    with threshold, st.container(border=True):
        value = match.threshold_px
        st.metric("Threshold", "unknown" if value is None else f"{digits(value, 2)} px")
        ahead = match.threshold.forecast
        left_out = len(answer.calibration.screening.left_out)
        frames = len(answer.calibration.dataset.correspondences.frames)
        st.caption(
            (f"forecast: {digits(ahead.value, 2)} px ({digits(ahead.low, 2)} to "
             f"{digits(ahead.high, 2)})  \n" if ahead else "")
            + f"{left_out} of {frames} frames left out"
        )  # fmt: skip


def _tile(
    title: str, figure: Figure, forecast_holds: bool, counted: str = "", none: str = ""
) -> None:
    """One figure, the forecast first if it holds, and beneath it the other."""
    ahead, held_out = figure.forecast, figure.held_out
    tested = "not yet" if held_out is None else f"{percent(held_out)} %{counted}"
    if held_out == 0.0 and none:
        tested = none
    with st.container(border=True):
        if ahead is not None and (forecast_holds or held_out is None):
            st.metric(title, f"{percent(ahead.value)} %")
            st.caption(f"for bars like these ({interval(ahead)} %)  \nheld out: {tested}")
        elif held_out is not None:
            st.metric(title, f"{percent(held_out)} %")
            doubted = (
                f"  \nforecast, which does not hold: {percent(ahead.value)} %" if ahead else ""
            )
            st.caption(f"on held-out frames{doubted}")
        else:
            st.metric(title, "unknown")
            st.caption("no forecast, no held-out frames")


def show_figure(
    figure: go.Figure, sentence: str, key: str, fold: bool = False, **chart: Any
) -> None:
    """A figure with its description in words.

    Args:
        fold: the words are folded away.
        chart: passed on to `st.plotly_chart`.
    """
    st.plotly_chart(figure, key=key, **chart)
    with st.expander("In words") if fold else st.container():
        st.caption(escape_markdown(sentence))


def dataset_download(dataset: Dataset) -> None:
    """Download of the data set as a zip, which can be uploaded again."""
    st.download_button(
        "Download this data set",
        pack_zip(pack_dataset(dataset)),
        "dataset.zip",
        "application/zip",
        on_click="ignore",
        icon=":material/download:",
    )


@st.fragment  # its controls redraw this part only
def _show_rig(project: Project, answer: Answer) -> None:
    methods = [name for name in ALL_METHODS if name != "essential" and name in answer.sets]
    st.subheader("The rig in 3D")
    left, right = st.columns(2)
    seen = setting(project, "rig_method", "3d", one_of(methods), tabs_own=True)
    method = left.segmented_control(
        "Set", methods, format_func=METHOD_NAMES.__getitem__, required=True, **seen.widget()
    )
    views = list(VIEWS)
    from_where = setting(project, "rig_view", views[0], one_of(views), tabs_own=True)
    view = right.segmented_control("Seen from", views, required=True, **from_where.widget())
    found = answer.calibration
    show_figure(plot_rig(found, method, view), describe_rig(found, method), "rig", fold=True)


@st.fragment
def _show_views(project: Project, answer: Answer) -> None:
    views = {
        "Errors by frame": _show_frames,
        "Searches": _show_searches,
        "Parameters": _show_parameters,
    }
    shown = setting(project, "view", next(iter(views)), one_of(list(views)), tabs_own=True)
    view = st.segmented_control("Look at", list(views), required=True, **shown.widget())
    views[view](project, answer)


def _show_frames(_project: Project, answer: Answer) -> None:
    found = answer.calibration
    show_figure(plot_frame_errors(found), describe_frame_errors(found), "frames", fold=True)


def _show_searches(_project: Project, answer: Answer) -> None:
    found = answer.calibration
    show_figure(plot_traces(found), describe_traces(found), "traces", fold=True)


def _show_parameters(project: Project, answer: Answer) -> None:
    found = answer.calibration
    if answer.outlook is not None:
        st.table(forecast_table(answer.outlook.predictive))
    else:
        st.table(errors_table(found))
    st.table(angles_table(found))
    st.caption(describe_settings(found))
    st.markdown("**In the format of another program**")
    other_formats(project, answer.sets)
