"""How well two cameras that were started by hand fit together, by the offset of their counts."""

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import CORRECT_COLOUR, NEUTRAL, WRONG_COLOUR, add_trace, blank, line_of
from stereocal.fit.timing.offset_of_pair import OffsetOfPair
from stereocal.system.array_types import FloatArray

MOST_DRAWN = 1500
"""Offsets drawn; of more, the best of each of as many runs."""


def plot_offsets(of_pair: OffsetOfPair) -> go.Figure:
    """The median distance of the points from their epipolar lines against the offset."""
    figure = blank(320)
    curve = _thinned(of_pair.offsets, of_pair.errors_px)
    hover = "offset %{x:.1f} frames: %{y:.3~r} px"
    add_trace(figure, curve, hover, name="other offsets", line=line_of(NEUTRAL, 1))
    for name, offset, px, colour, symbol in (
        ("best of the others", of_pair.other, of_pair.other_px, WRONG_COLOUR, "circle-open"),
        ("found", of_pair.measured.frames, of_pair.px, CORRECT_COLOUR, "diamond"),
    ):
        marker = {"color": colour, "size": 12, "symbol": symbol, "line": {"width": 2}}
        add_trace(figure, np.array([[offset, px]]), hover, name=name, marker=marker)
    first, second = of_pair.pair
    figure.update_xaxes(title_text=f"Frame of {first} that is frame 0 of {second}", tickformat="d")
    figure.update_yaxes(title_text="From the epipolar lines (px)", type="log", dtick=1)
    return figure


def describe_offsets(of_pair: OffsetOfPair) -> str:
    """The figure in words."""
    return f"Distance from the epipolar lines, logarithmic, by the offset. {of_pair.sentence()}"


def _thinned(offsets: FloatArray, errors_px: FloatArray) -> FloatArray:
    """(n, 2): of each run of offsets the one with the smallest error."""
    rows = np.column_stack([offsets, errors_px])[np.isfinite(errors_px)]
    runs = np.array_split(rows, min(len(rows), MOST_DRAWN))
    return np.array([run[run[:, 1].argmin()] for run in runs])
