"""The fold "World frame" of the Apply page: a table or world.json, the frame, its download."""

from contextlib import suppress
from functools import partial

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.field.world import frame
from stereocal.field.world.find import find_world
from stereocal.field.world.frame import Axes, Observed, Survey, Throw, WorldSettings
from stereocal.fit.rig_file import Parameters
from stereocal.formats.world_file import (
    FRAME,
    is_json,
    kind_of_table,
    pair_in_table,
    parse_world,
    read_observed,
    write_world,
)
from stereocal.projects.application import ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, camera_in_words
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import CameraPair
from stereocal.system.latest import once_or_refused
from stereocal.ui import jobs
from stereocal.ui.apply_points import ask_noise, noise_field
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose_from_menu, setting, yes_or_no
from stereocal.ui.intake import take_one
from stereocal.ui.messages import ErrorsShown, button, show_each
from stereocal.ui.texts import escape_markdown

WORLD_FILE = "world.json"
KINDS = ["csv", "txt", "tsv", "json"]
HELP = (
    "A table of surveyed points (point,x,y,z and the pixels of both cameras), of plumb lines, "
    "level lines or a horizon (line,kind and pixels), or of a throw (frame and pixels); or "
    "world.json, or a 4x4 matrix."
)
OF_RIG = "The pixels are those of two cameras of the rig, as the columns u_{0},v_{0},u_{1},v_{1}."


def choose_world(project: Project, store: ProjectApplication, rig: Parameters) -> Pose | None:
    """The fold; returns `world_from_primary`, of a rig `world_from_reference`; None for points in
    the camera's frame."""
    camera, hint = camera_in_words(next(iter(rig.placed))), HELP
    if (names := [*rig.placed]) != [*CAMERAS]:
        hint = f"{HELP} {OF_RIG.format(*names)}"
    file, world, refused = store.world_file, None, list[str]()
    rate = setting(project, "world_frame_rate", None, Number(0.1, 1e6, or_none=True))
    kind = None  # None also for a file that states the frame itself: JSON, or a 4x4 matrix
    if file is not None and not is_json(file.label):
        with suppress(StereocalError):
            kind = kind_of_table(file.read_bytes(), file.label)
    opened = kind == FRAME and rate.value() is None
    with st.expander("World frame", expanded=opened), ErrorsShown(refused.append):
        if file is not None:
            with st.container(horizontal=True, vertical_alignment="center"):
                st.caption(f"In use: {escape_markdown(file.label)}")
                button("Back to the camera's frame", "forget_world", store.forget_world)
            if kind == FRAME:
                rate.number_input("Frame rate (frames per second)", format="%.6g")
        title = "Surveyed points, plumb lines or a throw; or world.json"
        upload = st.file_uploader(title, type=KINDS, key="upload_world", help=hint)
        take_one(upload, partial(store.keep_world, rig=rig))
        if file is None:
            st.caption(
                f"Points are in the frame of {escape_markdown(camera)}. A table of surveyed "
                "points, plumb lines or a throw gives them a world frame with a known vertical."
            )
        elif kind is None:
            world = parse_world(file.read_bytes(), file.label)
        elif kind == FRAME and rate.value() is None:
            st.info("Give the frame rate of the cameras.")
        else:
            fps = rate.value() if kind == FRAME else None
            world = _found(project, file, fps, rig)
    for why in refused:
        where = f"Until then, points are in the frame of {escape_markdown(camera)}."
        st.error(f"World frame: {why} {where}")
    return world


def _found(project: Project, file: StoredFile, rate: float | None, rig: Parameters) -> Pose:
    """The frame that a table gives, with its sentence and download."""
    content = file.read_bytes()
    cameras = pair_in_table(rig, content, file.label)
    observed = read_observed(content, file.label, rate, cameras)
    settings = _settings(project, observed, cameras)
    with st.spinner("Finding the world frame."):
        world = once_or_refused(
            "world frame",
            f"{file.sha256} {rate} {rig.digest} {cameras} {settings}",
            lambda: jobs.compute(find_world, rig, observed, settings, cameras),
        )
    st.success(escape_markdown(world.sentence))
    show_each(st.caption, world.notes)
    if residuals := world.about.get("residuals_m"):
        axes = [f"{axis} (mm)" for axis in "xyz"]
        table = 1000 * pd.DataFrame.from_dict(residuals, orient="index", columns=axes)
        st.caption("Residuals, measured minus surveyed")
        table, height = table.rename_axis("Point").reset_index(), min(35 * len(table) + 38, 283)
        columns = dict.fromkeys(axes, st.column_config.NumberColumn(format="%.1f"))
        st.dataframe(table, hide_index=True, height=height, column_config=columns)
    offer(f"Download {WORLD_FILE}", lambda: write_world(world, rig), WORLD_FILE, "download_world")
    return world.pose


def _settings(project: Project, observed: Observed, cameras: CameraPair) -> WorldSettings:
    """Origin and axes, and what else the table does not say."""
    survey, throw = isinstance(observed, Survey), isinstance(observed, Throw)
    origins = {frame.SURVEY: "the survey's own"} if survey else {}
    first, second = map(camera_in_words, cameras)
    directions = {
        **origins,
        frame.VIEW: f"where {first} looks",
        frame.BASELINE: f"from {first} to {second}",
    }
    origins[frame.CAMERA] = first
    if isinstance(observed, Survey):
        origins |= {name: name for name in observed.names}
    elif isinstance(observed, Throw):
        origins[frame.FIRST] = "the first point of the throw"
    else:
        directions |= {line.name: line.name for line in observed if line.kind == "level"}
    left, middle, right, last = st.columns(4)
    menus = (("origin", "Origin", origins, left), ("x_axis", "x axis, level", directions, middle))
    origin, x_axis = (
        choose_from_menu(
            project, f"world_{key}", title, options, place=place, format_func=options.__getitem__
        )
        for key, title, options, place in menus
    )
    turned = setting(project, "world_heading", 0.0, Number(-360.0, 360.0))
    hint = "Counter-clockwise, as seen from above."
    heading = turned.number_input("Turned by (°)", right, step=1.0, help=hint)
    with last:
        usual = "as the targets" if survey else "by their scatter"
        sigma_px = ask_noise(noise_field(project, "world_sigma_px"), usual, usual)
    heavy = throw and _switch(project, "A heavy object, which the air does not slow", "no_drag")
    hangs = not (survey or throw) and _switch(
        project, "The cameras hang upside down", "upside_down"
    )
    axes = Axes(origin, x_axis, heading)
    return WorldSettings(axes, sigma_px, drag=not heavy, upside_down=hangs)


def _switch(project: Project, title: str, name: str) -> bool:
    return st.checkbox(title, **setting(project, f"world_{name}", False, yes_or_no).widget())
