"""The Plan page: the forecast of the plan, plans side by side, files, and a project from it."""

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import PurePath
from typing import Any

import streamlit as st

from stereocal.errors import DAMAGED, StereocalError
from stereocal.field.planning.forecast import (
    PlanForecast,
    Reached,
    forecast,
    plan_answer,
    points_per_frame,
)
from stereocal.field.planning.plan import Plan
from stereocal.field.planning.through_window import forecast_through_window
from stereocal.figures import plan_report as figures
from stereocal.figures.tables import plan_table
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.projects.inputs import LENGTHS, Slot
from stereocal.projects.project import Project
from stereocal.projects.server_settings import default_home
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.system.latest import once
from stereocal.system.names import LONGEST
from stereocal.system.numbers import distance, rounded
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import CAMERA_KINDS, take_new
from stereocal.ui.jobs import pool
from stereocal.ui.menu import PRESS_FIRST
from stereocal.ui.messages import ask_if_fisheye, button
from stereocal.ui.navigation import go_to
from stereocal.ui.plan_fields import plan_field, show_plan
from stereocal.ui.print_downloads import field_sheet_to_print, planned_targets_to_print
from stereocal.ui.project import open_project
from stereocal.ui.texts import escape_markdown, markdown_list
from stereocal.verdict.in_words import percent

MOST_PLANS = 3
INSTANT_FRAMES = 60
"""Up to this number, the forecast takes about a second and shows no progress."""
QUANTITIES = {"Length error": "distance", "Position error": "point"}
PLAN, FORECAST = "plan", "plan_forecast"
SIMULATED = "plan_simulated"
"""Name of the setting with the plan behind a window that is to be simulated."""
START = (
    "A new project with these cameras and uncertainties, and with these lengths until they are "
    "measured. The forecast is then shown beside the result."
)
START = (
    "A new project with these cameras and uncertainties, and with these lengths until they are "
    "measured. The forecast is then shown beside the result."
)


def _forecast_of(plan: Plan) -> PlanForecast:
    """The forecast of a plan, with progress where it takes long."""
    place = st.empty()

    def show(done: int, total: int) -> None:
        if plan.frames > INSTANT_FRAMES:
            place.progress(done / total, f"{done} of {total} rigs drawn and calibrated.")

    def make() -> PlanForecast:
        show(0, 1)
        return forecast(plan, pool(), progress=show)

    result = once("plan", write_plan(plan).decode(), make)
    place.empty()
    return result


def open_plan(project: Project | None) -> None:
    """The uploader of a plan; its camera files come with it."""
    title, kinds = "Open a plan (plan.json, and the camera files that it names)", CAMERA_KINDS
    uploads = st.file_uploader(title, kinds, accept_multiple_files=True, key="upload_plan")

    def take(_: object) -> None:
        # All of them: those that are new may be the ones that were missing.
        files = {PurePath(upload.name).name: upload.getvalue() for upload in uploads}
        plans = [name for name, content in files.items() if b"stereocal-plan" in content]
        if len(plans) != 1:
            raise StereocalError(
                "One file of a plan (plan.json) is needed, with the camera files that it names; "
                f"{len(plans)} of these {len(files)} files are plans."
            )
        (plan,) = plans

        def beside(name: str) -> bytes:
            if PurePath(name).name not in files:
                raise StereocalError(f"{plan} names the camera file {name}: upload it too.")
            return files[PurePath(name).name]

        ask_if_fisheye(
            lambda model: show_plan(project, parse_plan(files[plan], plan, beside, model))
        )

    take_new(uploads, take)


def show_forecast(project: Project | None, plan: Plan) -> None:
    """What the plan will measure, what would help, errors by place, plans side by side, files."""
    if plan.window is not None:
        _show_through_window(project, plan)
        return
    result = _forecast_of(plan)
    _show_answer(plan_answer(result), result.reached)
    if result.rigs.failed:
        st.warning(
            f"{result.rigs.failed} of {result.rigs.count} simulated recordings could not be "
            "calibrated: plan more frames, or a larger common view."
        )
    st.markdown("**What would help most**")
    st.markdown(markdown_list(result.advice.sentences[:4]))
    quantity: Any = QUANTITIES[choose(project, "plan_quantity", "Show", QUANTITIES)]
    words = figures.describe_plan_map(result, quantity)
    show_figure(figures.plot_plan_map(result, quantity), words, "plan_map")
    others = []
    for text in _compared(project).value():
        with suppress(StereocalError):  # of an older version
            others.append(_forecast_of(parse_plan(text.encode(), "plan", str.encode)))
    plans = [result, *others]
    left, right = st.columns(2, gap="medium")
    with left:
        st.markdown("**Length error by depth**")
        words = figures.describe_plan_depths(plans)
        show_figure(figures.plot_plan_depths(plans), words, "plan_depths")
    with right:
        st.markdown("**Length error by baseline**")
        words = figures.describe_plan_baselines(result)
        show_figure(figures.plot_plan_baselines(result), words, "plan_baselines")
    _compare(project, result, others)
    _offer_files(project, result)
    planned_targets_to_print(project, plan)
    with st.expander("What each file will do, and how this was computed"):
        st.table(plan_table(result))
        st.caption(escape_markdown(figures.how_computed(result)))


def _show_answer(answer: str, reached: Reached | None) -> None:
    shown = {"yes": st.success, "no": st.warning, "not sure": st.info}[reached or "yes"]
    shown(f"**{escape_markdown(answer)}**")


