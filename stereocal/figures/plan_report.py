"""A plan in figures, by place, by depth for several plans and by baseline, and in a report: one
HTML file that holds everything and opens without a network."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.field.planning.forecast import PlanForecast, plan_answer
from stereocal.field.planning.plan import AimedPose, Plan
from stereocal.field.planning.through_window import WindowForecast
from stereocal.figures.accuracy import Quantity, describe_accuracy, plot_accuracy
from stereocal.figures.html import html_figure, html_list, html_page, html_table, paragraphs
from stereocal.figures.style import (
    METHOD_COLOURS,
    add_trace,
    blank,
    line_of,
    sentence_only,
    with_gaps,
)
from stereocal.figures.tables import plan_table
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits, percent
from stereocal.version import __version__

PLAN_STYLES = (
    (METHOD_COLOURS["2d"], "solid", "circle"),
    (METHOD_COLOURS["3d"], "dash", "triangle-up"),
    (METHOD_COLOURS["refined"], "dot", "diamond"),
)
HEIGHT = 340
HOVER = "%{x:.3~r} m<br>%{y:.2~r} %"
NO_BASELINE = "No other baseline could be tried: the cameras would lose their common view."


def plot_plan_map(forecast: PlanForecast, quantity: Quantity = "distance") -> go.Figure:
    """Errors in the volume, from above and from the side, with bars as they may be placed."""
    result, frames = forecast.fit.result, forecast.plan.frames
    few = {name: getattr(result, name)[:frames] for name in ("points_m", "outlying", "frame_of")}
    shown = replace(result, **few)
    return plot_accuracy(forecast.fit.maps, shown, quantity)


def describe_plan_map(forecast: PlanForecast, quantity: Quantity = "distance") -> str:
    """The figure in words."""
    return describe_accuracy(forecast.fit.maps, quantity)


def plot_plan_depths(plans: Sequence[PlanForecast]) -> go.Figure:
    """What 95 % of lengths are within against depth, a line for each of up to three plans."""
    figure = blank(HEIGHT)
    for forecast, (colour, dash, symbol) in zip(plans, PLAN_STYLES, strict=False):
        by_depth = forecast.fit.by_depth
        name = forecast.plan.name if len(plans) > 1 else "95 % of lengths"
        points = np.column_stack([by_depth.depths_m, 100 * by_depth.length_p95])
        style = {"line": line_of(colour, 2, dash), "marker": {"symbol": symbol, "size": 8}}
        add_trace(figure, points, f"{HOVER}<extra>%{{fullData.name}}</extra>", name=name, **style)
    figure.update_layout(showlegend=len(plans) > 1)
    figure.update_xaxes(title_text="Depth ahead of the primary camera (m)")
    figure.update_yaxes(title_text="95 % of lengths within (%)", rangemode="tozero")
    return figure


def describe_plan_depths(plans: Sequence[PlanForecast]) -> str:
    """The errors at the least and the largest depth of each plan."""
    parts = []
    for forecast in plans:
        depths, length = forecast.fit.by_depth.depths_m, forecast.fit.by_depth.length_p95
        known = np.flatnonzero(np.isfinite(length))
        first, last = known[0], known[-1]
        parts.append(
            f"{forecast.plan.name}: {percent(length[first])} % at {rounded(depths[first], 3)} m, "
            f"{percent(length[last])} % at {rounded(depths[last], 3)} m"
        )
    return f"What 95 % of lengths are within, by depth, of the refined set. {'; '.join(parts)}."


def plot_plan_baselines(forecast: PlanForecast) -> go.Figure:
    """What 95 % of lengths in the volume are within, against the baseline."""
    advice, planned = forecast.advice, forecast.plan.baseline_m
    known = np.isfinite(advice.baseline_errors)
    if known.sum() < 2:
        return sentence_only(NO_BASELINE)
    baselines, errors = advice.baselines_m[known], 100 * advice.baseline_errors[known]
    figure = blank(HEIGHT)
    others = np.column_stack([baselines, errors])
    add_trace(figure, others, HOVER, name="other baselines", line=line_of(), marker={"size": 8})
    marker = {"size": 13, "symbol": "diamond", "color": PLAN_STYLES[0][0]}
    text = {"text": ["planned"], "textposition": "top right", "cliponaxis": False}
    point = np.array([[planned, 100 * forecast.fit.length_p95]])
    add_trace(figure, point, f"planned: {HOVER}", name="planned", marker=marker, **text)
    figure.update_layout(showlegend=False)
    ticks = {"tickvals": baselines, "ticktext": [f"{float(f'{b:.2g}'):g}" for b in baselines]}
    figure.update_xaxes(title_text="Baseline (m)", type="log", **ticks)
    figure.update_yaxes(title_text="95 % of lengths within (%)", rangemode="tozero")
    return figure


def describe_plan_baselines(forecast: PlanForecast) -> str:
    """The errors with the planned and with the best baseline."""
    advice = forecast.advice
    known = np.flatnonzero(np.isfinite(advice.baseline_errors))
    if len(known) < 2:
        return NO_BASELINE
    best = known[int(np.argmin(advice.baseline_errors[known]))]
    return (
        "What 95 % of lengths are within, by baseline, the cameras aimed at the same place: "
        f"{percent(forecast.fit.length_p95)} % with {rounded(forecast.plan.baseline_m, 3)} m as "
        f"planned, least with {rounded(advice.baselines_m[best], 3)} m, "
        f"{percent(advice.baseline_errors[best])} %. A baseline is not tried where less than 60 % "
        "of the common view would be left."
    )


def plan_report(forecast: PlanForecast) -> str:
    """The text of the file."""
    plans = [forecast]
    sections = {
        "What would help most": html_list(forecast.advice.sentences),
        "Errors by place": html_figure(plot_plan_map(forecast), describe_plan_map(forecast)),
        "Errors by depth": html_figure(plot_plan_depths(plans), describe_plan_depths(plans)),
        "Errors by baseline": html_figure(
            plot_plan_baselines(forecast), describe_plan_baselines(forecast)
        ),
        "What the files will do": html_table(plan_table(forecast)),
        "How it was computed": paragraphs(how_computed(forecast)),
        "The plan": html_table(_contents(forecast.plan)),
    }
    return html_page(f"Forecast of the plan {forecast.plan.name}", plan_answer(forecast), sections)


def plot_window_plan(forecast: WindowForecast) -> go.Figure:
    """The cameras, the window and bars behind it, from above."""
    plan, figure = forecast.plan, blank(HEIGHT)
    add_trace(figure, with_gaps(forecast.bars[..., [0, 2]]), name="bars", line=line_of())
    centres = np.array([np.zeros(3), plan.pose.inverse().T])[:, [0, 2]]
    marker = {"size": 12, "symbol": "triangle-up", "color": PLAN_STYLES[0][0]}
    text = {"text": ["primary", "secondary"], "textposition": "top center", "cliponaxis": False}
    add_trace(figure, centres, name="cameras", marker=marker, mode="markers+text", **text)
    window = plan.primary.window
    assert window is not None
    shown = np.concatenate([centres, forecast.bars[..., [0, 2]].reshape(-1, 2)])
    x, (across, _, ahead) = np.array([shown[:, 0].min(), shown[:, 0].max()]), window.normal
    for distance_m in (window.distance_m, window.distance_m + window.thickness_m):
        face = np.column_stack([x, (distance_m - across * x) / ahead])
        add_trace(figure, face, name="window", line=line_of(PLAN_STYLES[2][0], 2))
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title_text="To the right of the primary camera (m)")
    ahead_title = "Ahead of the primary camera (m)"
    figure.update_yaxes(title_text=ahead_title, scaleanchor="x", constrain="domain")
    return figure


def describe_window_plan(forecast: WindowForecast) -> str:
    """The figure in words."""
    plan, window = forecast.plan, forecast.plan.primary.window
    assert window is not None
    return (
        f"From above: both cameras, the window {rounded(window.distance_m, 3)} m from the primary "
        f"camera, and bars behind it from {rounded(plan.near_m, 3)} to {rounded(plan.far_m, 3)} m."
    )


def window_report(forecast: WindowForecast) -> str:
    """The text of the file of a plan with a window."""
    figure = html_figure(plot_window_plan(forecast), describe_window_plan(forecast))
    sections = {
        "From above": figure,
        "How it was computed": paragraphs(window_computed(forecast)),
        "The plan": html_table(_contents(forecast.plan)),
    }
    return html_page(f"Forecast of the plan {forecast.plan.name}", forecast.answer, sections)


def window_computed(forecast: WindowForecast) -> str:
    """What was simulated, in words."""
    return (
        f"{len(forecast.p95)} field days were simulated, whose focal lengths, principal points, "
        f"baseline and bar differ from the plan as it says; each recording of "
        f"{forecast.plan.frames} bars was calibrated with the distance and the tilt of the window "
        f"to be found, and {len(forecast.bars)} fresh bars were measured. The median is given, "
        "with the least and the largest. Length errors are relative to true lengths. Computed by "
        f"stereocal {__version__} with the seed {forecast.seed}."
    )


def how_computed(forecast: PlanForecast) -> str:
    """What was drawn and simulated, in words."""
    plan, rigs = forecast.plan, forecast.rigs
    failed = f" {rigs.failed} of them could not be calibrated." if rigs.failed else ""
    return (
        f"{rigs.count} rigs were drawn, whose focal lengths, principal points, baseline and bar "
        f"differ from the plan as it says; on each a recording of {plan.frames} bars was simulated "
        f"and calibrated, and the files were judged on fresh bars.{failed} Intervals hold 95 % of "
        "the rigs. Errors by place are those to be expected of the refined set. Length errors are "
        "relative to true lengths, so the error of the bar itself, "
        f"{percent(plan.uncertainty.bar_m / plan.bar_m)} %, is in them. Computed by "
        f"stereocal {__version__} with the seed {forecast.seed}."
    )


def _contents(plan: Plan) -> pd.DataFrame:
    sigmas, pose = plan.uncertainty, plan.stated_pose
    lines = {
        "Primary camera": plan.primary.in_words,
        "Secondary camera": plan.secondary.in_words,
        "Baseline": f"{rounded(plan.baseline_m, 4)} m ± {rounded(1000 * sigmas.baseline_m, 3)} mm",
        "Volume": f"{rounded(plan.near_m, 4)} to {rounded(plan.far_m, 4)} m ahead of the primary "
        "camera",
        "Bar": f"{rounded(plan.bar_m, 4)} m ± {rounded(1000 * sigmas.bar_m, 3)} mm",
        "Frames": str(plan.frames),
        "Noise of a target in the image": f"{digits(plan.noise_px, 2)} px",
        "Focal lengths known to": f"{percent(sigmas.focal)} %",
        "Image centres known to": f"{rounded(sigmas.centre_px, 3)} px",
    }
    if isinstance(pose, AimedPose):
        lines["Each camera turned in by"] = f"{rounded(pose.toe_in_deg, 3)}°"
        lines["Secondary higher by"] = f"{rounded(pose.height_difference_m, 3)} m"
    else:
        angle = np.degrees(np.arccos(np.clip((np.trace(plan.pose.R) - 1) / 2, -1, 1)))
        lines["Angle between the cameras"] = f"{rounded(angle, 3)}°"
    if (window := plan.primary.window) is not None:
        lines["Window"] = (
            f"{rounded(window.distance_m, 4)} m from the primary camera, "
            f"{rounded(1000 * window.thickness_m, 3)} mm of index {window.glass:g}; behind it "
            f"{window.medium:g}"
        )
    return pd.DataFrame({"Value": lines}).rename_axis("Planned")
