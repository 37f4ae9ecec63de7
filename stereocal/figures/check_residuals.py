"""Errors of new images with the old and the repaired parameters, frame by frame."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.field.checking.residuals import Errors, Residuals
from stereocal.field.checking.since import Since
from stereocal.figures.frame_panels import LOG_BEYOND, median_and_largest
from stereocal.figures.style import CORRECT_COLOUR, NEUTRAL, WRONG_COLOUR, count, finish
from stereocal.rig.compiled import FloatArray

HEIGHTS = {1: 340, 2: 520}
MANY_FRAMES = 100
FEW_FRAMES = 8
"""With fewer, plotly would put ticks between them."""
BEFORE, AFTER = "Old parameters", "Repaired parameters"
Panel = tuple[str, str, list[tuple[str, FloatArray]]]
"""Title, unit, and the errors by name."""


def plot_check(residuals: Residuals, since: Since | None = None) -> go.Figure:
    """Reprojection error and, with bars, length error of each frame, before and after the repair.

    Args:
        since: marks the frames that may be the first after the movement; the repaired parameters
            do not hold for earlier ones.
    """
    panels = _panels(residuals, since)
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    finish(figure, HEIGHTS[len(panels)])
    size = 9 if len(residuals.frames) <= MANY_FRAMES else 6
    for row, (title, unit, series) in enumerate(panels, start=1):
        for name, errors in series:
            colour, symbol = (
                (WRONG_COLOUR, "circle-open") if name == BEFORE else (CORRECT_COLOUR, "diamond")
            )
            figure.add_scatter(
                x=residuals.frames,
                y=errors,
                mode="markers",
                name=name,
                cliponaxis=False,
                marker={"color": colour, "symbol": symbol, "size": size, "line": {"width": 1.5}},
                legendgroup=name,
                showlegend=row == 1,
                hovertemplate=f"frame %{{x}}: %{{y:.3~r}} {unit}<extra>{name}</extra>",
                row=row,
                col=1,
            )
        title_of = {"text": f"{title} ({unit})", "standoff": 8}  # beside the longest label
        figure.update_yaxes(title=title_of, row=row, col=1, **_scale(series))
    if since is not None:
        figure.add_vrect(
            x0=since.low - 0.5,
            x1=since.high + 0.5,
            line_width=0,
            fillcolor=NEUTRAL,
            opacity=0.25,
            layer="below",
            row="all",
            col=1,
        )
    few = int(np.ptp(residuals.frames)) < FEW_FRAMES
    figure.update_xaxes(tickformat="d", dtick=1 if few else None)
    figure.update_xaxes(title_text="Frame", row=len(panels), col=1)
    return figure


def describe_check(residuals: Residuals, since: Since | None = None) -> str:
    """The figure in words."""
    parts = []
    for title, unit, series in _panels(residuals, since):
        values = [
            f"{median_and_largest(errors)} {unit} with the {name.lower()}"
            for name, errors in series
        ]
        parts.append(f"{title}, median and largest: {', '.join(values)}")
    later = "" if since is None else f" The repaired parameters hold from frame {since.low} on."
    return f"{count(len(residuals.frames), 'frame')}. {'. '.join(parts)}.{later}"


def _panels(residuals: Residuals, since: Since | None) -> list[Panel]:
    held = residuals.frames >= (residuals.frames[0] if since is None else since.low)
    both: list[tuple[str, Errors]] = [(BEFORE, residuals.before)]
    both += [] if residuals.after is None else [(AFTER, residuals.after)]
    reprojection, length = [], []
    for name, errors in both:
        shown = held if name == AFTER else np.ones(len(held), dtype=np.bool_)
        reprojection.append((name, np.where(shown, errors.reprojection_px, np.nan)))
        if errors.length is not None:
            length.append((name, np.where(shown, 100 * errors.length, np.nan)))
    panels: list[Panel] = [("Reprojection error", "px", reprojection)]
    return [*panels, ("Length error", "%", length)] if length else panels


def _scale(series: list[tuple[str, FloatArray]]) -> dict[str, object]:
    every = np.concatenate([errors for _, errors in series])
    known = every[np.isfinite(every) & (every > 0)]
    if len(known) and known.max() > LOG_BEYOND * np.median(known):
        return {"type": "log", "dtick": 1}
    return {"rangemode": "tozero"}
