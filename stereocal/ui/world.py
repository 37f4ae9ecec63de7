"""The fold "World frame" of the Apply page: a table or world.json, the frame, its download."""

from __future__ import annotations

from dataclasses import dataclass

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.field.world.find import find_world
from stereocal.field.world.frame import (
    BASELINE,
    CAMERA,
    FIRST,
    SURVEY,
    VIEW,
    Axes,
    WorldFrame,
    WorldSettings,
)
from stereocal.field.world.observed import Observed, Survey, Throw
from stereocal.formats.world_file import is_json, parse_world, write_world
from stereocal.formats.world_tables import FRAME, kind_of_table, read_observed
from stereocal.matching.application import digest_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, number, setting, yes_or_no
from stereocal.ui.intake import take_one
from stereocal.ui.messages import callback
from stereocal.ui.point_noise import ask_noise, noise_field
from stereocal.ui.texts import escape_markdown

WORLD_FILE = "world.json"
HELP = (
    "A table of surveyed points (point,x,y,z and the pixels of both cameras), of plumb lines, "
    "level lines or a horizon (line,kind and pixels), or of a throw (frame and pixels); or "
    "world.json, or a 4x4 matrix."
)


@dataclass(frozen=True, eq=False)
class Given:
    """A stored file that says where the world frame is."""

    file: StoredFile
    pose: Pose | None
    """Of a file that states the frame itself."""
    observed: Observed | None
    """Of a table from which it is found; None also for a throw whose frame rate is missing."""


def choose_world(project: Project, store: ProjectApplication, rig: RigParameters) -> Pose | None:
    """The fold; returns `world_from_primary`, or None for points in the primary's frame."""
    given, refused, world = None, None, None
    with st.expander("World frame", expanded=_lacks_frame_rate(project, store)):
        try:
            given = _given(project, store)
            _take_file(store)
            if given is not None:
                world = given.pose or _found(project, given, rig)
            elif store.world_file is None:
                st.caption(
                    "Points are in the primary camera's frame. A table of surveyed points, plumb "
                    "lines or a throw gives them a world frame with a known vertical."
                )
        except StereocalError as error:
            refused = error
    if refused is not None:
        st.error(
            f"World frame: {escape_markdown(str(refused))} "
            "Until then, points are in the primary camera's frame."
        )
    return world


def _lacks_frame_rate(project: Project, store: ProjectApplication) -> bool:
    found = store.world_file
    if found is None or is_json(found.label) or _rate_field(project).value() is not None:
        return False
    try:
        return kind_of_table(found.read_bytes(), found.label) == FRAME
    except StereocalError:
        return False


def _take_file(store: ProjectApplication) -> None:
    upload = st.file_uploader(
        "Surveyed points, plumb lines or a throw; or world.json",
        type=["csv", "txt", "tsv", "json"],
        key="upload_world",
        help=HELP,
    )
    take_one(upload, store.keep_world)


def _given(project: Project, store: ProjectApplication) -> Given | None:
    """The file in use, and what it asks."""
    file = store.world_file
    if file is None:
        return None
    label = file.label
    with st.container(horizontal=True, vertical_alignment="center"):
        st.caption(f"In use: {escape_markdown(label)}")
        st.button(
            "Back to the camera's frame", key="forget_world", on_click=callback(store.forget_world)
        )
    content = file.read_bytes()
    kind = None if is_json(label) else _kind(content, label)
    if kind is None:
        return Given(file, parse_world(content, label), None)
    rate = _frame_rate(project) if kind == FRAME else None
    if kind == FRAME and rate is None:
        st.info("Give the frame rate of the cameras.")
        return Given(file, None, None)
    return Given(file, None, read_observed(content, label, rate))


def _kind(content: bytes, label: str) -> str | None:
    """What the rows of a table are; None for a 4x4 matrix."""
    try:
        return kind_of_table(content, label)
    except StereocalError:
        parse_world(content, label)
        return None


def _rate_field(project: Project) -> Field:
    return setting(project, "world_frame_rate", None, number(0.1, 1e6, or_none=True))


def _frame_rate(project: Project) -> float | None:
    rate = _rate_field(project)
    st.number_input(
        "Frame rate (frames per second)", 0.1, 1e6, None, format="%.6g", **rate.widget()
    )
    value: float | None = rate.value()
    return value


