"""The Data page for three cameras and more: their files, and one table of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.archives.every_camera import EveryCamera, cameras_in, gather_all, targets_in
from stereocal.formats.archives.gather import TABLES
from stereocal.formats.description import DESCRIPTION
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.recording_files import pack_recording, parse_recording
from stereocal.frames.pairing import natural
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.system.latest import Latest
from stereocal.ui import jobs
from stereocal.ui.fields import Fit, Number, setting
from stereocal.ui.foreign import ask
from stereocal.ui.intake import CAMERA_KINDS, Upload, escape_markdown, take_new
from stereocal.ui.messages import callback, readable
from stereocal.ui.navigation import go_to
from stereocal.ui.project import project_to_write
from stereocal.ui.rig import work_of
from stereocal.ui.several_photographs import photographs_of_all
from stereocal.ui.texts import escaped_table

FILES = "Camera files of all cameras, and one table of points or photographs"
HELP = (
    "One file for each camera, named as in the table (`left.json`, `camera_1.yaml`), or one of all "
    "(Kalibr, aniposelib, Caliscope). The table is ours (`frame,camera,target,u,v`) or a wand file "
    "of Argus, easyWand or DLTdv; with camera files only, photographs are asked for. With a "
    "`dataset.json`, nothing is asked."
)
_ROUND = "several_round"
GATHERED: Latest[EveryCamera] = Latest(8)


def several_in(project: Project | None) -> None:
    """The uploader, the questions, what was read, and the press."""
    uploads = st.file_uploader(
        FILES,
        type=[*CAMERA_KINDS, "csv", "txt"],
        accept_multiple_files=True,
        key=f"upload_several_{st.session_state.setdefault(_ROUND, 0)}",
        help=HELP,
    )
    _take(uploads)
    store = None if project is None else ProjectRecording(project)
    if store is None or not store.parts:
        return
    _show_files(store)
    parts = dict(sorted(store.parts.items(), key=lambda each: natural(each[0])))
    options = ExchangeOptions()
    if DESCRIPTION not in parts:
        options = _questions(store.project)
        files = {name: part for name, part in parts.items() if not name.lower().endswith(TABLES)}
        cameras = readable(lambda: _cameras(files, options), told=False) or {}
        given = len(cameras) > 2 and photographs_of_all(store.project, cameras)
        if given and len(files) == len(store.parts):
            return  # the table is still to be made from them
    try:
        found = _read(store.project, parts, options)
    except StereocalError as error:
        st.warning(escape_markdown(str(error)))
        return
    _show(found)
    st.button(
        "Calibrate all",
        type="primary",
        key="several_run",
        on_click=_calibrate,
        args=(store, found.recording),
    )


def _take(uploads: Sequence[Upload]) -> None:
    def take(files: dict[str, bytes]) -> None:
        ProjectRecording(project_to_write()).add_parts(files)
        st.session_state[_ROUND] = st.session_state.get(_ROUND, 0) + 1  # empties the uploader

    take_new(uploads, take)


def _show_files(store: ProjectRecording) -> None:
    """The files in use, to remove, and those that replaced one."""
    with st.container(horizontal=True):
        for name in sorted(store.parts, key=natural):
            st.button(
                escape_markdown(name),
                key=f"drop_{name}",
                icon=":material/close:",
                help="Remove this file.",
                on_click=callback(store.drop_part),
                args=(name,),
            )
    for name in store.replaced:
        text, button = st.columns([6, 2], vertical_alignment="center")
        text.info(f"{escape_markdown(name)} was replaced.")
        button.button(
            "Undo",
            key=f"undo_{name}",
            icon=":material/undo:",
            on_click=callback(store.undo_part),
            args=(name,),
        )


def _cameras(files: dict[str, StoredFile], options: ExchangeOptions) -> dict[str, Camera]:
    return cameras_in({name: file.read_bytes() for name, file in files.items()}, options)


def _read(project: Project, parts: dict[str, StoredFile], options: ExchangeOptions) -> EveryCamera:
    """The recording of the files, and of what is answered about them."""
    name, lengths = project.inputs.name or "Rig", dict[str, float]()
    if DESCRIPTION not in parts:
        for table in (each for each in parts if each.lower().endswith(TABLES)):
            lengths |= _lengths(project, targets_in(parts[table].read_bytes(), table))

    def gathered() -> EveryCamera:
        files = {each: file.read_bytes() for each, file in parts.items()}
        if DESCRIPTION in files:
            return EveryCamera(parse_recording(files, name), (), ())
        return gather_all(files, options, name, lengths)

    about = [(each, file.sha256) for each, file in parts.items()]
    return GATHERED.once(repr((about, options, lengths, name)), gathered)


def _lengths(project: Project, targets: Sequence[str]) -> dict[str, float]:
    """The places of the targets along the bar that are stated, in metres."""
    found: dict[str, float] = {}
    if len(targets) < 2:
        return found
    for target, column in zip(targets[1:], st.columns(len(targets) - 1), strict=True):
        field = setting(project, f"several_{target}_m", None, Number(0.0, or_none=True))
        value = column.number_input(
            f"{escape_markdown(targets[0])} to {escape_markdown(target)} (m)",
            min_value=0.0,
            value=None,
            step=None,
            format="%.10g",
            placeholder="measured length, along the bar",
            **field.widget(),
        )
        if value:
            found[target] = value
    return found


def _questions(project: Project) -> ExchangeOptions:
    def widget(name: str, usual: Any, fit: Fit) -> dict[str, Any]:
        return setting(project, f"several_{name}", usual, fit).widget()

    with st.expander("Say what the files do not, or have wrong"):
        left, right = st.columns(2)
        lens_model, corner = ask(left, "lens_model", widget), ask(right, "corner", widget)
    return ExchangeOptions(lens_model=lens_model, corner=corner)


def _show(found: EveryCamera) -> None:
    """What was read, camera by camera."""
    recording = found.recording
    rows = []
    for number_of, (name, camera) in enumerate(recording.cameras.items()):
        own = recording.frame[recording.camera == number_of]
        width, height = camera.image_size
        rows.append((name, f"{width}x{height}", len(own), len({*own.tolist()})))
    table = pd.DataFrame(rows, columns=["Camera", "Image, px", "Points", "Frames"])
    st.table(escaped_table(table).set_index("Camera"))
    st.caption(escape_markdown(recording.describe_pairs()))
    for remark in found.remarks:
        st.warning(escape_markdown(remark))


@callback
def _calibrate(store: ProjectRecording, recording: Recording) -> None:
    """Store the recording, calibrate it, and open the Rig page (a callback)."""
    store.give(pack_recording(recording), recording.name)
    jobs.start(work_of(store.project, False))
    go_to("rig")
