"""The paper kit among the downloads of a result."""

from __future__ import annotations

import streamlit as st

from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.ui.downloads import offer
from stereocal.ui.messages import readable
from stereocal.workflow import Answer

LABEL = "Paper kit · methods, figures, table, archive"
NAME = "paper_kit.zip"


def offer_paper_kit(project: Project, answer: Answer) -> None:
    """A download that is made when it is pressed."""
    result = readable(lambda: ProjectApplication(project).result)
    applied = None if result is None else result[0]

    def make() -> bytes:
        from stereocal.paper_kit.kit import paper_kit  # Matplotlib: 0.4 s

        return paper_kit(answer, applied)

    offer(LABEL, make, NAME, "download_kit", icon=":material/article:")


def hold_paper_kit() -> None:
    """The button before there is a result."""
    st.button(LABEL, disabled=True, icon=":material/article:", key="no_download_kit")
