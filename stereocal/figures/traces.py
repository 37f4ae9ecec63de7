"""Progress of the two searches: cost, step and acceptance ratio."""

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import COST_UNITS, Method
from stereocal.calibration.montecarlo import Trace
from stereocal.figures import style
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES
from stereocal.fit.results import Calibration
from stereocal.system.array_types import IntArray
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

MAXIMUM_DRAWN = 2000
"""Maximum number of moves drawn; more are thinned evenly, with the first and the last."""
SEARCHES: tuple[Method, ...] = ("2d", "3d")
DASHES = {"2d": "solid", "3d": "dot"}


def plot_traces(calibration: Calibration) -> go.Figure:
    """Cost, step and acceptance ratio of the 2D and the 3D search against the move."""
    traces = _traces(calibration)
    if not traces:
        return style.sentence_only("The course of the searches<br>was not recorded.")
    figure = style.blank(760, 4, shared_xaxes=True, vertical_spacing=0.04)
    figure.update_layout(legend_itemsizing="trace")
    for method, trace in traces.items():
        moves, name, unit = drawn_moves(len(trace.cost)), METHOD_NAMES[method], COST_UNITS[method]
        line = {**style.line_of(METHOD_COLOURS[method], 2, DASHES[method]), "shape": "hv"}
        cost = 1 + SEARCHES.index(method)
        for row, values, hover in (
            (cost, trace.cost, f"cost %{{y:.6g}} {unit}"),
            (3, trace.delta, "step %{y:.3g} rad"),
            (4, trace.ratio, "%{y:.0%} of the moves accepted"),
        ):
            points, hover = np.column_stack([moves + 1, values[moves]]), f"move %{{x}}<br>{hover}"
            legend = {"name": name, "legendgroup": method, "showlegend": row == cost}
            style.add_trace(figure, points, f"{name}, {hover}", line=line, row=row, col=1, **legend)
    threshold = calibration.settings.search.acceptance
    most = max(len(trace.cost) for trace in traces.values())
    style.add_trace(
        figure,
        np.array([[1, threshold], [most, threshold]]),
        f"the step shrinks below {threshold:g}",
        line=style.DASHED,
        name=f"Threshold {threshold:g}",
        row=4,
        col=1,
    )
    for row, method in enumerate(SEARCHES, start=1):
        costs = traces[method].cost if method in traces else np.ones(1)
        scale = "log" if costs.min() > 0 and costs.max() > 10 * costs.min() else "linear"
        title = f"{method.upper()} cost ({COST_UNITS[method]})"
        figure.update_yaxes(row=row, col=1, title_text=title, type=scale)
    steps = {"type": "log", "title_text": "Step Δ (rad)", "exponentformat": "power", "dtick": 1}
    figure.update_yaxes(row=3, col=1, **steps)
    figure.update_yaxes(row=4, col=1, title_text="Acceptance ratio", range=[-0.03, 1.03])
    counts = ", ".join(f"{name.upper()}: n = {len(t.cost):,}" for name, t in traces.items())
    figure.update_xaxes(row=4, col=1, title_text=f"Move ({counts})", rangemode="tozero")
    return figure


def describe_traces(calibration: Calibration) -> str:
    """How far the costs fall and the steps shrink."""
    parts = [
        f"the {method.upper()} cost falls from {rounded(trace.cost[0], 4)} to "
        f"{rounded(trace.cost[-1], 4)} {COST_UNITS[method]} in {len(trace.cost)} moves while the "
        f"step shrinks from {rounded(trace.delta[0])} to {rounded(trace.delta[-1])} rad"
        for method, trace in _traces(calibration).items()
    ]
    if not parts:
        return "The course of the searches was not recorded."
    return f"Course of the searches: {'; '.join(parts)}."


def drawn_moves(moves: int) -> IntArray:
    """Indices of the moves to draw: all, or `MAXIMUM_DRAWN` evenly spaced ones."""
    return evenly_spread(moves, MAXIMUM_DRAWN)


def _traces(calibration: Calibration) -> dict[Method, Trace]:
    traces = ((method, calibration.methods[method].trace) for method in SEARCHES)
    return {method: trace for method, trace in traces if trace is not None and len(trace.cost)}
