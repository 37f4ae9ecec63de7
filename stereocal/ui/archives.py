"""Questions about a file with both cameras, or with a whole data set of another program."""

from functools import partial
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.formats.archives.archive import THROW, Archive
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.projects.application import ProjectApplication
from stereocal.projects.given import ProjectGiven
from stereocal.projects.inputs import Slot
from stereocal.projects.project import Project
from stereocal.system.latest import read_once
from stereocal.ui.downloads import offer
from stereocal.ui.fields import choose_from_menu
from stereocal.ui.texts import escape_markdown, escaped_table
from stereocal.ui.wizard import Questions, Use, ask_about, ask_size

CAMERA_TITLES = ("Primary camera", "Secondary camera")


def ask_about_archive(project: Project) -> None:
    """What an archive holds and the questions about it, if there is one."""
    store = ProjectApplication(project)

    def form(label: str, content: bytes) -> Use:
        st.markdown(f"**{escape_markdown(label)}** is a file of another program.")
        known = project.inputs.baseline_m is not None
        names = ProjectGiven(project).cameras_in(label, content)
        cameras = _cameras(project, names) if len(names) > 2 else None
        with st.expander("Correct or complete what the file says"):
            asked, (left, right) = Questions(project, "archive_{}"), st.columns(2)
            unit, lens_model = asked.ask(left, "unit"), asked.ask(right, "lens_model")
            size = ask_size(project, "archive", "")
        options = ExchangeOptions((size, size), cameras, unit, lens_model)
        found = read_once(_gathered, content, label, options, known)
        _show(found, known)
        return partial(_use, store, label, found)

    ask_about(store, "archive", form, "Use what was found")


def _gathered(content: bytes, label: str, options: ExchangeOptions, known: bool) -> Archive:
    return gather({label: content}, options, baseline_known=known)


def _cameras(project: Project, names: tuple[str, ...]) -> tuple[int, int]:
    """The indices of the chosen primary and secondary."""
    st.caption(f"It has {len(names)} cameras: choose two.")
    chosen = [
        choose_from_menu(project, f"archive_camera_{k}", title, names, names[k], place=place)
        for k, (place, title) in enumerate(zip(st.columns(2), CAMERA_TITLES, strict=True))
    ]
    first, second = (names.index(name) for name in chosen)
    return first, second


def _show(archive: Archive, baseline_known: bool) -> None:
    rows = [(each.what, each.taken, each.origin) for each in archive.taken]
    table = pd.DataFrame(rows, columns=["What", "Found", "From"])
    st.table(escaped_table(table).set_index("What"))
    for remark in archive.remarks:
        st.caption(escape_markdown(remark))
    if archive.baseline_m is not None:
        st.caption(
            "The baseline is the other program's result, not a measurement: replace it and its "
            "uncertainty by the measured ones, or state below that it was not measured."
        )
    elif archive.correspondences is not None and not baseline_known:
        st.caption("It has no baseline: enter the measured one below, or say that there is none.")
    if archive.throw is not None:
        content = archive.throw.to_csv(index=False)
        offer("The thrown object, for a world frame", content, THROW, "throw")


def _use(store: ProjectApplication, label: str, archive: Archive) -> None:
    """Store what was found; a length that the user has entered stays."""
    files: dict[Slot, tuple[str, bytes]] = {}
    if archive.primary is not None and archive.secondary is not None:
        files["primary"] = (f"{label}, primary", write_camera(archive.primary))
        files["secondary"] = (f"{label}, secondary", write_camera(archive.secondary))
    if archive.correspondences is not None:
        files["correspondences"] = (label, write_table(archive.correspondences))
    inputs, values = store.project.inputs, dict[str, Any]()
    if archive.baseline_m is not None and inputs.baseline_m is None:
        values |= {"baseline_m": archive.baseline_m, "baseline_sigma_m": archive.baseline_sigma_m}
    if archive.target_distance_m is not None and inputs.target_distance_m is None:
        values["target_distance_m"] = archive.target_distance_m
    store.project.give(files, **values)
    store.forget_question("archive")
