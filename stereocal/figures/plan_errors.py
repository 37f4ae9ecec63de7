"""Figures of a plan: errors by place, by depth for several plans, and by baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go

from stereocal.field.planning.forecast import PlanForecast
from stereocal.figures.accuracy import Quantity, describe_accuracy, plot_accuracy
from stereocal.figures.style import NEUTRAL, finish, sentence_only
from stereocal.refined.uncertainty import AccuracyMap
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent

PLAN_COLOURS = ("#1F83C4", "#D55E00", "#A1458A")
PLAN_DASHES = ("solid", "dash", "dot")
PLAN_SYMBOLS = ("circle", "triangle-up", "diamond")
HEIGHT = 340
NO_BASELINE = "No other baseline could be tried: the cameras would lose their common view."


def plot_plan_map(found: PlanForecast, quantity: Quantity = "distance") -> go.Figure:
    """Errors in the volume, from above and from the side, with bars as they may be placed."""
    result, frames = found.fit.result, found.plan.frames
    few = {name: getattr(result, name)[:frames] for name in ("points_m", "outlying", "frame_of")}
    shown = replace(result, **few)
    return plot_accuracy(_maps(found), shown, quantity)


def describe_plan_map(found: PlanForecast, quantity: Quantity = "distance") -> str:
    """The figure in words."""
    return describe_accuracy(_maps(found), quantity)


def plot_plan_depths(plans: Sequence[PlanForecast]) -> go.Figure:
    """Mean length error against depth, a line for each of up to three plans."""
    figure = go.Figure()
    for at, found in enumerate(plans):
        depths, length, _ = found.fit.by_depth
        name = found.plan.name if len(plans) > 1 else "Length error"
        figure.add_scatter(
            x=depths,
            y=100 * length,
            name=name,
            mode="lines+markers",
            line={"color": PLAN_COLOURS[at], "dash": PLAN_DASHES[at], "width": 2},
            marker={"symbol": PLAN_SYMBOLS[at], "size": 8},
            hovertemplate="%{x:.3~r} m<br>%{y:.2~r} %<extra>" + "%{fullData.name}</extra>",
        )
    finish(figure, HEIGHT)
    figure.update_layout(showlegend=len(plans) > 1)
    figure.update_xaxes(title_text="Depth ahead of the primary camera (m)")
    figure.update_yaxes(title_text="Mean length error (%)", rangemode="tozero")
    return figure


def describe_plan_depths(plans: Sequence[PlanForecast]) -> str:
    """The figure in words."""
    parts = []
    for found in plans:
        depths, length, _ = found.fit.by_depth
        known = np.flatnonzero(np.isfinite(length))
        first, last = known[0], known[-1]
        parts.append(
            f"{found.plan.name}: {percent(length[first])} % at {rounded(depths[first], 3)} m, "
            f"{percent(length[last])} % at {rounded(depths[last], 3)} m"
        )
    return f"Mean length error of the refined set against depth. {'; '.join(parts)}."


def plot_plan_baselines(found: PlanForecast) -> go.Figure:
    """Mean length error in the volume against the baseline."""
    advice, planned = found.advice, found.plan.baseline_m
    known = np.isfinite(advice.baseline_errors)
    if known.sum() < 2:
        return sentence_only(NO_BASELINE)
    baselines, errors = advice.baselines_m[known], 100 * advice.baseline_errors[known]
    figure = go.Figure()
    figure.add_scatter(
        x=baselines,
        y=errors,
        mode="lines+markers",
        name="other baselines",
        line={"color": NEUTRAL, "width": 2},
        marker={"size": 8},
        hovertemplate="%{x:.3~r} m<br>%{y:.2~r} %<extra></extra>",
    )
    figure.add_scatter(
        x=[planned],
        y=[100 * advice.length_error],
        mode="markers+text",
        text=["planned"],
        textposition="top right",
        name="planned",
        cliponaxis=False,
        marker={"size": 13, "symbol": "diamond", "color": PLAN_COLOURS[0]},
        hovertemplate="planned: %{x:.3~r} m<br>%{y:.2~r} %<extra></extra>",
    )
    finish(figure, HEIGHT)
    figure.update_layout(showlegend=False)
    ticks = [float(f"{b:.2g}") for b in baselines]
    figure.update_xaxes(
        title_text="Baseline (m)",
        type="log",
        tickvals=baselines,
        ticktext=[f"{b:g}" for b in ticks],
    )
    figure.update_yaxes(title_text="Mean length error (%)", rangemode="tozero")
    return figure


def describe_plan_baselines(found: PlanForecast) -> str:
    """The figure in words."""
    advice = found.advice
    known = np.flatnonzero(np.isfinite(advice.baseline_errors))
    if len(known) < 2:
        return NO_BASELINE
    best = known[int(np.argmin(advice.baseline_errors[known]))]
    return (
        "Mean length error against the baseline, the cameras aimed at the same place: "
        f"{percent(advice.length_error)} % with {rounded(found.plan.baseline_m, 3)} m as planned, "
        f"least with {rounded(advice.baselines_m[best], 3)} m, "
        f"{percent(advice.baseline_errors[best])} %. A baseline is not tried where less than 60 % "
        "of the common view would be left."
    )


def _maps(found: PlanForecast) -> list[AccuracyMap]:
    return [found.fit.map("above"), found.fit.map("side")]
