"""Downloads of the parameter files, ours and in the formats of other programs."""

from __future__ import annotations

from functools import partial
from typing import Any

import streamlit as st

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.errors import StereocalError
from stereocal.formats.exchange.exchange import FORMATS, export_files, export_notes
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.projects.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Fit, choose, setting
from stereocal.ui.foreign import ask_origin
from stereocal.ui.texts import escape_markdown
from stereocal.workflow import Answer

FILES: dict[Method, tuple[str, str]] = {
    "2d": ("parameters_2d.json", "to match"),
    "3d": ("parameters_3d.json", "to measure"),
    "refined": ("parameters_refined.json", "for both"),
}
"""Name and purpose of each file, the paper's two first."""


def parameter_downloads(answer: Answer) -> None:
    """A download button for each file; those to use stand out."""
    to_use = answer.recommendation.use.values()
    with st.container(horizontal=True):
        for method, rig in answer.sets.items():
            name, purpose = FILES[method]
            offer(
                f"{name} · {purpose}",
                partial(RigParameters.dumps, rig),
                name,
                f"download_{method}",
                primary=method in to_use,
            )


def hold_downloads() -> None:
    """The buttons before there are files."""
    with st.container(horizontal=True):
        for method, (name, purpose) in FILES.items():
            st.button(
                f"{name} · {purpose}",
                disabled=True,
                icon=":material/download:",
                key=f"no_download_{method}",
            )


def other_formats(project: Project, answer: Answer) -> None:
    """A file in the format of another program."""
    left, right = st.columns(2)
    sets, usual = answer.sets, answer.recommendation.match.method
    method: Method = choose(
        project,
        "format_file",
        "File",
        sets,
        usual,
        place=left,
        as_menu=True,
        format_func=METHOD_NAMES.__getitem__,
    )
    chosen: str = choose(
        project,
        "format",
        "Format",
        FORMATS,
        place=right,
        as_menu=True,
        format_func=lambda name: FORMATS[name].title,
    )
    rig, file_name = sets[method], FILES[method][0]
    try:
        options = _dlt_options(project, method) if chosen == "dlt" else ExchangeOptions()
        name, content = packed(export_files(rig, chosen, options), file_name, chosen)
        for note in export_notes(rig, chosen):
            st.caption(escape_markdown(note))
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    offer(f"Download {name}", content, name, "download_format")


def packed(files: dict[str, bytes], file_name: str, chosen: str) -> tuple[str, bytes]:
    """Name and content of a download: a single file as it is, several as a zip."""
    stem = file_name.rsplit(".", 1)[0]
    if len(files) == 1:
        ((name, content),) = files.items()
        return f"{stem}_{name}", content
    return f"{stem}_{chosen}.zip", pack_zip(files)


def _dlt_options(project: Project, which: str) -> ExchangeOptions:
    """The form of the pixel origin of DLT coefficients; `which` is part of the widgets' keys."""

    def widget(name: str, usual: Any, fit: Fit) -> dict[str, Any]:
        name = "first" if name == "first_pixel" else name
        return setting(project, f"dlt_{name}_{which}", usual, fit).widget()

    origin = ask_origin(widget, PixelOrigin())
    return ExchangeOptions(corner=origin.corner, first_pixel=origin.first_pixel, flip=origin.flip)
