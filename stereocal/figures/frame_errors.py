"""The errors of the methods, frame by frame."""

from __future__ import annotations

import textwrap

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import Method
from stereocal.figures.frame_panels import MAXIMUM_LABELS, FramePanel, frame_panels, missing
from stereocal.figures.style import (
    METHOD_NAMES,
    METHOD_SYMBOLS,
    MOST_DRAWN,
    NEUTRAL,
    count,
    finish,
    marker_of,
)
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.numbers import rounded

HEIGHT = 600
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
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    finish(figure, HEIGHT)
    panels = frame_panels(calibration)
    for row, panel in enumerate(panels, start=1):
        for method in panel.values:
            _add_method(figure, row, panel, method)
        _add_labels(figure, row, panel)
        figure.update_yaxes(
            row=row, col=1, title_text=f"{panel.title} ({panel.unit})", **_scale(panel)
        )
    _add_key(figure, panels[0])
    figure.update_xaxes(row=2, col=1, title_text=_frame_title(calibration, panels))
    if chosen is not None:
        figure.add_shape(
            type="line",
            x0=chosen,
            x1=chosen,
            xref="x2",
            y0=0,
            y1=1,
            yref="paper",
            layer="below",
            line={"color": NEUTRAL, "width": 1.5, "dash": "dot"},
        )
    return figure


def _add_method(figure: go.Figure, row: int, panel: FramePanel, method: Method) -> None:
    """Draw a trace for each kind of frames."""
    drawn = panel.drawn
    for kind, of_kind in panel.kinds.items():
        chosen = of_kind & drawn
        if not chosen.any():
            continue
        figure.add_scatter(
            x=_beside(panel, method)[chosen],
            y=panel.values[method][chosen],
            mode="markers",
            customdata=panel.frames[chosen],
            marker=marker_of(
                method,
                SIZES[method] - (2 if len(panel.frames) > 100 else 0),
                symbol=METHOD_SYMBOLS[method] + kind.suffix,
                opacity=0.85,
            ),
            unselected={"marker": {"opacity": 0.85}},
            name=METHOD_NAMES[method],
            legendgroup=method,
            showlegend=row == 1 and not kind.key,
            hovertemplate=(
                f"{METHOD_NAMES[method]}, frame %{{customdata}} ({kind.words})<br>"
                f"{panel.title.lower()} %{{y:.3~r}} {panel.unit}<extra></extra>"
            ),
            row=row,
            col=1,
        )


def _beside(panel: FramePanel, method: Method) -> FloatArray:
    """(n,): where the symbols of a method stand on the axis of frames.

    Beside each other: the errors of the essential matrix and of the 2D set may agree to a pixel of
    the screen, and one symbol hid the other.
    """
    steps = np.diff(np.unique(panel.frames))
    step = float(steps.min()) if len(steps) else 1.0
    at = [*panel.values].index(method) - 0.5 * (len(panel.values) - 1)
    return np.asarray(panel.frames + BESIDE * step * at, dtype=np.float64)


def _add_labels(figure: go.Figure, row: int, panel: FramePanel) -> None:
    """Label the outlying frames above their highest symbol, worst first, without overlap."""
    at, heights = _labelled(panel)
    if not len(at):
        return
    figure.add_scatter(
        x=panel.frames[at],
        y=heights,
        mode="text",
        text=[f"<b>{frame}</b>" for frame in panel.frames[at]],
        textposition="top center",
        textfont={"size": 14},
        hoverinfo="skip",
        showlegend=False,
        cliponaxis=False,
        name="Outlying frames",
        row=row,
        col=1,
    )


def _labelled(panel: FramePanel) -> tuple[IntArray, FloatArray]:
    """Indices into `panel.frames` of the outlying frames to label, and the label heights."""
    at = np.flatnonzero(np.isin(panel.frames, panel.outliers))
    at = at[np.isfinite(panel.values[panel.labelled][at])]
    at = at[np.argsort(-panel.values[panel.labelled][at], kind="stable")]
    heights = np.nanmax([values[at] for values in panel.values.values()], axis=0)
    width = float(panel.frames.max() - panel.frames.min()) if len(at) else 0.0
    across = panel.frames[at] / max(width, 1.0)
    shown = np.log10(np.maximum(heights, 1e-300)) if panel.is_log else heights
    up = shown / _height_of_axis(panel)
    kept: list[int] = []
    for i in range(len(at)):
        crowded = any(
            abs(across[i] - across[k]) < LABEL_WIDTH and abs(up[i] - up[k]) < LABEL_HEIGHT
            for k in kept
        )
        if not crowded and len(kept) < MAXIMUM_LABELS:
            kept.append(i)
    return at[kept], heights[kept]


def _height_of_axis(panel: FramePanel) -> float:
    """The length of the axis, in decades if it is logarithmic."""
    if not len(panel.known):
        return 1.0
    if panel.is_log:
        return float(np.log10(panel.known.max() / panel.lowest))
    return float(panel.known.max()) or 1.0


def _add_key(figure: go.Figure, panel: FramePanel) -> None:
    """Explain open and dotted symbols in the legend, if there are any."""
    for kind, n in zip(panel.kinds, panel.counts, strict=True):
        if not kind.key or not n:
            continue
        figure.add_scatter(
            x=[None],
            y=[None],
            mode="markers",
            hoverinfo="skip",
            marker={"color": NEUTRAL, "symbol": f"circle{kind.suffix}", "size": 9},
            name=f"{kind.key} (n = {n})",
            row=1,
            col=1,
        )


def _scale(panel: FramePanel) -> dict[str, object]:
    if not panel.is_log:
        return {"type": "linear", "range": list(panel.ends)}
    ends = np.log10(panel.ends).tolist()
    return {"type": "log", "exponentformat": "none", "range": ends, "dtick": 1}


def _frame_title(calibration: Calibration, panels: tuple[FramePanel, ...]) -> str:
    """The title of the frame axis, with notes on values that are not drawn."""
    title = f"Frame (n = {len(calibration.dataset.correspondences.frames)})"
    notes = missing(panels)
    most = max(len(panel.frames) for panel in panels)
    if most > MOST_DRAWN:
        notes.append(f"of each {-(-most // MOST_DRAWN)} neighbouring frames the worst is drawn")
    for panel in panels:
        if not len(panel.frames):
            notes.append("no frame has both targets, so there is no length")
        below = int((panel.known < panel.lowest).sum()) if panel.is_log else 0
        if below:
            notes.append(
                f"{count(below, panel.title.lower())} below "
                f"{rounded(panel.lowest, 1)} {panel.unit} out of view"
            )
    lines = [line for note in notes for line in textwrap.wrap(note[0].upper() + note[1:], 44)]
    return "<br>".join([title, *lines])