def _found(project: Project, given: Given, rig: RigParameters) -> Pose | None:
    """The frame that a table gives, with its sentence and download."""
    if given.observed is None:
        return None
    settings = _settings(project, given.observed)
    rate = given.observed.frame_rate if isinstance(given.observed, Throw) else None
    frame = _world(digest_of(rig), given.file.name, settings, rate, given, rig)
    st.success(escape_markdown(frame.sentence))
    for note in frame.notes:
        st.caption(escape_markdown(note))
    if residuals := frame.about.get("residuals_m"):
        _show_residuals(residuals)
    offer(f"Download {WORLD_FILE}", lambda: write_world(frame, rig), WORLD_FILE, "download_world")
    return frame.pose


def _show_residuals(residuals: dict[str, list[float]]) -> None:
    rows = [
        {
            "Point": name,
            **{f"{axis} (mm)": 1000 * value for axis, value in zip("xyz", each, strict=True)},
        }
        for name, each in residuals.items()
    ]
    st.caption("Residuals, measured minus surveyed")
    st.dataframe(
        rows,
        hide_index=True,
        height=min(35 * (len(rows) + 1) + 3, 283),
        column_config={
            f"{axis} (mm)": st.column_config.NumberColumn(format="%.1f") for axis in "xyz"
        },
    )


def _settings(project: Project, observed: Observed) -> WorldSettings:
    """Origin and axes, and what else the table does not say."""
    own = SURVEY if isinstance(observed, Survey) else None
    origins: dict[str, str] = {SURVEY: "the survey's own"} if own else {}
    origins[CAMERA] = "the primary camera"
    directions = {SURVEY: "the survey's own"} if own else {}
    directions |= {VIEW: "where the primary looks", BASELINE: "from primary to secondary"}
    drag, upside_down = True, False
    if isinstance(observed, Survey):
        origins |= {name: name for name in observed.names}
    elif isinstance(observed, Throw):
        origins[FIRST] = "the first point of the throw"
    else:
        directions |= {line.name: line.name for line in observed if line.kind == "level"}
    left, middle, right, last = st.columns(4)
    with left:
        origin = _choice(project, "Origin", "world_origin", origins)
    with middle:
        x_axis = _choice(project, "x axis, level", "world_x_axis", directions)
    with right:
        heading = setting(project, "world_heading", 0.0, number(-360.0, 360.0))
        st.number_input(
            "Turned by (°)",
            -360.0,
            360.0,
            step=1.0,
            format="%.4g",
            help="Counter-clockwise, as seen from above.",
            **heading.widget(),
        )
    with last:
        usual = "as the targets" if isinstance(observed, Survey) else "by their scatter"
        sigma_px = ask_noise(noise_field(project, "world_sigma_px"), usual, usual)
    if isinstance(observed, Throw):
        drag = not _switch(project, "A heavy object, which the air does not slow", "world_no_drag")
    elif not isinstance(observed, Survey):
        upside_down = _switch(project, "The cameras hang upside down", "world_upside_down")
    axes = Axes(origin, x_axis, heading.value())
    return WorldSettings(axes, sigma_px, drag=drag, upside_down=upside_down)


def _choice(project: Project, title: str, key: str, options: dict[str, str]) -> str:
    chosen: str = choose(
        project,
        key,
        title,
        options,
        tabs_own=False,
        as_menu=True,
        format_func=lambda name: options.get(name, name),
    )
    return chosen


def _switch(project: Project, title: str, key: str) -> bool:
    chosen = setting(project, key, False, yes_or_no)
    st.checkbox(title, **chosen.widget())
    return bool(chosen.value())


@st.cache_resource(show_spinner="Finding the world frame.", max_entries=16)
def _world(
    rig_digest: str,
    file_digest: str,
    settings: WorldSettings,
    frame_rate: float | None,
    _given: Given,
    _rig: RigParameters,
) -> WorldFrame:
    assert rig_digest and file_digest and (frame_rate is None or frame_rate > 0)
    assert _given.observed is not None
    return jobs.compute(find_world, _rig, _given.observed, settings)