def _show_through_window(project: Project | None, plan: Plan) -> None:
    """What a plan with a window will measure: simulated by a press, as it takes a while."""
    text = write_plan(plan).decode()
    simulated = setting(project, SIMULATED, "", str)
    if simulated.value() != text:
        st.info("Behind a window, field days are simulated and calibrated: about a minute.")
        ask = partial(simulated.set, text)
        button("Simulate the field days", "plan_simulate", ask, first=True)
        st.session_state[PRESS_FIRST] = True
        return
    place = st.empty()

    def show(done: int, total: int) -> None:
        place.progress(done / total, f"{done} of {total} field days simulated.")

    found = once("plan", text, lambda: forecast_through_window(plan, pool(), progress=show))
    place.empty()
    _show_answer(found.answer, found.reached)
    words = figures.describe_window_plan(found)
    show_figure(figures.plot_window_plan(found), words, "plan_window_view")
    with st.container(horizontal=True):
        offer("Save plan", partial(write_plan, plan), "plan.json", "download_plan.json")
        offer("Forecast", found.dumps, "forecast.json", "download_forecast.json")
        report = partial(figures.window_report, found)
        offer("Report", report, "report.html", "download_report.html")
    st.caption(escape_markdown(figures.window_computed(found)))


def _offer_files(project: Project | None, result: PlanForecast) -> None:
    """The button for a project from the plan, and the downloads."""
    plan, is_lost = result.plan, project is None  # with the tab
    with st.container(horizontal=True):
        label, hint = "Start a project from it", START
        st.session_state[PRESS_FIRST] = is_lost
        button(label, "plan_start", _start_project, result, first=is_lost, help=hint)
        offer("Save plan", partial(write_plan, plan), "plan.json", "download_plan.json")
        offer("Forecast", result.dumps, "forecast.json", "download_forecast.json")
        report = partial(figures.plan_report, result)
        offer("Report", report, "report.html", "download_report.html")
        field_sheet_to_print(plan)


def _compare(project: Project | None, result: PlanForecast, others: Sequence[PlanForecast]) -> None:
    compared, named = _compared(project), plan_field(project, "name")
    texts = [write_plan(other.plan).decode() for other in others]
    text = write_plan(result.plan).decode()

    def change(plan: Plan, kept_then: list[str]) -> None:
        show_plan(project, plan)
        compared.set(kept_then)

    def keep() -> None:
        compared.set([*texts, text])
        named.set(f"Plan {len(texts) + 2}")  # of the one that is changed next

    if others:
        first, *columns = st.columns(len(others) + 1)
        with first, st.container(border=True):
            _summary(result, f"{result.plan.name} (above)")
        for index, (column, other) in enumerate(zip(columns, others, strict=True)):
            rest = [*texts[:index], *texts[index + 1 :]]
            with column, st.container(border=True):
                _summary(other, other.plan.name)
                with st.container(horizontal=True):
                    kept = [*rest, text]
                    button("Change this one", f"plan_show_{index}", change, other.plan, kept)
                    button("Remove", f"plan_drop_{index}", compared.set, rest)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        st.text_input("Name of this plan", max_chars=LONGEST, **named.widget())
        full = len(texts) >= MOST_PLANS - 1 or text in texts
        hint = "Then change the plan: up to three are shown side by side."
        button("Keep it to compare", "plan_keep", keep, disabled=full, help=hint)


def _summary(result: PlanForecast, title: str) -> None:
    by_depth = result.fit.by_depth
    st.markdown(f"**{escape_markdown(title)}**")
    st.markdown(
        f"95 % of lengths within {percent(by_depth.length_p95[-1])} % at "
        f"{rounded(by_depth.depths_m[-1], 3)} m  \n"
        f"Positions to {distance(float(by_depth.position_m[-1]))} there  \n"
        f"{points_per_frame(result)} points a frame  \n"
        f"Limited by: {result.advice.limited_by}"
    )


def _compared(project: Project | None) -> Field:
    """The files of the plans kept for comparison."""
    return setting(
        project, "plan_compared", [], lambda texts: [str(text) for text in texts][: MOST_PLANS - 1]
    )


def _start_project(result: PlanForecast) -> None:
    """Create a project as the plan states it, and open its Data page (a callback)."""
    project = Project.create(default_home())
    plan, uncertainty = result.plan, result.plan.uncertainty
    files: dict[Slot, tuple[str, bytes]] = {
        which: (f"{which}.json", write_camera(camera))
        for which, camera in zip(CAMERAS, (plan.stated_primary, plan.stated_secondary), strict=True)
        if isinstance(camera, Camera)
    }
    project.give(
        files,
        name=plan.name,
        baseline_m=plan.baseline_m,
        target_distance_m=plan.bar_m,
        planned=list(LENGTHS),
        baseline_sigma_m=uncertainty.baseline_m or None,
        target_distance_sigma_m=uncertainty.bar_m or None,
        lens_known={which: [uncertainty.focal, uncertainty.centre_px] for which in files},
    )
    project.keep_settings({PLAN: write_plan(plan).decode(), FORECAST: result.to_json()})
    show_plan(project, plan)
    open_project(project.id)
    go_to("data")


def show_planned(project: Project) -> None:
    """What the plan of this project expected, in one line; nothing without a plan."""
    stored: Any = project.settings.get(FORECAST)
    with suppress(*DAMAGED):
        methods = []
        for method, title in (("2d", "2D"), ("3d", "3D"), ("refined", "refined")):
            figure = stored["methods"][method]["p95_error_3d"]
            value, low, high = (percent(figure[key]) for key in ("value", "low", "high"))
            methods.append(f"{title} {value} % ({low} to {high})")
        expected = f"The plan expected 95 % of lengths within: {', '.join(methods)}"
        st.caption(escape_markdown(f"{expected}; 95 % of field days are within the brackets."))
