"""The parameter sets of a project's results, and their downloads for all programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.evaluation_files import Evaluation, validation_figures
from stereocal.formats.exchange.exchange import FORMATS, export_files, export_notes
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.pixel_origin import CORNERS, PixelOrigin
from stereocal.projects.project import Project
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip
from stereocal.ui.fields import number, one_of, setting
from stereocal.ui.intake import escape_markdown
from stereocal.ui.refined import outlook_for

OURS = "stereocal"
TITLES = {OURS: "stereocal (JSON)", **{name: each.title for name, each in FORMATS.items()}}
CORNER_TITLES = {"upper-left": "upper left", "lower-left": "lower left"}


def figures_for(calibration: Calibration, evaluation: Evaluation | None) -> dict[str, Any]:
    """Figures of the last validation by method, if it used these data."""
    if evaluation is None or list(evaluation.sha256) != [calibration.dataset.sha256]:
        return {}
    return dict(validation_figures(evaluation.summaries, evaluation.settings))


def sets_of(
    calibration: Calibration,
    evaluation: Evaluation | None,
    refined: RefinedResult | None = None,
) -> dict[str, RigParameters]:
    """The parameter sets of a result by method: 2d, 3d and, if available, refined."""
    figures = figures_for(calibration, evaluation)
    calibration = replace(calibration, refined=refined)  # all files then state the same noise
    outlook = outlook_for(calibration)
    forecasts = outlook.of_files(figures) if outlook else {}
    methods: tuple[Literal["2d", "3d"], ...] = ("2d", "3d")
    found: dict[str, RigParameters] = {
        method: calibration.parameters(method, figures.get(method), forecasts.get(method))
        for method in methods
    }
    if refined is not None:
        found["refined"] = refined_parameters(
            refined, outlook.comparison.inputs if outlook else (), figures.get("refined"),
            calibration.screening.left_out, forecasts.get("refined"),
        )  # fmt: skip
    return found


def parameter_download(
    project: Project, rig: RigParameters, key: str, file_name: str, main: bool = True
) -> None:
    """A menu of formats, notes on what the format loses, and the download.

    Args:
        key: of the widgets of this set.
        file_name: of our own file.
        main: whether the button is primary.
    """
    form = setting(project, f"format_{key}", OURS, one_of(list(TITLES)), tabs_own=True)
    chosen = st.selectbox("Format", list(TITLES), format_func=TITLES.__getitem__, **form.widget())
    try:
        name, content = file_name, rig.dumps().encode()
        if chosen != OURS:
            options = dlt_options(project, key) if chosen == "dlt" else ExchangeOptions()
            name, content = packed(export_files(rig, chosen, options), file_name, chosen)
            for note in export_notes(rig, chosen):
                st.caption(escape_markdown(note))
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    st.download_button(
        f"Download {name}", content, name, _mime(name), on_click="ignore",
        type="primary" if main else "secondary", icon=":material/download:",
        key=f"download_{key}",
    )  # fmt: skip


def packed(files: dict[str, bytes], file_name: str, chosen: str) -> tuple[str, bytes]:
    """Name and content of a download: a single file as it is, several as a zip."""
    stem = file_name.rsplit(".", 1)[0]
    if len(files) == 1:
        ((name, content),) = files.items()
        return f"{stem}_{name}", content
    return f"{stem}_{chosen}.zip", pack_zip(files)


def dlt_options(project: Project, which: str) -> ExchangeOptions:
    """The form of the pixel origin of DLT coefficients; `which` is part of the widgets' keys."""
    left, right = st.columns(2)
    corner = left.selectbox(
        "Points are counted from the", CORNERS, format_func=CORNER_TITLES.__getitem__,
        **setting(project, f"dlt_corner_{which}", CORNERS[0], one_of(CORNERS)).widget(),
        help="Lower left: DLTdv5 to 7, Argus, easyWand. Upper left: DLTdv8.",
    )  # fmt: skip
    first = right.number_input(
        "First pixel", 0.0, 1.0, step=0.5,
        **setting(project, f"dlt_first_{which}", 0.0, number(0.0, 1.0)).widget(),
        help="Coordinate of the centre of the first pixel: 1 for DLTdv, 0 for Argus and easyWand.",
    )  # fmt: skip
    return ExchangeOptions(origin=PixelOrigin(corner, first))


def _mime(name: str) -> str:
    return {"json": "application/json", "zip": "application/zip"}.get(
        name.rsplit(".", 1)[-1], "text/plain"
    )
