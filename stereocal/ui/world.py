"""The fold "World frame" of the Apply page: a table or world.json, the frame, its download."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import pandas as pd
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
from stereocal.ui.apply_threshold import ask_noise, noise_field
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, Number, choose, setting, yes_or_no
from stereocal.ui.intake import take_one
from stereocal.ui.messages import callback
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
    refused, world = None, None
    with st.expander("World frame", expanded=_lacks_frame_rate(project, store)):
        try:
            given = _given(project, store)
            upload = st.file_uploader(
                "Surveyed points, plumb lines or a throw; or world.json",
                type=["csv", "txt", "tsv", "json"],
                key="upload_world",
                help=HELP,
            )
            take_one(upload, store.keep_world)
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
    with suppress(StereocalError):
        return kind_of_table(found.read_bytes(), found.label) == FRAME
    return False


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
    content, kind = file.read_bytes(), None
    if not is_json(label):
        with suppress(StereocalError):
            kind = kind_of_table(content, label)
    if kind is None:  # or a 4x4 matrix
        return Given(file, parse_world(content, label), None)
    title = "Frame rate (frames per second)"
    rate = _rate_field(project).number_input(title, format="%.6g") if kind == FRAME else None
    if kind == FRAME and rate is None:
        st.info("Give the frame rate of the cameras.")
        return Given(file, None, None)
    return Given(file, None, read_observed(content, label, rate))


def _rate_field(project: Project) -> Field:
    return setting(project, "world_frame_rate", None, Number(0.1, 1e6, or_none=True))


def _found(project: Project, given: Given, rig: RigParameters) -> Pose | None:
    """The frame that a table gives, with its sentence and download."""
    if given.observed is None:
        return None
    frame = _world(given, rig, _settings(project, given.observed))
    st.success(escape_markdown(frame.sentence))
    for note in frame.notes:
        st.caption(escape_markdown(note))
    if residuals := frame.about.get("residuals_m"):
        axes = [f"{axis} (mm)" for axis in "xyz"]
        table = 1000 * pd.DataFrame.from_dict(residuals, orient="index", columns=axes)
        st.caption("Residuals, measured minus surveyed")
        st.dataframe(
            table.rename_axis("Point").reset_index(),
            hide_index=True,
            height=min(35 * (len(table) + 1) + 3, 283),
            column_config=dict.fromkeys(axes, st.column_config.NumberColumn(format="%.1f")),
        )
    offer(f"Download {WORLD_FILE}", lambda: write_world(frame, rig), WORLD_FILE, "download_world")
    return frame.pose


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
        turned = setting(project, "world_heading", 0.0, Number(-360.0, 360.0))
        told = "Counter-clockwise, as seen from above."
        heading = turned.number_input("Turned by (°)", step=1.0, help=told)
    with last:
        usual = "as the targets" if isinstance(observed, Survey) else "by their scatter"
        sigma_px = ask_noise(noise_field(project, "world_sigma_px"), usual, usual)
    if isinstance(observed, Throw):
        drag = not _switch(project, "A heavy object, which the air does not slow", "world_no_drag")
    elif not isinstance(observed, Survey):
        upside_down = _switch(project, "The cameras hang upside down", "world_upside_down")
    axes = Axes(origin, x_axis, heading)
    return WorldSettings(axes, sigma_px, drag=drag, upside_down=upside_down)


def _choice(project: Project, title: str, key: str, options: dict[str, str]) -> str:
    named = options.__getitem__
    chosen: str = choose(
        project, key, title, options, tabs_own=False, as_menu=True, format_func=named
    )
    return chosen


def _switch(project: Project, title: str, key: str) -> bool:
    return st.checkbox(title, **setting(project, key, False, yes_or_no).widget())


BY_CONTENT: dict[str | type, Callable[[Any], Any]] = {
    Given: lambda given: (given.file.name, getattr(given.observed, "frame_rate", None)),
    RigParameters: digest_of,
}


@st.cache_resource(show_spinner="Finding the world frame.", max_entries=16, hash_funcs=BY_CONTENT)
def _world(given: Given, rig: RigParameters, settings: WorldSettings) -> WorldFrame:
    assert given.observed is not None
    return jobs.compute(find_world, rig, given.observed, settings)
