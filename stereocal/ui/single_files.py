"""The Data page's three uploaders, for a table and two camera files."""

from __future__ import annotations

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.archives.gather import holds_bars
from stereocal.formats.correspondences_csv import TEMPLATE
from stereocal.projects.application import Asked, ProjectApplication
from stereocal.projects.inputs import Slot
from stereocal.projects.project import Project
from stereocal.ui.archives import ask_about_archive, is_archive
from stereocal.ui.downloads import offer
from stereocal.ui.intake import CAMERA_KINDS, TITLES, Upload, in_use, is_new, take_file, take_one
from stereocal.ui.project import project_to_write
from stereocal.ui.wizard import ask_about_bars


def single_files(project: Project | None) -> None:
    """The uploaders, and questions about a table of another program."""
    for slot, column in zip(TITLES, st.columns(3), strict=True):
        with column:
            in_use(project, slot)
            if slot == "correspondences":
                help_text = (
                    "Ours, a wand file of Argus or easyWand, points of Argus or DLTdv, or an "
                    "easyWandData.mat."
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
                take_camera(slot, st.file_uploader(TITLES[slot], type=CAMERA_KINDS, key=key))
    offer("Template for the table", TEMPLATE, "correspondences.csv", "template")
    if project is not None:
        ask_about_bars(ProjectApplication(project))
        ask_about_archive(ProjectApplication(project))


def take_camera(slot: Slot, upload: Upload | None) -> None:
    """Store a camera file; ask about one that has both cameras."""
    if upload is not None and is_new(upload) and not _asked_archive(upload):
        take_file(slot, upload)


def _asked_archive(upload: Upload) -> bool:
    """Keep a file with both cameras or a whole data set until its questions are answered."""
    if not holds_both(upload):
        return False
    _ask("archive", upload)
    return True


def holds_both(upload: Upload) -> bool:
    """Whether a file has both cameras, or a whole data set."""
    try:
        return is_archive(upload.name, upload.getvalue())
    except StereocalError:  # damaged: its reader reports what is wrong
        return False


def _ask(asked: Asked, upload: Upload) -> None:
    take_one(
        upload,
        lambda name, content: ProjectApplication(project_to_write()).ask(asked, name, content),
    )


def _take_table(upload: Upload | None) -> None:
    """Store our table at once; ask about a file of another program."""
    if upload is None:
        return
    if not is_new(upload) or _asked_archive(upload):
        return
    if holds_bars(upload.getvalue(), upload.name):
        _ask("bars", upload)
    else:
        take_file("correspondences", upload)
