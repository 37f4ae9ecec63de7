"""The Plan page: the forecast of the plan, plans side by side, files, and a project from it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import PurePath
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.field.planning.forecast import PlanForecast, forecast
from stereocal.field.planning.in_words import answer, points_per_frame
from stereocal.field.planning.plan import Plan
from stereocal.figures.forecast_table import plan_table
from stereocal.figures.plan_errors import (
    describe_plan_baselines,
    describe_plan_depths,
    describe_plan_map,
    plot_plan_baselines,
    plot_plan_depths,
    plot_plan_map,
)
from stereocal.figures.plan_report import how_computed, plan_report
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.projects.project import Project
from stereocal.rig.camera import LensModel
from stereocal.system.latest import Latest
from stereocal.system.numbers import rounded
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import CAMERA_KINDS, clear_refusal, take_new
from stereocal.ui.jobs import pool
from stereocal.ui.messages import callback
from stereocal.ui.plan_fields import LONGEST_NAME, show_plan
from stereocal.ui.refusal import ask_lens
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import distance, percent

KEPT_FORECASTS = 24
MOST_PLANS = 3
INSTANT_FRAMES = 60
"""Up to this number, the forecast takes about a second and shows no progress."""
QUANTITIES = {"Length error": "distance", "Position error": "point"}


@st.cache_resource(show_spinner=False)
def _forecasts() -> Latest[PlanForecast]:
    """Forecasts of this server by their plan, as its file."""
    return Latest(KEPT_FORECASTS)


def forecast_of(plan: Plan) -> PlanForecast:
    """The forecast of a plan, with progress where it takes long."""
    key = write_plan(plan).decode()
    if (kept := _forecasts().get(key)) is not None:
        return kept
    if plan.frames <= INSTANT_FRAMES:
        found = forecast(plan, pool())
    else:
        place = st.empty()

        def show(done: int, total: int) -> None:
            place.progress(done / total, f"{done} of {total} rigs drawn and calibrated.")

        show(0, 1)
        found = forecast(plan, pool(), progress=show)
        place.empty()
    _forecasts().keep(key, found)
    return found


def open_plan(project: Project | None) -> None:
    """The uploader of a plan; its camera files come with it."""
    uploads = st.file_uploader(
        "Open a plan (plan.json, and the camera files that it names)",
        type=CAMERA_KINDS,
        key="upload_plan",
        accept_multiple_files=True,
    )
    take_new(
        uploads,
        lambda _: _take_plan(project, {PurePath(one.name).name: one.getvalue() for one in uploads}),
    )


def _take_plan(
    project: Project | None, files: dict[str, bytes], model: LensModel | None = None
) -> None:
    """Show the plan among uploaded files; if a camera may be a fisheye's, ask."""
    try:
        plan = _plan_in(files, model)
    except FourCoefficientsError as error:
        ask_lens(error, lambda model: callback(partial(_take_plan, project, files, model))())
        return
    show_plan(project, plan)
    clear_refusal()


def _plan_in(files: dict[str, bytes], model: LensModel | None) -> Plan:
    plans = [name for name, content in files.items() if b"stereocal-plan" in content]
    if len(plans) != 1:
        raise StereocalError(
            "One file of a plan (plan.json) is needed, with the camera files that it names; "
            f"{len(plans)} of these {len(files)} files are plans."
        )

    def beside(name: str) -> bytes:
        if PurePath(name).name not in files:
            raise StereocalError(f"{plans[0]} names the camera file {name}: upload it too.")
        return files[PurePath(name).name]

    return parse_plan(files[plans[0]], plans[0], beside, model)


def show_answer(found: PlanForecast) -> None:
    """What the plan will measure, and what would help."""
    st.success(f"**{escape_markdown(answer(found))}**")
    if found.failed:
        st.warning(
            f"{found.failed} of {found.rigs.count} simulated recordings could not be "
            "calibrated: plan more frames, or a larger common view."
        )
    st.markdown("**What would help most**")
    st.markdown("\n".join(f"- {escape_markdown(text)}" for text in found.advice.sentences[:4]))


