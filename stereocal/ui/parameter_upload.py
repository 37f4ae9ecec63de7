"""Upload of parameter files on the Apply page; other programs' files need some questions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.exchange.exchange import FORMATS, import_files
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.formats.units import UnitError
from stereocal.projects.application import ProjectApplication, Use
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.latest import read_once
from stereocal.system.numbers import rounded
from stereocal.system.zip_files import unzip
from stereocal.ui.fields import Fit, one_of, setting
from stereocal.ui.foreign import ask, ask_origin, ask_size
from stereocal.ui.intake import escape_markdown, take_new
from stereocal.ui.parameter_files import FILES
from stereocal.ui.refined import PAPERS
from stereocal.ui.wizard import ask_buttons

PURPOSES: Mapping[Use, str] = {"matching": "Match with", "measuring": "Measure with"}
KINDS = ["json", "zip", "yml", "yaml", "xml", "toml", "m", "csv", "txt", "ini", "conf", "mat"]


def upload_set(project: Project, store: ProjectApplication, use: Use) -> None:
    """Uploader of a parameter file, and questions about it."""
    uploads = st.file_uploader(
        f"{PURPOSES[use]}: {FILES[PAPERS[use]][0]}",
        type=KINDS,
        key=f"upload_set_{use}",
        accept_multiple_files=True,
        help="Or parameters_refined.json, which serves both; or the files of another program, all "
        "of them at once or as a zip.",
    )
    take_new(uploads, lambda files: store.offer_set(use, files))
    _ask_about_set(project, store, use)


def _ask_about_set(project: Project, store: ProjectApplication, use: Use) -> None:
    """The questions about an uploaded file of another program, if any."""
    asked = store.asking(use)
    if asked is None:
        return
    label, content = asked
    with st.container(border=True):
        st.markdown(f"**{escape_markdown(label)}**: parameters of another program.")
        name = st.selectbox(
            "Which program?",
            list(FORMATS),
            index=None,
            format_func=lambda each: FORMATS[each].title,
            placeholder="choose",
            **_answer(project, f"set_format_{use}", None, one_of(list(FORMATS))),
        )
        options = _options(project, use, name)
        rig: RigParameters | None = None
        try:
            if name is not None:
                rig = read_once(_imported, content, label, name, options)
        except (FourCoefficientsError, UnitError) as error:
            st.info(escape_markdown(error.question))
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
        if rig is not None:
            st.caption(f"The cameras are {rounded(rig.pose.baseline, 4)} m apart.")
        ask_buttons(
            store,
            use,
            None if rig is None else lambda: store.keep_set(use, label, rig.dumps().encode()),
            "Use these parameters",
        )


def _imported(content: bytes, label: str, name: str, options: ExchangeOptions) -> RigParameters:
    return import_files(unzip(content, label), name, options, label)


def _options(project: Project, use: Use, name: str | None) -> ExchangeOptions:
    left, right = st.columns(2)

    def widget(field: str, usual: Any, fit: Fit) -> dict[str, Any]:
        field = "lens" if field == "lens_model" else field
        return _answer(project, f"set_{field}_{use}", usual, fit)

    options = ExchangeOptions(
        unit=ask(left, "unit", widget), lens_model=ask(right, "lens_model", widget)
    )
    if name == "dlt":
        origin = ask_origin(widget, PixelOrigin())
        options = replace(
            options, corner=origin.corner, first_pixel=origin.first_pixel, flip=origin.flip
        )
    if name not in ("dlt", "opencv"):  # the others say it
        return options
    sizes = [
        ask_size(
            project,
            f"set_size_{use}_{which}",
            f", {which}",
            camera.image_size if camera else None,
            tabs_own=True,
        )
        for which, camera in zip(CAMERAS, project.cameras, strict=True)
    ]
    return replace(options, image_sizes=(sizes[0], sizes[1]))


def _answer(project: Project, key: str, usual: Any, fit: Fit) -> dict[str, Any]:
    """Key and callback of a question's widget; each tab has its own answer."""
    return setting(project, key, usual, fit, tabs_own=True).widget()
