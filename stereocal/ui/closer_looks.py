"""Closer looks at the result on the Calibrate page, one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.errors import StereocalError
from stereocal.figures import two_sets
from stereocal.figures.frame_errors import plot_frame_errors
from stereocal.figures.frame_panels import describe_frame_errors
from stereocal.figures.frame_view import FrameView, views_of
from stereocal.figures.tables import angles_table, errors_table, forecast_table
from stereocal.figures.traces import describe_traces, plot_traces
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.rig.camera import CAMERAS
from stereocal.rig.lengths_in_words import as_held
from stereocal.ui import chosen_frame
from stereocal.ui.fields import Field, choose, one_of, setting
from stereocal.ui.figure import scroll_to, scrolled_part, show_figure
from stereocal.ui.forms import describe_settings
from stereocal.ui.messages import callback, fragment
from stereocal.ui.navigation import go_to
from stereocal.ui.parameter_files import other_formats
from stereocal.ui.review import look_closely
from stereocal.ui.screening import rerun_if_changed
from stereocal.ui.texts import escape_markdown
from stereocal.workflow import Answer

FRAMES = "Errors by frame"
CHART, OPENED = "frames", "opened_frame"


def _view(project: Project) -> Field:
    return setting(project, "view", FRAMES, one_of(list(VIEWS)), tabs_own=True)


@callback
def look_at_frame(project: Project, calibration: Calibration, frame: int) -> None:
    """Open a frame (a callback)."""
    _view(project).set(FRAMES)
    scroll_to(OPENED)
    chosen_frame.frame_field(project, calibration).set(frame)


COVERAGE = "coverage"
"""Key of the figure of the Data page."""


@callback
def open_clicked_frame(project: Project) -> None:
    """Open the frame of a point of the figure of the Data page: its photographs, or its errors."""
    frame, calibration = _clicked_frame(COVERAGE, f"{COVERAGE}_narrow"), project.calibration
    if frame is None:
        return
    if chosen_frame.photographed(project):
        look_closely(ProjectPhotographs(project), frame)
    elif calibration is not None:
        look_at_frame(project, calibration, frame)
        go_to("calibrate")
    else:
        raise StereocalError(f"Frame {frame}: its errors are shown once you have calibrated.")


def _clicked_frame(*charts: str) -> int | None:
    """The frame of the first point that was clicked in one of these figures."""
    shown = filter(None, map(st.session_state.get, charts))
    points = [point for each in shown for point in each["selection"]["points"]]
    return int(np.ravel(points[0]["customdata"])[0]) if points else None


@fragment
def show_closer_looks(project: Project, found: Calibration, answer: Answer | None) -> None:
    """A choice of views; only the chosen one is computed.

    Args:
        answer: None while it is being computed.
    """
    rerun_if_changed()
    shown = _view(project)
    view = st.segmented_control("Look at", list(VIEWS), required=True, **shown.widget())
    VIEWS[view](project, found, answer)


def _show_frames(project: Project, found: Calibration, answer: Answer | None) -> None:
    chosen = chosen_frame.frame_field(project, found)
    st.caption("Click on a point to open its frame below.")
    show_figure(
        plot_frame_errors(found, chosen.value()),
        describe_frame_errors(found),
        CHART,
        on_select=partial(_clicked, project, found),
        selection_mode="points",
    )
    with scrolled_part(OPENED):
        frame = chosen_frame.choose_frame(project, found)
        views = views_of(found, frame)
        st.markdown(
            escape_markdown(f"{chosen_frame.state_of(found, frame)} {_in_words(found, views)}")
        )
        method = answer.recommendation.match.method if answer else "2d"
        _show_images(project, frame, views, method, st.columns(2))


def _in_words(found: Calibration, views: dict[Method, FrameView]) -> str:
    return as_held(two_sets.describe_two_sets(views), found.dataset)


@callback
def _clicked(project: Project, calibration: Calibration) -> None:
    """Open the frame of a clicked point."""
    if (frame := _clicked_frame(CHART)) is not None:
        chosen_frame.frame_field(project, calibration).set(frame)


def _show_images(
    project: Project,
    frame: int,
    views: dict[Method, FrameView],
    method: Method,
    columns: Sequence[DeltaGenerator],
) -> None:
    photographs = chosen_frame.photographs_of(project, frame)
    for camera, (side, column) in enumerate(zip(CAMERAS, columns, strict=True)):
        with column:
            st.markdown(f"**{side.capitalize()}**")
            figure = two_sets.plot_image(views, method, camera, photographs[camera])
            words = two_sets.describe_image(views, method, camera)
            show_figure(figure, words, f"image_{side}", fold=False)


def _show_two_sets(project: Project, found: Calibration, _answer: Answer | None) -> None:
    frame = chosen_frame.choose_frame(project, found)
    views = views_of(found, frame)
    methods = list(views)
    method = choose(
        project, "two_sets_method", "Set", methods, format_func=METHOD_NAMES.__getitem__
    )
    st.markdown(f"**{escape_markdown(_in_words(found, views))}**")
    *images, space = st.columns(3)
    _show_images(project, frame, views, method, images)
    with space:
        st.markdown("**In space, where the rays pass each other**")
        words = two_sets.describe_gap(views, method)
        show_figure(two_sets.plot_gap(views, method), words, "gap", fold=False)


def _show_parameters(project: Project, found: Calibration, answer: Answer | None) -> None:
    if answer is not None and answer.outlook is not None:
        st.table(forecast_table(answer.outlook.predictive, answer.thresholds_px))
    else:
        st.table(errors_table(found))
    st.table(angles_table(found))
    made_with = describe_settings(found.settings)
    st.caption(f"Made with: {made_with}, {len(found.frames)} calibration frames.")
    if answer is not None:
        st.markdown("**In the format of another program**")
        other_formats(project, answer)


VIEWS = {
    FRAMES: _show_frames,
    "Why two sets": _show_two_sets,
    "Searches": lambda _project, found, _answer: show_figure(
        plot_traces(found), describe_traces(found), "traces"
    ),
    "Parameters": _show_parameters,
}
