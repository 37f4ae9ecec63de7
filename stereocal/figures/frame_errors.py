"""The errors of the methods, frame by frame."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import Method
from stereocal.figures.frame_panels import MAXIMUM_LABELS, FramePanel, frame_panels, missing
from stereocal.figures.style import (
    METHOD_NAMES,
    METHOD_SYMBOLS,
    MOST_DRAWN,
    NEUTRAL,
    add,
    blank,
    count,
    line_of,
    marker_of,
)
from stereocal.refined.results import Calibration
from stereocal.system.numbers import rounded

LABEL_WIDTH, LABEL_HEIGHT = 0.09, 0.12
"""Size of a frame number, as fractions of a panel on a narrow screen."""
BESIDE = 0.2
"""Distance between the symbols of two methods, over that of two frames."""
SIZES: dict[Method, int] = {"essential": 9, "2d": 7, "3d": 8, "refined": 7}


def plot_frame_errors(calibration: Calibration, chosen: int | None = None) -> go.Figure:
    """Reprojection and length error of every frame and method.

    Held-out frames are open symbols, frames left out are open with a dot.

    Args:
        chosen: a frame to mark.
    """
    figure = blank(600, 2, shared_xaxes=True, vertical_spacing=0.05)
    panels = frame_panels(calibration)
    for row, panel in enumerate(panels, start=1):
        for method in panel.values:
            _add_method(figure, row, panel, method)
        _add_labels(figure, row, panel)
        title = f"{panel.title} ({panel.unit})"
        scale: dict[str, Any] = {"type": "linear", "range": panel.ends}
        if panel.is_log:
            scale = {
                "type": "log",
                "range": np.log10(panel.ends),
                "exponentformat": "none",
                "dtick": 1,
            }
        figure.update_yaxes(row=row, col=1, title_text=title, **scale)
    # Open and dotted symbols in the legend, if there are any.
    for kind, n in zip(panels[0].kinds, panels[0].counts, strict=True):
        if kind.key and n:
            marker = {"color": NEUTRAL, "symbol": f"circle{kind.suffix}", "size": 9}
            name = f"{kind.key} (n = {n})"
            add(figure, np.full((1, 2), np.nan), marker=marker, name=name, row=1, col=1)
    figure.update_xaxes(row=2, col=1, title_text=_frame_title(panels))
    if chosen is not None:
        line, ends = line_of(NEUTRAL, 1.5, "dot"), {"xref": "x2", "y0": 0, "y1": 1, "yref": "paper"}
        figure.add_shape(type="line", x0=chosen, x1=chosen, layer="below", line=line, **ends)
    return figure


def _add_method(figure: go.Figure, row: int, panel: FramePanel, method: Method) -> None:
    """Draw a trace for each kind of frames.

    The symbols of the methods stand beside each other: the errors of the essential matrix and of
    the 2D set may agree to a pixel of the screen, and one symbol hid the other.
    """
    steps = np.diff(np.unique(panel.frames))
    at = [*panel.values].index(method) - 0.5 * (len(panel.values) - 1)
    beside = BESIDE * (steps.min() if len(steps) else 1) * at
    points = np.column_stack([panel.frames + beside, panel.values[method]])
    size, name = SIZES[method] - (2 if len(panel.frames) > 100 else 0), METHOD_NAMES[method]
    for kind, of_kind in panel.kinds.items():
        chosen, symbol = of_kind & panel.drawn, METHOD_SYMBOLS[method] + kind.suffix
        if not chosen.any():
            continue
        add(
            figure,
            points[chosen],
            f"{name}, frame %{{customdata}} ({kind.words})<br>"
            f"{panel.title.lower()} %{{y:.3~r}} {panel.unit}",
            customdata=panel.frames[chosen],
            marker=marker_of(method, size, symbol=symbol, opacity=0.85),
            unselected={"marker": {"opacity": 0.85}},
            name=name,
            legendgroup=method,
            showlegend=row == 1 and not kind.key,
            row=row,
            col=1,
        )


def _add_labels(figure: go.Figure, row: int, panel: FramePanel) -> None:
    """Label the outlying frames above their highest symbol, worst first, without overlap."""
    values = panel.values[panel.labelled]
    at = np.flatnonzero(np.isin(panel.frames, panel.outliers) & np.isfinite(values))
    if not len(at):
        return
    at = at[np.argsort(-values[at], kind="stable")]
    heights = np.nanmax([own[at] for own in panel.values.values()], axis=0)
    across = panel.frames[at] / max(float(np.ptp(panel.frames)), 1.0)
    up, top = heights, panel.known.max() or 1.0
    if panel.is_log:  # in decades
        up, top = np.log10(np.maximum(heights, 1e-300)), np.log10(panel.known.max() / panel.lowest)
    places = np.column_stack([across / LABEL_WIDTH, up / top / LABEL_HEIGHT])
    kept: list[int] = []
    for i, place in enumerate(places):
        free = (np.abs(place - places[kept]) >= 1.0).any(axis=1).all()
        if free and len(kept) < MAXIMUM_LABELS:
            kept.append(i)
    add(
        figure,
        np.column_stack([panel.frames[at], heights])[kept],
        text=[f"<b>{frame}</b>" for frame in panel.frames[at[kept]]],
        textposition="top center",
        textfont={"size": 14},
        showlegend=False,
        cliponaxis=False,
        name="Outlying frames",
        row=row,
        col=1,
    )


def _frame_title(panels: tuple[FramePanel, FramePanel]) -> str:
    """The title of the frame axis, with notes on values that are not drawn."""
    notes = missing(panels)
    most = max(len(panel.frames) for panel in panels)  # a frame may have several known distances
    if most > MOST_DRAWN:
        notes.append(f"of each {-(-most // MOST_DRAWN)} neighbouring frames the worst is drawn")
    for panel in panels:
        if not len(panel.frames):
            notes.append("no frame has both targets, so there is no length")
        below = int((panel.known < panel.lowest).sum()) if panel.is_log else 0
        if below:
            least = f"{rounded(panel.lowest, 1)} {panel.unit}"
            notes.append(f"{count(below, panel.title.lower())} below {least} out of view")
    lines = [line for note in notes for line in textwrap.wrap(note[0].upper() + note[1:], 44)]
    return "<br>".join([f"Frame (n = {len(panels[0].frames)})", *lines])
