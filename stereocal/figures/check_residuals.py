"""Reprojection errors of new images with the old and the repaired parameters."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.field.repair import Residuals
from stereocal.field.since import Since
from stereocal.figures.style import CORRECT_COLOUR, NEUTRAL, WRONG_COLOUR, count, finish
from stereocal.rig.compiled import FloatArray

HEIGHT = 340
LOG_BEYOND = 30.0
"""Ratio of the largest error to the median above which the axis is logarithmic."""
MANY_FRAMES = 100
FEW_FRAMES = 8
"""With fewer, plotly would put ticks between them."""
BEFORE, AFTER = "Old parameters", "Repaired parameters"


def plot_check(residuals: Residuals, since: Since | None = None) -> go.Figure:
    """Mean reprojection error of each frame, before and after the repair.

    Args:
        since: marks the frames that may be the first after the movement; the repaired parameters
            do not hold for earlier ones.
    """
    figure = finish(go.Figure(), HEIGHT)
    if since is not None:
        figure.add_vrect(
            x0=since.low - 0.5, x1=since.high + 0.5, line_width=0, fillcolor=NEUTRAL, opacity=0.25,
            layer="below",
            annotation={"text": "moved", "font": {"size": 13}, "yanchor": "top"},
        )  # fmt: skip
    after, size = _after(residuals, since), 9 if len(residuals.frames) <= MANY_FRAMES else 6
    for name, errors, colour, symbol in (
        (BEFORE, residuals.before_px, WRONG_COLOUR, "circle-open"),
        (AFTER, after, CORRECT_COLOUR, "diamond"),
    ):
        if errors is None:
            continue
        figure.add_trace(
            go.Scatter(
                x=residuals.frames, y=errors, mode="markers", name=name, cliponaxis=False,
                marker={"color": colour, "symbol": symbol, "size": size, "line": {"width": 1.5}},
                hovertemplate=f"frame %{{x}}: %{{y:.3g}} px<extra>{name}</extra>",
            )
        )  # fmt: skip
    figure.update_layout(showlegend=True)
    few = int(np.ptp(residuals.frames)) < FEW_FRAMES
    figure.update_xaxes(title_text="Frame", tickformat="d", dtick=1 if few else None)
    figure.update_yaxes(title_text="Reprojection error (px)", **_scale(residuals))
    return figure


def describe_check(residuals: Residuals, since: Since | None = None) -> str:
    """The figure in words."""
    text = (
        f"Reprojection error of {count(len(residuals.frames), 'frame')}, median and largest: "
        f"{_median_and_largest(residuals.before_px)} px with the old parameters"
    )
    after = _after(residuals, since)
    if after is None:
        return f"{text}."
    later = "" if since is None else f" from frame {since.low} on"
    return f"{text}, {_median_and_largest(after)} px with the repaired ones{later}."


def _after(residuals: Residuals, since: Since | None) -> FloatArray | None:
    """The errors with the repaired parameters, where these hold."""
    if residuals.after_px is None or since is None:
        return residuals.after_px
    return np.where(residuals.frames >= since.low, residuals.after_px, np.nan)


def _scale(residuals: Residuals) -> dict[str, object]:
    every = np.concatenate(
        [residuals.before_px, [] if residuals.after_px is None else residuals.after_px]
    )
    known = every[np.isfinite(every) & (every > 0)]
    if len(known) and known.max() > LOG_BEYOND * np.median(known):
        return {"type": "log", "dtick": 1}
    return {"rangemode": "tozero"}


def _median_and_largest(errors: FloatArray) -> str:
    known = errors[np.isfinite(errors)]
    return f"{np.median(known):.3g} and {known.max():.3g}" if len(known) else "none and none"
