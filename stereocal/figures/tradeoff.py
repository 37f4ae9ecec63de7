"""The trade-off curves between matching and measuring, with the sets of all methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.figures.style import (
    METHOD_COLOURS,
    METHOD_NAMES,
    METHOD_SYMBOLS,
    NEUTRAL,
    finish,
)
from stereocal.rig.compiled import FloatArray
from stereocal.verdict.in_words import digits
from stereocal.verdict.tradeoff import TradeOff, TradeOffPoint

HEIGHT = 520
NAMES = {"fixed": "Nominal lenses", "freed": "Lenses freed"}
DASHES = {"fixed": "dot", "freed": "solid"}
MAXIMUM_COST = 3.0
"""A set with a cost above this multiple of the curves' largest is drawn at the edge. The 2D cost of
the 3D set can be a hundred times larger, which would shrink the curves to a dot."""


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
    for name, points in (("fixed", curves.fixed), ("freed", curves.freed)):
        figure.add_trace(
            go.Scatter(
                x=[point.cost_2d_px for point in points],
                y=[1000 * point.cost_3d_m for point in points],
                mode="lines", name=NAMES[name],
                line={"color": NEUTRAL, "dash": DASHES[name], "width": 2},
                hovertemplate=f"{NAMES[name]}<br>2D cost %{{x:.4g}} px<br>3D cost %{{y:.4g}} mm"
                "<extra></extra>",
            )
        )  # fmt: skip
    ends, drawn_px = _ends(curves, costs), _of_curves(curves)[:, 0]
    middle_px = float(np.sqrt(drawn_px.min() * drawn_px.max()))
    for method in (method for method in ALL_METHODS if method in costs):
        _add_set(figure, method, costs[method], ends, middle_px)
    if chosen is not None:
        figure.add_trace(
            go.Scatter(
                x=[chosen.cost_2d_px], y=[1000 * chosen.cost_3d_m], mode="markers",
                name="The slider's point",
                marker={"symbol": "circle-open", "size": 20, "color": METHOD_COLOURS["refined"],
                        "line": {"width": 3}},
                hoverinfo="skip",
            )
        )  # fmt: skip
    along_x, along_y = _axes(curves, costs, ends)
    figure.update_xaxes(title_text="2D cost: sum of the reprojection errors (px)", **along_x)
    figure.update_yaxes(title_text="3D cost: sum of the length errors (mm)", **along_y)
    return figure


def describe_trade_off(curves: TradeOff, costs: Mapping[Method, tuple[float, float]]) -> str:
    """The figure in words."""
    parts = []
    for name, points in (("fixed", curves.fixed), ("freed", curves.freed)):
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


def _add_set(
    figure: go.Figure,
    method: Method,
    cost: tuple[float, float],
    ends: FloatArray,
    middle_px: float,
) -> None:
    """Draw a set as a point; one far beyond the curves at the edge, with its value as text."""
    at = _drawn([cost])[0]
    shown, beyond = np.minimum(at, ends), at > ends
    texts = [f"{digits(at[0])} px →"] * bool(beyond[0])
    texts += [f"{digits(at[1])} mm ↑"] * bool(beyond[1])
    # Text towards the centre, since it would be cut off at the edge.
    side = "top left" if beyond[0] or at[0] > middle_px else "middle right"
    figure.add_trace(
        go.Scatter(
            x=shown[:1], y=shown[1:], mode="markers+text" if texts else "markers",
            name=METHOD_NAMES[method], customdata=[at.tolist()],
            text=[", ".join(texts)], textposition=side, textfont={"size": 13},
            marker={"color": METHOD_COLOURS[method], "symbol": METHOD_SYMBOLS[method], "size": 13},
            hovertemplate=f"{METHOD_NAMES[method]}<br>2D cost %{{customdata[0]:.4g}} px<br>"
            "3D cost %{customdata[1]:.4g} mm<extra></extra>",
        )
    )  # fmt: skip


def _drawn(costs: Sequence[tuple[float, float]]) -> FloatArray:
    """(n, 2): pixels, millimetres."""
    return np.array(costs, dtype=np.float64).reshape(-1, 2) * [1.0, 1000.0]


def _of_curves(curves: TradeOff) -> FloatArray:
    """(n, 2): all points of both curves, as drawn."""
    return _drawn([(p.cost_2d_px, p.cost_3d_m) for p in (*curves.fixed, *curves.freed)])


def _ends(curves: TradeOff, costs: Mapping[Method, tuple[float, float]]) -> FloatArray:
    """(2,): where sets far beyond the curves are drawn; infinite if there are none."""
    points = _of_curves(curves)
    every = np.concatenate([points, _drawn(list(costs.values()))])
    inside = every <= MAXIMUM_COST * points.max(axis=0)
    ends = np.full(2, np.inf)
    for axis in range(2):
        if not inside[:, axis].all():
            near = every[inside[:, axis], axis]
            ends[axis] = near.max() + 0.15 * np.ptp(near)
    return ends


def _axes(
    curves: TradeOff, costs: Mapping[Method, tuple[float, float]], ends: FloatArray
) -> tuple[dict[str, str], dict[str, str]]:
    """Properties of both axes: logarithmic if the values span more than a decade."""
    values = np.concatenate([_of_curves(curves), _drawn(list(costs.values()))])
    values = np.minimum(values, ends)
    x, y = (
        {"type": "log", "exponentformat": "none", "dtick": "D2"} if wide else {"type": "linear"}
        for wide in (values.max(axis=0) > 10 * values.min(axis=0)).tolist()
    )
    return x, y
