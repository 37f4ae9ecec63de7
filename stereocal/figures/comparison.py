"""Comparison of the methods over several data sets."""

import html
from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import ALL_METHODS, METHOD_NAMES, Method
from stereocal.evaluation.summary import Estimate, MethodSummary, best_methods
from stereocal.figures import style
from stereocal.system.array_types import FloatArray
from stereocal.verdict.in_words import in_percent, percent

LONGEST_NAME = 20
LIMIT = "arrow-bar-down"
"""Symbol of an upper limit: an arrow downwards from it."""
ROWS = {
    "reprojection": ("FCP, reprojection<br>error (%)", "FCP of the reprojection error"),
    "reconstruction": ("Median 3D error (%)", "median 3D error"),
}
"""Title of the axis, and in words."""
Summaries = Mapping[str, Mapping[Method, MethodSummary]]


def plot_comparison(by_dataset: Summaries) -> go.Figure:
    """FCP of the reprojection error and median 3D error of several data sets, with intervals.

    Where no wrong pair looked right, an arrow starts at the upper limit of the FCP; there is none
    of too few runs for intervals.
    """
    names = list(by_dataset)
    figure = style.blank(700, 2, shared_xaxes=True, vertical_spacing=0.06)
    for row, (quantity, (title, _)) in enumerate(ROWS.items(), start=1):
        estimates = {
            method: [summaries[method].main(quantity) for summaries in by_dataset.values()]
            for method in ALL_METHODS
            if all(method in summaries for summaries in by_dataset.values())
        }
        every = [estimate for of_method in estimates.values() for estimate in of_method]
        positive = [v for e in every for v in (e.value, e.low, e.high) if v > 0]
        # Intervals that reach 0 end on a logarithmic axis below all positive values.
        floor, place = min(positive) / 2 if positive else 1e-6, {"row": row, "col": 1}
        for method, values in estimates.items():
            points, look = _marks(method, dict(zip(names, values, strict=True)), floor)
            style.add_trace(figure, points, "%{text}", showlegend=row == 1, **look, **place)
        zeros = sum(estimate.value == 0 and estimate.high > 0 for estimate in every)
        title += f"<br>↧: upper limit, none counted (n = {zeros:,})" if zeros else ""
        scale = {"type": "log", "exponentformat": "none", "dtick": "D2"}
        figure.update_yaxes(title_text=title, **scale, **place)
    short = [n if len(n) <= LONGEST_NAME else f"{n[: LONGEST_NAME - 1]}…" for n in names]
    figure.update_xaxes(
        tickvals=list(range(len(names))),
        ticktext=[html.escape(name) for name in short],
        range=[-0.5, len(names) - 0.5],
        showgrid=False,
    )
    figure.update_xaxes(row=2, col=1, title_text=f"Data set (n = {len(names):,})")
    return figure


def _marks(
    method: Method, estimates: Mapping[str, Estimate], floor: float
) -> tuple[FloatArray, dict[str, Any]]:
    """Positions (n, 2) and look of a method; where nothing was counted, the upper limit alone."""
    values = [[e.value or e.high, e.low if e.value else e.high, e.high] for e in estimates.values()]
    middle, low, high = 100 * np.maximum(values, floor).T
    beside = 0.2 * (ALL_METHODS.index(method) - 1.5)
    symbol = [style.METHOD_SYMBOLS[method] if e.value else LIMIT for e in estimates.values()]
    ends = {"array": high - middle, "arrayminus": middle - low, "thickness": 1.5, "width": 3}
    text = [
        f"{html.escape(name)}, {METHOD_NAMES[method]}<br>"
        + (in_percent(e) if e.value else f"below {percent(e.high)} %")
        for name, e in estimates.items()
    ]
    return np.column_stack([np.arange(len(middle)) + beside, middle]), {
        "mode": "markers",
        "error_y": {"type": "data", **ends},
        "name": METHOD_NAMES[method],
        "legendgroup": method,
        "marker": style.marker_of(method, 9 if len(middle) <= 8 else 7, symbol=symbol),
        "text": text,
    }


def describe_comparison(by_dataset: Summaries) -> str:
    """The figure in words."""
    parts = []
    for quantity, (_, what) in ROWS.items():
        of_methods = []
        for method in ALL_METHODS:
            known = {
                name: value
                for name, summaries in by_dataset.items()
                if method in summaries
                and np.isfinite(value := summaries[method].main(quantity).value)
            }
            least, most = (percent(f(known.values())) if known else "" for f in (min, max))
            wins = sum(best_methods(by_dataset[name])[quantity] == method for name in known)
            span = f"{least} to {most} %" if known else "none"
            of_methods.append(f"{METHOD_NAMES[method]} {span} (lowest in {wins})")
        parts.append(f"{what}: {', '.join(of_methods)}")
    return f"Over {style.count(len(by_dataset), 'data set')}, {'; '.join(parts)}."
