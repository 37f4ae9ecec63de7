"""Progress of the two searches: cost, step and acceptance ratio."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import COST_UNITS, Method
from stereocal.calibration.montecarlo import Trace
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, NEUTRAL, finish, sentence_only
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.numbers import rounded

HEIGHT = 760
MAXIMUM_DRAWN = 2000
"""Maximum number of moves drawn; more are thinned evenly, with the first and the last."""
SEARCHES: tuple[Method, ...] = ("2d", "3d")
DASHES = {"2d": "solid", "3d": "dot"}
NOTHING = "The course of the searches<br>was not recorded."


def plot_traces(calibration: Calibration) -> go.Figure:
    """Cost, step and acceptance ratio of the 2D and the 3D search against the move."""
    traces = _traces(calibration)
    if not traces:
        return sentence_only(NOTHING)
    figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=0.04)
    finish(figure, HEIGHT).update_layout(legend_itemsizing="trace")
    for method, trace in traces.items():
        moves = drawn_moves(len(trace.cost))
        cost_row = 1 + SEARCHES.index(method)
        _add_line(
            figure, cost_row, method, moves, trace.cost, f"cost %{{y:.6g}} {COST_UNITS[method]}"
        )
        _add_line(figure, 3, method, moves, trace.delta, "step %{y:.3g} rad")
        _add_line(figure, 4, method, moves, trace.ratio, "%{y:.0%} of the moves accepted")
    _add_threshold(figure, calibration, max(len(trace.cost) for trace in traces.values()))
    for row, method in enumerate(SEARCHES, start=1):
        costs = traces[method].cost if method in traces else np.ones(1)
        figure.update_yaxes(
            row=row,
            col=1,
            title_text=f"{method.upper()} cost ({COST_UNITS[method]})",
            type="log" if costs.min() > 0 and costs.max() > 10 * costs.min() else "linear",
        )
    figure.update_yaxes(
        row=3, col=1, type="log", title_text="Step Δ (rad)", exponentformat="power", dtick=1
    )
    figure.update_yaxes(row=4, col=1, title_text="Acceptance ratio", range=[-0.03, 1.03])
    figure.update_xaxes(row=4, col=1, title_text=_move_title(traces), rangemode="tozero")
    return figure


def describe_traces(calibration: Calibration) -> str:
    """The figure in words."""
    traces = _traces(calibration)
    if not traces:
        return "The course of the searches was not recorded."
    parts = [
        f"the {method.upper()} cost falls from {rounded(trace.cost[0], 4)} to "
        f"{rounded(trace.cost[-1], 4)} {COST_UNITS[method]} in {len(trace.cost)} moves while the "
        f"step shrinks from {rounded(trace.delta[0])} to {rounded(trace.delta[-1])} rad"
        for method, trace in traces.items()
    ]
    return f"Course of the searches: {'; '.join(parts)}."


def drawn_moves(moves: int) -> IntArray:
    """Indices of the moves to draw: all, or `MAXIMUM_DRAWN` evenly spaced ones."""
    if moves <= MAXIMUM_DRAWN:
        return np.arange(moves)
    return np.linspace(0, moves - 1, MAXIMUM_DRAWN).round().astype(np.int64)


def _traces(calibration: Calibration) -> dict[Method, Trace]:
    found = ((method, calibration.methods[method].trace) for method in SEARCHES)
    return {method: trace for method, trace in found if trace is not None and len(trace.cost)}


def _move_title(traces: dict[Method, Trace]) -> str:
    counts = ", ".join(
        f"{method.upper()}: n = {len(trace.cost)}" for method, trace in traces.items()
    )
    return f"Move ({counts})"


def _add_line(
    figure: go.Figure, row: int, method: Method, moves: IntArray, values: FloatArray, hover: str
) -> None:
    figure.add_scatter(
        x=moves + 1,
        y=values[moves],
        mode="lines",
        line={"color": METHOD_COLOURS[method], "dash": DASHES[method], "width": 2, "shape": "hv"},
        name=METHOD_NAMES[method],
        legendgroup=method,
        showlegend=row <= 2,
        hovertemplate=f"{METHOD_NAMES[method]}, move %{{x}}<br>{hover}<extra></extra>",
        row=row,
        col=1,
    )


def _add_threshold(figure: go.Figure, calibration: Calibration, moves: int) -> None:
    threshold = calibration.settings.search.acceptance
    figure.add_scatter(
        x=[1, moves],
        y=[threshold, threshold],
        mode="lines",
        line={"color": NEUTRAL, "dash": "dash", "width": 2},
        name=f"Threshold {threshold:g}",
        hovertemplate=f"the step shrinks below {threshold:g}<extra></extra>",
        row=4,
        col=1,
    )