def show_places(project: Project | None, found: PlanForecast) -> None:
    """Errors by place, from above and from the side."""
    quantity: Any = QUANTITIES[choose(project, "plan_quantity", "Show", QUANTITIES)]
    show_figure(plot_plan_map(found, quantity), describe_plan_map(found, quantity), "plan_map")


def show_curves(found: PlanForecast, others: Sequence[PlanForecast]) -> None:
    """Errors by depth, of all compared plans, and by baseline."""
    left, right = st.columns(2, gap="medium")
    with left:
        plans = [found, *others]
        st.markdown("**Length error by depth**")
        show_figure(plot_plan_depths(plans), describe_plan_depths(plans), "plan_depths")
    with right:
        st.markdown("**Length error by baseline**")
        show_figure(plot_plan_baselines(found), describe_plan_baselines(found), "plan_baselines")


def show_details(found: PlanForecast) -> None:
    """The figures of the files, folded."""
    with st.expander("What each file will do, and how this was computed"):
        st.table(plan_table(found))
        st.caption(escape_markdown(how_computed(found)))


def compared_plans(project: Project | None) -> list[PlanForecast]:
    """The forecasts of the plans kept for comparison."""
    found = []
    for text in _compared(project).value():
        try:
            found.append(forecast_of(parse_plan(text.encode(), "plan", str.encode)))
        except StereocalError:  # of an older version
            continue
    return found


def show_comparison(
    project: Project | None, found: PlanForecast, others: Sequence[PlanForecast]
) -> None:
    """Up to three plans side by side."""
    kept = _compared(project)
    texts = [write_plan(other.plan).decode() for other in others]
    own = write_plan(found.plan).decode()
    if others:
        columns = st.columns(len(others) + 1)
        with columns[0], st.container(border=True):
            _summary(found, f"{found.plan.name} (above)")
        for at, (column, other) in enumerate(zip(columns[1:], others, strict=True)):
            rest = [text for number, text in enumerate(texts) if number != at]
            with column, st.container(border=True):
                _summary(other, other.plan.name)
                with st.container(horizontal=True):
                    st.button(
                        "Change this one",
                        key=f"plan_show_{at}",
                        on_click=callback(_swap),
                        args=(project, other.plan, [*rest, own]),
                    )
                    st.button(
                        "Remove", key=f"plan_drop_{at}", on_click=callback(kept.set), args=(rest,)
                    )
    with st.container(horizontal=True, vertical_alignment="bottom"):
        st.text_input("Name of this plan", max_chars=LONGEST_NAME, **_name(project).widget())
        st.button(
            "Keep it to compare",
            key="plan_keep",
            on_click=callback(_keep),
            args=(project, [*texts, own]),
            disabled=len(texts) >= MOST_PLANS - 1 or own in texts,
            help="Then change the plan: up to three are shown side by side.",
        )


def _keep(project: Project | None, kept: list[str]) -> None:
    """Keep a plan; the one that is changed next gets a name of its own."""
    _compared(project).set(kept)
    _name(project).set(f"Plan {len(kept) + 1}")


def _swap(project: Project | None, plan: Plan, kept: list[str]) -> None:
    show_plan(project, plan)
    _compared(project).set(kept)


def _summary(found: PlanForecast, title: str) -> None:
    depths, length, position = found.fit.by_depth
    st.markdown(f"**{escape_markdown(title)}**")
    st.markdown(
        f"Length {percent(length[-1])} % at {rounded(depths[-1], 3)} m  \n"
        f"Position {distance(float(position[-1]))} there  \n"
        f"{points_per_frame(found)} points a frame  \n"
        f"Limited by: {found.advice.limited_by}"
    )


def plan_downloads(found: PlanForecast) -> None:
    """The plan, its forecast, and the report."""
    for label, make, name in (
        ("Save plan", partial(write_plan, found.plan), "plan.json"),
        ("Forecast", found.dumps, "forecast.json"),
        ("Report", partial(plan_report, found), "report.html"),
    ):
        offer(label, make, name, f"download_{name}")


def _compared(project: Project | None) -> Field:
    return setting(project, "plan_compared", [], _texts)


def _name(project: Project | None) -> Field:
    return setting(project, "plan_name", "Plan", str)


def _texts(value: Any) -> list[str]:
    return [str(text) for text in value][: MOST_PLANS - 1]
