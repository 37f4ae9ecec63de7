"""Results on the screen, and their downloads."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Collection
from typing import Any, Literal

import plotly.graph_objects as go
import streamlit as st

from stereocal.calibrate import METHOD_NAMES, METHODS, Calibration
from stereocal.commands.calibrate import FILES, REFINED
from stereocal.dataset import Dataset
from stereocal.evaluation_files import Evaluation, validation_figures
from stereocal.figures import (
    describe_frame_errors,
    describe_rig,
    describe_traces,
    plot_frame_errors,
    plot_rig,
    plot_traces,
)
from stereocal.formats.dataset_files import pack_dataset
from stereocal.refine import RefinedResult
from stereocal.refined.file import refined_parameters
from stereocal.summary import summarise
from stereocal.tables import answer, results_table
from stereocal.ui.intake import escape_markdown
from stereocal.ui.texts import TWO_FILES


def show_result(
    calibration: Calibration,
    evaluation: Evaluation | None = None,
    refined: RefinedResult | None = None,
    instead: Collection[str] = (),
) -> None:
    """Answer, downloads, table and figures, from top to bottom.

    Args:
        refined: the refined set of the same data, for a third file.
        instead: of "2d" and "3d", the purposes that the refined set is to serve.
    """
    for warning in calibration.warnings:
        st.warning(warning)
    st.success(answer(calibration))
    figures: dict[str, dict[str, Any]] = {}
    if evaluation is not None and list(evaluation.sha256) == [calibration.dataset.sha256]:
        figures = validation_figures(summarise(evaluation.runs), evaluation.settings)
        st.caption("The two files carry the figures of the last validation of these data.")
    methods: tuple[Literal["2d", "3d"], ...] = ("2d", "3d")
    for method, column in zip(methods, st.columns(2), strict=True):
        with column:
            st.markdown(TWO_FILES[method])
            if refined is not None and method in instead:
                st.caption("Holds the refined set, as chosen on the page One set or two.")
                content = refined_parameters(refined, (), figures.get("refined")).dumps()
            else:
                content = calibration.parameters(method, figures.get(method)).dumps()
            st.download_button(
                f"Download {FILES[method]}",
                content,
                FILES[method],
                "application/json",
                on_click="ignore",
                type="primary",
                icon=":material/download:",
                key=f"download_{method}",
            )
    if refined is not None:
        st.download_button(
            f"Download {REFINED}: one set for both, its lenses included",
            refined_parameters(refined, (), figures.get("refined")).dumps(),
            REFINED,
            "application/json",
            on_click="ignore",
            icon=":material/download:",
            key="download_refined",
        )
    st.table(results_table(calibration))
    views = {
        "Errors by frame": _show_frames,
        "The rig in 3D": _show_rig,
        "The searches": _show_searches,
    }
    view = st.segmented_control(
        "Look at", list(views), default="Errors by frame", key="view", required=True
    )
    views[view](calibration)


def show_figure(figure: go.Figure, sentence: str, key: str) -> None:
    """A figure, and beneath it what it shows in words: for everyone, and for screen readers."""
    st.plotly_chart(figure, key=key)
    st.caption(escape_markdown(sentence))


def dataset_download(dataset: Dataset) -> None:
    """The whole data set as one zip, which can be uploaded again."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in pack_dataset(dataset).items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    st.download_button(
        "Download this data set",
        packed.getvalue(),
        "dataset.zip",
        "application/zip",
        on_click="ignore",
        icon=":material/download:",
    )


def _show_frames(calibration: Calibration) -> None:
    show_figure(plot_frame_errors(calibration), describe_frame_errors(calibration), "frames")


def _show_rig(calibration: Calibration) -> None:
    method = st.segmented_control(
        "As seen with", METHODS, default="3d", key="rig_method",
        format_func=lambda name: METHOD_NAMES[name], required=True,
    )  # fmt: skip
    show_figure(plot_rig(calibration, method), describe_rig(calibration, method), "rig")


def _show_searches(calibration: Calibration) -> None:
    show_figure(plot_traces(calibration), describe_traces(calibration), "traces")
