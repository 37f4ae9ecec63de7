"""Questions about a file of another program that has both cameras, or a whole data set."""

from __future__ import annotations

from typing import Any

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import THROW, Archive
from stereocal.formats.archives.easywand import open_easywand
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.exchange.exchange import camera_names, has_both_cameras
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.other_files import is_hdf5, is_matlab
from stereocal.projects.application import ProjectApplication
from stereocal.projects.inputs import Slot
from stereocal.projects.project import Project
from stereocal.system.latest import read_once
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Fit, choose, setting
from stereocal.ui.foreign import ask, ask_size
from stereocal.ui.intake import SEVERAL, clear_refusal, escape_markdown
from stereocal.ui.texts import escaped_table
from stereocal.ui.wizard import ask_buttons


def is_archive(name: str, content: bytes) -> bool:
    """Whether a file has both cameras, or a whole data set."""
    if is_matlab(content) or (name.lower().endswith(".mat") and is_hdf5(content)):
        return True
    return has_both_cameras(name, content)


def ask_about_archive(store: ProjectApplication) -> None:
    """What an archive holds and the questions about it, if there is one."""
    asked = store.asking("archive")
    if asked is None:
        return
    label, content = asked
    with st.container(border=True):
        st.markdown(f"**{escape_markdown(label)}** is a file of another program.")
        known = store.project.inputs.baseline_m is not None
        found = None
        try:
            options = _form(store.project, label, content)
            found = read_once(_gathered, content, label, options, known)
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
        if found is not None:
            _show(found, known)
        ask_buttons(
            store,
            "archive",
            None if found is None else lambda: _use(store, label, found),
            "Use what was found",
        )


def _gathered(content: bytes, label: str, options: ExchangeOptions, known: bool) -> Archive:
    return gather({label: content}, options, baseline_known=known)


def _cameras_in(content: bytes, label: str) -> tuple[str, ...]:
    """Names of the cameras, to choose from; empty if the file has none to choose."""
    if is_matlab(content):
        opened = open_easywand(content, label)
        return () if opened is None else opened.cameras
    return camera_names(label, content)


def _form(project: Project, label: str, content: bytes) -> ExchangeOptions:
    """The questions: which cameras, and, folded, what the file may not say."""
    names = read_once(_cameras_in, content, label)
    cameras = _cameras(project, names) if len(names) > 2 else None
    with st.expander("Say what the file does not, or has wrong"):
        left, right = st.columns(2)

        def widget(name: str, usual: Any, fit: Fit) -> dict[str, Any]:
            return setting(project, f"archive_{name}", usual, fit).widget()

        unit, lens_model = ask(left, "unit", widget), ask(right, "lens_model", widget)
        size = ask_size(project, "archive", "")
    return ExchangeOptions(
        cameras=cameras, unit=unit, image_sizes=(size, size), lens_model=lens_model
    )


def _cameras(project: Project, names: tuple[str, ...]) -> tuple[str, str]:
    """The chosen primary and secondary, by number."""
    st.caption(f"It has {len(names)} cameras: choose two. For all, choose *{SEVERAL}* above.")
    chosen = []
    for k, (column, which) in enumerate(zip(st.columns(2), ("Primary", "Secondary"), strict=True)):
        key, title = f"archive_camera_{k}", f"{which} camera"
        one = choose(
            project, key, title, names, names[k], place=column, tabs_own=False, as_menu=True
        )
        chosen.append(one)
    first, second = (str(names.index(name) + 1) for name in chosen)
    return first, second


def _show(found: Archive, baseline_known: bool) -> None:
    rows = [(each.what, each.taken, each.origin) for each in found.taken]
    table = pd.DataFrame(rows, columns=["What", "Found", "From"])
    st.table(escaped_table(table).set_index("What"))
    if found.baseline_m is not None:
        st.caption(
            "The baseline is the other program's result, not a measurement: replace it and its "
            "uncertainty by the measured ones, or state below that it was not measured."
        )
    elif found.correspondences is not None and not baseline_known:
        st.caption("It has no baseline: enter the measured one below, or say that there is none.")
    if found.throw is not None:
        offer(
            "The thrown object, for a world frame", found.throw.to_csv(index=False), THROW, "throw"
        )


def _use(store: ProjectApplication, label: str, found: Archive) -> None:
    """Store what was found; a length that the user has entered stays."""
    files: dict[Slot, tuple[str, bytes]] = {}
    if found.primary is not None and found.secondary is not None:
        files["primary"] = (f"{label}, primary", write_camera(found.primary))
        files["secondary"] = (f"{label}, secondary", write_camera(found.secondary))
    if found.correspondences is not None:
        files["correspondences"] = (label, write_table(found.correspondences))
    inputs, values = store.project.inputs, dict[str, Any]()
    if found.baseline_m is not None and inputs.baseline_m is None:
        values |= {"baseline_m": found.baseline_m, "baseline_sigma_m": found.baseline_sigma_m}
    if found.target_distance_m is not None and inputs.target_distance_m is None:
        values["target_distance_m"] = found.target_distance_m
    store.project.give(files, **values)
    store.forget_question("archive")
    clear_refusal()
