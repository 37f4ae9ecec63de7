"""Results of the Calibrate page, and their downloads."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import plotly.graph_objects as go
import streamlit as st

from stereocal.calibration.methods import METHOD_NAMES, METHODS
from stereocal.commands.calibrate import FILES, REFINED
from stereocal.figures import (
    describe_frame_errors,
    describe_rig,
    describe_traces,
    plot_frame_errors,
    plot_rig,
    plot_traces,
)
from stereocal.figures.forecast_table import forecast_table
from stereocal.figures.tables import answer, results_table, why_not_trusted
from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects.project import Project
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.rig.dataset import Dataset
from stereocal.system.zip_files import pack_zip
from stereocal.ui.fields import one_of, setting
from stereocal.ui.intake import escape_markdown
from stereocal.ui.parameter_files import parameter_download, sets_of
from stereocal.ui.refined import outlook_for
from stereocal.ui.screening import show_left_out
from stereocal.ui.texts import TWO_FILES


def show_result(
    project: Project,
    calibration: Calibration,
    evaluation: Evaluation | None = None,
    refined: RefinedResult | None = None,
    instead: Collection[str] = (),
) -> None:
    """Answer, downloads, table and figures.

    Args:
        refined: the refined set of the same data, for a third file.
        instead: which of "2d" and "3d" the refined set replaces.
    """
    for warning in calibration.warnings:
        st.warning(escape_markdown(warning))
    show_left_out(project, calibration)
    caution = why_not_trusted(calibration)
    if caution:
        st.error(escape_markdown(f"Do not rely on this result: {caution}"))
    (st.info if caution else st.success)(answer(calibration))
    sets = sets_of(calibration, evaluation, refined)
    if sets["2d"].validation is not None:
        st.caption("The two files contain the figures of the last validation of these data.")
    for method, column in zip(FILES, st.columns(2), strict=True):
        with column:
            st.markdown(TWO_FILES[method])
            chosen = "refined" if "refined" in sets and method in instead else method
            if chosen == "refined":
                st.caption("Holds the refined set, as chosen on the page One set or two.")
            parameter_download(project, sets[chosen], method, FILES[method])
    if "refined" in sets:
        st.markdown("One **refined** set for both, its lenses included:")
        parameter_download(project, sets["refined"], "refined", REFINED, main=False)
    outlook = outlook_for(replace(calibration, refined=refined))
    if outlook:
        st.table(forecast_table(outlook.predictive))
    st.table(results_table(calibration))
    views = {
        "Errors by frame": _show_frames,
        "The rig in 3D": _show_rig,
        "The searches": _show_searches,
    }
    shown = setting(project, "view", next(iter(views)), one_of(list(views)), tabs_own=True)
    view = st.segmented_control("Look at", list(views), required=True, **shown.widget())
    views[view](project, calibration)


def show_figure(figure: go.Figure, sentence: str, key: str) -> None:
    """A figure with its description in words."""
    st.plotly_chart(figure, key=key)
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


def _show_frames(_project: Project, calibration: Calibration) -> None:
    show_figure(plot_frame_errors(calibration), describe_frame_errors(calibration), "frames")


def _show_rig(project: Project, calibration: Calibration) -> None:
    seen = setting(project, "rig_method", "3d", one_of(METHODS), tabs_own=True)
    method = st.segmented_control(
        "As seen with", METHODS, format_func=lambda name: METHOD_NAMES[name], required=True,
        **seen.widget(),
    )  # fmt: skip
    show_figure(plot_rig(calibration, method), describe_rig(calibration, method), "rig")


def _show_searches(_project: Project, calibration: Calibration) -> None:
    show_figure(plot_traces(calibration), describe_traces(calibration), "traces")
