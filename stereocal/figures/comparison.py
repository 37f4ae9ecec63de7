"""Comparison of the methods over several data sets."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.evaluation.summary import Estimate, MethodSummary, best_methods
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, METHOD_SYMBOLS, count, finish
from stereocal.rig.compiled import FloatArray
from stereocal.verdict.in_words import interval, percent

COMPARISON_HEIGHT = 700
LONGEST_NAME = 20
LIMIT = "arrow-bar-down"
"""Symbol of an upper limit: an arrow downwards from it."""


def plot_comparison(by_dataset: Mapping[str, Mapping[Method, MethodSummary]]) -> go.Figure:
    """FCP of the reprojection error and median 3D error of several data sets, with intervals.

    Where no wrong pair looked right, an arrow starts at the upper limit of the FCP.
    """
    names = list(by_dataset)
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    finish(figure, COMPARISON_HEIGHT)
    for row, title in ((1, "FCP, reprojection<br>error (%)"), (2, "Median 3D error (%)")):
        estimates = {
            method: [_estimate(by_dataset[name][method], row) for name in names]
            for method in ALL_METHODS
            if all(method in by_dataset[name] for name in names)
        }
        floor = _floor([e for of_method in estimates.values() for e in of_method])
        for method, values in estimates.items():
            _add_comparison(figure, row, method, names, values, floor)
        zeros = sum(e.value == 0 for of_method in estimates.values() for e in of_method)
        figure.update_yaxes(
            row=row,
            col=1,
            type="log",
            exponentformat="none",
            dtick="D2",
            title_text=title + (f"<br>↧: upper limit, none counted (n = {zeros})" if zeros else ""),
        )
    short = [n if len(n) <= LONGEST_NAME else f"{n[: LONGEST_NAME - 1]}…" for n in names]
    figure.update_xaxes(
        tickvals=list(range(len(names))),
        ticktext=[html.escape(name) for name in short],
        range=[-0.5, len(names) - 0.5],
        showgrid=False,
    )
    figure.update_xaxes(row=2, col=1, title_text=f"Data set (n = {len(names)})")
    return figure


def describe_comparison(by_dataset: Mapping[str, Mapping[Method, MethodSummary]]) -> str:
    """The figure in words."""
    parts = []
    for row, what in ((1, "FCP of the reprojection error"), (2, "median 3D error")):
        of_methods = []
        for method in ALL_METHODS:
            values = [_estimate(s[method], row).value for s in by_dataset.values() if method in s]
            known = [value for value in values if np.isfinite(value)]
            span = f"{percent(min(known))} to {percent(max(known))} %" if known else "none"
            of_methods.append(f"{METHOD_NAMES[method]} {span}{_wins(by_dataset, method, row)}")
        parts.append(f"{what}: {', '.join(of_methods)}")
    return f"Over {count(len(by_dataset), 'data set')}, {'; '.join(parts)}."


def _wins(
    by_dataset: Mapping[str, Mapping[Method, MethodSummary]], method: Method, row: int
) -> str:
    column = "reprojection" if row == 1 else "reconstruction"
    wins = sum(
        best_methods(summaries)[column] == method
        and bool(np.isfinite(_estimate(summaries[method], row).value))
        for summaries in by_dataset.values()
    )
    return f" (lowest in {wins})"


def _estimate(summary: MethodSummary, row: int) -> Estimate:
    return summary.reprojection.fcp if row == 1 else summary.reconstruction.median


def _floor(estimates: Sequence[Estimate]) -> float:
    """The end of intervals that reach 0, on a logarithmic axis below all positive values."""
    positive = [v for e in estimates for v in (e.value, e.low, e.high) if v > 0]
    return min(positive) / 2 if positive else 1e-6


def _add_comparison(
    figure: go.Figure,
    row: int,
    method: Method,
    names: Sequence[str],
    estimates: Sequence[Estimate],
    floor: float,
) -> None:
    # Where nothing was counted, the upper limit alone.
    values = np.array(
        [[e.value or e.high, e.low if e.value else e.high, e.high] for e in estimates]
    )
    drawn: FloatArray = 100 * np.maximum(values, floor)
    symbol = METHOD_SYMBOLS[method]
    texts = [
        f"{html.escape(name)}, {METHOD_NAMES[method]}<br>"
        + (f"{percent(e.value)} % ({interval(e)})" if e.value else f"below {percent(e.high)} %")
        for name, e in zip(names, estimates, strict=True)
    ]
    figure.add_scatter(
        x=np.arange(len(names)) + 0.2 * (ALL_METHODS.index(method) - 1.5),
        y=drawn[:, 0],
        error_y={
            "type": "data",
            "array": drawn[:, 2] - drawn[:, 0],
            "arrayminus": drawn[:, 0] - drawn[:, 1],
            "thickness": 1.5,
            "width": 3,
        },
        mode="markers",
        name=METHOD_NAMES[method],
        legendgroup=method,
        showlegend=row == 1,
        marker={
            "color": METHOD_COLOURS[method],
            "size": 9 if len(names) <= 8 else 7,
            "symbol": [symbol if e.value else LIMIT for e in estimates],
        },
        text=texts,
        hovertemplate="%{text}<extra></extra>",
        row=row,
        col=1,
    )
