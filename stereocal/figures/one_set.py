"""Figures of whether one set will do: the disagreement of each stated input with the other data,
and the trade-off curves between matching and measuring."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.figures import style
from stereocal.refined.disagreement import ACCUSED
from stereocal.refined.stated_inputs import Input, in_digits
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits
from stereocal.verdict.tradeoff import TradeOff, TradeOffPoint

ROW, FRAME = 44, 100
HOVER = "<br>2D cost %{x:.4~r} px<br>3D cost %{y:.4~r} mm"
FIXED, FREED = "Nominal lenses", "Lenses freed"
DASHES = {FIXED: "dot", FREED: "solid"}


def plot_disagreement(inputs: Sequence[Input]) -> go.Figure:
    """The test value of each input in standard errors, with the threshold of disagreement."""
    shown = list(reversed(inputs))
    figure = style.blank(FRAME + ROW * max(len(shown), 1))
    values = np.array([item.standard_errors for item in shown])
    figure.add_bar(
        y=[item.title for item in shown],
        x=values,
        orientation="h",
        showlegend=False,
        marker={
            "color": [style.WRONG_COLOUR if item.accused else style.FAINT for item in shown],
            "line": {"color": style.NEUTRAL, "width": 1},
            # A pattern too, for readers who cannot distinguish the colours.
            "pattern": {"shape": ["/" if item.accused else "" for item in shown]},
        },
        text=["none" if np.isnan(v) else digits(v, 2) for v in values],
        textposition="outside",
        customdata=[_words(item) for item in shown],
        cliponaxis=False,
        hovertemplate="%{customdata}<extra></extra>",
    )
    figure.add_vline(x=ACCUSED, line=style.DASHED)
    most = float(np.nanmax(np.append(values, ACCUSED)))
    title = f"Disagreement (standard errors)<br>Dashed: threshold {ACCUSED:g}"
    figure.update_xaxes(title_text=title, range=[0, 1.2 * most])
    return figure


def disagreement_table(inputs: Sequence[Input]) -> pd.DataFrame:
    """What was stated of each input, and what comes out with images and lengths."""
    rows = {}
    for item in inputs:
        sigma, apart = item.sigma, item.standard_errors
        stated, estimated = ", ".join(f"{value:g}" for value in item.stated), "held as stated"
        if sigma.all():
            stated = in_digits(item.stated, sigma)
            found = f"{in_digits(item.estimate, sigma)} ± {in_digits(sigma, sigma)}"
            estimated = f"{found} {item.unit}".rstrip()
        rows[item.title] = {
            "Stated": f"{stated} {item.unit}".rstrip(),
            "Estimated": estimated,
            "Disagreement (standard errors)": (
                "no information" if np.isnan(apart) else digits(apart, 2)
            ),
        }
    return pd.DataFrame(rows).T.rename_axis("Input")


def describe_disagreement(inputs: Sequence[Input]) -> str:
    """The figure in words."""
    parts = [_words(item) for item in inputs]
    return f"Disagreement of each input with images and lengths: {'; '.join(parts)}."


def _words(item: Input) -> str:
    if np.isnan(item.standard_errors):
        return f"{item.title}: the images have no information about it"
    apart = f"{digits(item.standard_errors, 2)} standard errors"
    if not item.prior_sigma.any() and not item.accused:
        return f"{item.title}: held as stated, {apart}"
    stated, estimate = (
        f"{' and '.join(rounded(value, 6) for value in np.atleast_1d(values))} {item.unit}".rstrip()
        for values in (item.stated, item.estimate)
    )
    return f"{item.title}: stated {stated}, estimated {estimate}, {apart}"


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
        style.add_trace(figure, points, name + HOVER, line=line, name=name)
    sets = {method: np.array([costs[method]]) * [1, 1000] for method in style.in_order(costs)}
    for method, at in sets.items():
        name, marker = METHOD_NAMES[method], style.marker_of(method, 13)
        style.add_trace(figure, at, name + HOVER, marker=marker, name=name)
    if chosen is not None:
        marker = style.marker_of("refined", 20, symbol="circle-open", line={"width": 3})
        style.add_trace(figure, _points([chosen]), marker=marker, name="The slider's point")
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
