"""A project from a plan, and the forecast of the plan beside what came out."""

from __future__ import annotations

from typing import Any

import streamlit as st

from stereocal.errors import DAMAGED
from stereocal.field.planning.forecast import PlanForecast
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import write_plan
from stereocal.projects.data_folder import default_home
from stereocal.projects.inputs import LENGTHS, Slot
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.ui.messages import callback
from stereocal.ui.navigation import go_to
from stereocal.ui.plan_fields import show_plan
from stereocal.ui.project import open_project
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import percent

PLAN, FORECAST = "plan", "plan_forecast"


def start_button(found: PlanForecast) -> None:
    """The button that starts a project from a plan."""
    st.button(
        "Start a project from it",
        type="primary",
        key="plan_start",
        on_click=start_project,
        args=(found,),
        help="A new project with these cameras and uncertainties, and with these lengths until "
        "they are measured. The forecast is then shown beside the result.",
    )


@callback
def start_project(found: PlanForecast) -> None:
    """Create a project as the plan states it, and open its Data page (a callback)."""
    project = Project.create(default_home())
    give_plan(project, found)
    open_project(project.id)
    go_to("data")


def give_plan(project: Project, found: PlanForecast) -> None:
    """Store what a plan states in a project, with the plan and its forecast."""
    plan, own = found.plan, found.plan.uncertainty
    files: dict[Slot, tuple[str, bytes]] = {}
    known = {}
    stated = (plan.stated_primary, plan.stated_secondary)
    for which, camera in zip(CAMERAS, stated, strict=True):
        if isinstance(camera, Camera):
            files[which] = (f"{which}.json", write_camera(camera))
            known[which] = [own.focal, own.centre_px]
    project.give(
        files,
        name=plan.name,
        baseline_m=plan.baseline_m,
        target_distance_m=plan.bar_m,
        planned=list(LENGTHS),
        baseline_sigma_m=own.baseline_m or None,
        target_distance_sigma_m=own.bar_m or None,
        lens_known=known,
    )
    project.keep_settings({PLAN: write_plan(plan).decode(), FORECAST: found.to_json()})
    show_plan(project, plan)


def show_planned(project: Project) -> None:
    """What the plan of this project expected, in one line; nothing without a plan."""
    line = planned_line(project.settings.get(FORECAST))
    if line:
        st.caption(escape_markdown(line))


def planned_line(kept: Any) -> str:
    """The forecast of a plan in one line; empty if there is none."""
    try:
        parts = [
            f"{title} {percent(own['value'])} % ({percent(own['low'])} to {percent(own['high'])})"
            for method, title in (("2d", "2D"), ("3d", "3D"), ("refined", "refined"))
            for own in (kept["methods"][method]["median_error_3d"],)
        ]
    except DAMAGED:
        return ""
    return (
        f"The plan expected these median length errors: {', '.join(parts)}; "
        f"95 % of field days are within the brackets."
    )
