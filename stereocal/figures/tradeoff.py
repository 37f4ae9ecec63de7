"""The trade-off curves between matching and measuring, with the sets of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.figures.style import METHOD_NAMES, NEUTRAL, finish, marker_of
from stereocal.verdict.in_words import digits
from stereocal.verdict.tradeoff import TradeOff, TradeOffPoint

HEIGHT = 520
NAMES = {"fixed": "Nominal lenses", "freed": "Lenses freed"}
HOVER = "<br>2D cost %{x:.4~r} px<br>3D cost %{y:.4~r} mm<extra></extra>"
DASHES = {"fixed": "dot", "freed": "solid"}


def plot_trade_off(
    curves: TradeOff,
    costs: Mapping[Method, tuple[float, float]],
    chosen: TradeOffPoint | None = None,
) -> go.Figure:
    """Both curves, with the 2D cost to the right and the 3D cost upwards.

    Args:
        costs: 2D cost in pixels and 3D cost in metres of each method's set.
        chosen: the point to mark.
    """
    figure = finish(go.Figure(), HEIGHT)
    for name, points in _curves(curves):
        figure.add_scatter(
            x=[point.cost_2d_px for point in points],
            y=[1000 * point.cost_3d_m for point in points],
            mode="lines",
            name=NAMES[name],
            line={"color": NEUTRAL, "dash": DASHES[name], "width": 2},
            hovertemplate=NAMES[name] + HOVER,
        )
    for method in (method for method in ALL_METHODS if method in costs):
        px, metres = costs[method]
        figure.add_scatter(
            x=[px],
            y=[1000 * metres],
            mode="markers",
            name=METHOD_NAMES[method],
            marker=marker_of(method, 13),
            hovertemplate=METHOD_NAMES[method] + HOVER,
        )
    if chosen is not None:
        figure.add_scatter(
            x=[chosen.cost_2d_px],
            y=[1000 * chosen.cost_3d_m],
            mode="markers",
            name="The slider's point",
            marker=marker_of("refined", 20, symbol="circle-open", line={"width": 3}),
            hoverinfo="skip",
        )
    along_x, along_y = _axes(curves, costs)
    figure.update_xaxes(title_text="2D cost: sum of the reprojection errors (px)", **along_x)
    figure.update_yaxes(title_text="3D cost: sum of the length errors (mm)", **along_y)
    return figure


def describe_trade_off(curves: TradeOff, costs: Mapping[Method, tuple[float, float]]) -> str:
    """The figure in words."""
    parts = []
    for name, points in _curves(curves):
        first, last = points[0], points[-1]
        parts.append(
            f"{NAMES[name].lower()}, from matching alone to measuring alone, the 2D cost goes from "
            f"{digits(first.cost_2d_px)} to {digits(last.cost_2d_px)} px and the 3D cost from "
            f"{digits(1000 * first.cost_3d_m)} to {digits(1000 * last.cost_3d_m)} mm"
        )
    sets = [
        f"{METHOD_NAMES[method]} {digits(px)} px and {digits(1000 * metres)} mm"
        for method, (px, metres) in costs.items()
    ]
    return f"Trade-off: {'; '.join(parts)}. The sets: {'; '.join(sets)}."


def _curves(curves: TradeOff) -> tuple[tuple[str, Sequence[TradeOffPoint]], ...]:
    return ("fixed", curves.fixed), ("freed", curves.freed)


def _axes(
    curves: TradeOff, costs: Mapping[Method, tuple[float, float]]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Properties of both axes: logarithmic if the values span more than a decade.

    The 2D cost of the 3D set can be a hundred times that of the curves.
    """
    points = [(point.cost_2d_px, point.cost_3d_m) for point in (*curves.fixed, *curves.freed)]
    values = np.array([*points, *costs.values()])
    ticks = [digit * 10.0**power for power in range(-6, 9) for digit in (1, 2, 5)]
    wide_axis = {"type": "log", "exponentformat": "none", "tickmode": "array", "tickvals": ticks}
    x, y = (
        wide_axis if wide else {"type": "linear"}
        for wide in (values.max(axis=0) > 10 * values.min(axis=0)).tolist()
    )
    return x, y
