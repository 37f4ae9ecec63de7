"""The Data page's three uploaders, for a table and two camera files."""

from __future__ import annotations

import streamlit as st

from stereocal.formats.correspondences_csv import TEMPLATE
from stereocal.formats.point_answers import holds_bars
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.ui.intake import (
    CAMERA_KINDS,
    TITLES,
    Upload,
    check_uploads,
    clear_refusal,
    in_use,
    is_new,
    take_file,
    taking,
)
from stereocal.ui.project import project_to_write
from stereocal.ui.wizard import ask_about_bars


def single_files(project: Project | None) -> None:
    """The uploaders, and questions about a table of another program."""
    for slot, column in zip(TITLES, st.columns(3), strict=True):
        with column:
            in_use(project, slot)
            if slot == "correspondences":
                help_text = (
                    "Ours, or a wand file of Argus or easyWand, or points of Argus or DLTdv."
                )
                upload = st.file_uploader(
                    TITLES[slot],
                    type=["csv", "txt", "h5", "hdf5", "mat"],
                    key=f"upload_{slot}",
                    help=help_text,
                )
                _take_table(upload)
            else:
                key = f"upload_{slot}"
                take_file(slot, st.file_uploader(TITLES[slot], type=CAMERA_KINDS, key=key))
    st.download_button(
        "Template for the table", TEMPLATE, "correspondences.csv", "text/csv", on_click="ignore",
        icon=":material/download:",
    )  # fmt: skip
    if project is not None:
        ask_about_bars(ProjectApplication(project))


def _take_table(upload: Upload | None) -> None:
    """Store our table at once; ask about a file of another program."""
    if upload is None:
        return
    if not holds_bars(upload.getvalue(), upload.name):
        take_file("correspondences", upload)
    elif is_new(upload):
        with taking(upload):
            check_uploads([upload])
            ProjectApplication(project_to_write()).ask("bars", upload.name, upload.getvalue())
            clear_refusal()
        st.rerun()
