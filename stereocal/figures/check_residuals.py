"""Errors of new images with the old and the repaired parameters, frame by frame."""

import numpy as np
import plotly.graph_objects as go

from stereocal.field.checking.repair import Residuals
from stereocal.field.checking.since import Since
from stereocal.figures import style
from stereocal.figures.frame_errors import LOG_BEYOND, median_and_largest
from stereocal.rig.compiled import FloatArray

MANY_FRAMES, FEW_FRAMES = 100, 8
"""With more, symbols are smaller; with fewer, Plotly would put ticks between them."""
BEFORE, AFTER = "Old parameters", "Repaired parameters"
MARKS = {BEFORE: (style.WRONG_COLOUR, "circle-open"), AFTER: (style.CORRECT_COLOUR, "diamond")}


def plot_check(residuals: Residuals, since: Since | None = None) -> go.Figure:
    """Reprojection error and, with bars, length error of each frame, before and after the repair.

    Args:
        since: marks the frames that may be the first after the movement; the repaired parameters
            do not hold for earlier ones.
    """
    panels = _panels(residuals, since)
    grid = {"shared_xaxes": True, "vertical_spacing": 0.06}
    figure = style.blank(340 if len(panels) == 1 else 520, len(panels), **grid)
    size = 9 if len(residuals.frames) <= MANY_FRAMES else 6
    for row, ((title, unit), series) in enumerate(panels.items(), start=1):
        place = {"row": row, "col": 1}
        for name, errors in series.items():
            colour, symbol = MARKS[name]
            style.add_trace(
                figure,
                np.column_stack([residuals.frames, errors]),
                f"frame %{{x}}: %{{y:.3~r}} {unit}<extra>{name}</extra>",
                name=name,
                cliponaxis=False,
                marker={"color": colour, "symbol": symbol, "size": size, "line": {"width": 1.5}},
                legendgroup=name,
                showlegend=row == 1,
                **place,
            )
        every = np.concatenate(list(series.values()))
        known = every[np.isfinite(every) & (every > 0)]
        is_log = len(known) and known.max() > LOG_BEYOND * np.median(known)
        scale = {"type": "log", "dtick": 1} if is_log else {"rangemode": "tozero"}
        title_of = {"text": f"{title} ({unit})", "standoff": 8}  # beside the longest label
        figure.update_yaxes(title=title_of, **place, **scale)
    if since is not None:
        band = {"line_width": 0, "fillcolor": style.NEUTRAL, "opacity": 0.25, "layer": "below"}
        figure.add_vrect(x0=since.low - 0.5, x1=since.high + 0.5, row="all", col=1, **band)
    few = int(np.ptp(residuals.frames)) < FEW_FRAMES
    figure.update_xaxes(tickformat="d", dtick=1 if few else None)
    figure.update_xaxes(title_text="Frame", row=len(panels), col=1)
    return figure


def describe_check(residuals: Residuals, since: Since | None = None) -> str:
    """The figure in words."""
    parts = []
    for (title, unit), series in _panels(residuals, since).items():
        values = [
            f"{median_and_largest(errors)} {unit} with the {name.lower()}"
            for name, errors in series.items()
        ]
        parts.append(f"{title}, median and largest: {', '.join(values)}")
    later = "" if since is None else f" The repaired parameters hold from frame {since.low} on."
    return f"{style.count(len(residuals.frames), 'frame')}. {'. '.join(parts)}.{later}"


def _panels(
    residuals: Residuals, since: Since | None
) -> dict[tuple[str, str], dict[str, FloatArray]]:
    """By title and unit, the errors (n,) by the name of the parameters."""
    reprojection, length = {}, {}
    for name, errors in ((BEFORE, residuals.before), (AFTER, residuals.after)):
        if errors is None:
            continue
        first = since.low if since and name == AFTER else -np.inf
        shown = np.where(residuals.frames >= first, 1.0, np.nan)
        reprojection[name] = shown * errors.reprojection_px
        if errors.length is not None:
            length[name] = shown * 100 * errors.length
    panels = {("Reprojection error", "px"): reprojection, ("Length error", "%"): length}
    return {title: series for title, series in panels.items() if series}
