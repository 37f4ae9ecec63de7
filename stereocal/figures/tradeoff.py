"""The trade-off curves between matching and measuring, with the sets of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.figures import style
from stereocal.rig.compiled import FloatArray
from stereocal.verdict.in_words import digits
from stereocal.verdict.tradeoff import TradeOff, TradeOffPoint

HOVER = "<br>2D cost %{x:.4~r} px<br>3D cost %{y:.4~r} mm"
DASHES = {"Nominal lenses": "dot", "Lenses freed": "solid"}


def plot_trade_off(
    curves: TradeOff,
    costs: Mapping[Method, tuple[float, float]],
    chosen: TradeOffPoint | None = None,
) -> go.Figure:
    """Both curves, with the 2D cost to the right and the 3D cost upwards.

    Axes are logarithmic if the values span more than a decade: the 2D cost of the 3D set can be a
    hundred times that of the curves.

    Args:
        costs: 2D cost in pixels and 3D cost in metres of each method's set.
        chosen: the point to mark.
    """
    figure = style.blank(520)
    both = _curves(curves)
    for name, points in both.items():
        line = style.line_of(dash=DASHES[name])
        style.add(figure, points, name + HOVER, line=line, name=name)
    sets = {method: np.array([costs[method]]) * [1, 1000] for method in style.in_order(costs)}
    for method, at in sets.items():
        name, marker = METHOD_NAMES[method], style.marker_of(method, 13)
        style.add(figure, at, name + HOVER, marker=marker, name=name)
    if chosen is not None:
        marker = style.marker_of("refined", 20, symbol="circle-open", line={"width": 3})
        style.add(figure, _points([chosen]), marker=marker, name="The slider's point")
    values = np.concatenate([*both.values(), *sets.values()])
    ticks = [digit * 10.0**power for power in range(-6, 9) for digit in (1, 2, 5)]
    wide = {"type": "log", "exponentformat": "none", "tickmode": "array", "tickvals": ticks}
    x, y = (
        wide if spans else {"type": "linear"}
        for spans in (values.max(axis=0) > 10 * values.min(axis=0)).tolist()
    )
    figure.update_xaxes(title_text="2D cost: sum of the reprojection errors (px)", **x)
    figure.update_yaxes(title_text="3D cost: sum of the length errors (mm)", **y)
    return figure


def describe_trade_off(curves: TradeOff, costs: Mapping[Method, tuple[float, float]]) -> str:
    """Where the curves go, and the costs of the sets."""
    parts = [
        f"{name.lower()}, from matching alone to measuring alone, the 2D cost goes from "
        f"{digits(points[0, 0])} to {digits(points[-1, 0])} px and the 3D cost from "
        f"{digits(points[0, 1])} to {digits(points[-1, 1])} mm"
        for name, points in _curves(curves).items()
    ]
    sets = [
        f"{METHOD_NAMES[method]} {digits(px)} px and {digits(1000 * metres)} mm"
        for method, (px, metres) in costs.items()
    ]
    return f"Trade-off: {'; '.join(parts)}. The sets: {'; '.join(sets)}."


def _curves(curves: TradeOff) -> dict[str, FloatArray]:
    """(n, 2) each: 2D cost in px and 3D cost in mm, by the name of the curve."""
    return dict(zip(DASHES, map(_points, (curves.fixed, curves.freed)), strict=True))


def _points(points: Sequence[TradeOffPoint]) -> FloatArray:
    return np.array([(point.cost_2d_px, 1000 * point.cost_3d_m) for point in points])
