"""Figures of a lens calibration: results of the draws, errors by photograph."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import add, blank, count, line_of
from stereocal.intrinsics.calibrate_lens import PARAMETERS, LensCalibration
from stereocal.intrinsics.quality import with_error

BLUE, ORANGE = "#1F83C4", "#D55E00"
COLUMNS = 3
BINS = 14
UNKNOWN = np.full((1, 2), np.nan)
"""A point that is only in the legend."""


def plot_draws(lens: LensCalibration) -> go.Figure:
    """Histogram of each parameter over the draws, with median and standard error."""
    free = [at for at in range(len(PARAMETERS)) if lens.settings.free[at]]
    rows = -(-len(free) // COLUMNS)
    spacing = {"horizontal_spacing": 0.06, "vertical_spacing": 0.34 / rows}
    figure = blank(60 + 190 * rows, rows, COLUMNS, **spacing)
    shapes = []
    for number, at in enumerate(free):
        _add_draws(figure, lens, at, number)
        value, sigma = float(lens.values[at]), float(lens.standard_errors[at])
        suffix = str(number + 1) if number else ""
        height = {"xref": f"x{suffix}", "yref": f"y{suffix} domain", "y0": 0, "y1": 1}
        band = {"type": "rect", "x0": value - sigma, "x1": value + sigma, "layer": "below"}
        filled = {"fillcolor": "rgba(213,94,0,0.22)", "line": {"width": 0}}
        line = {"type": "line", "x0": value, "x1": value, "line": {"color": ORANGE, "width": 2}}
        shapes += [{**height, **band, **filled}, {**height, **line}]
    squares = {"color": "rgba(213,94,0,0.4)", "symbol": "square", "size": 12}
    add(figure, UNKNOWN, line=line_of(ORANGE), name="Median", row=1, col=1)
    add(figure, UNKNOWN, marker=squares, name="± 1 standard error", row=1, col=1)
    # All at once, because Plotly copies the earlier ones when one is added.
    figure.update_layout(shapes=shapes)
    return figure


def _add_draws(figure: go.Figure, lens: LensCalibration, at: int, number: int) -> None:
    """The histogram of one parameter, and its axes."""
    place = {"row": number // COLUMNS + 1, "col": number % COLUMNS + 1}
    unit, name = " px" if at < 4 else "", lens.settings.parameters[at]
    value, sigma = float(lens.values[at]), float(lens.standard_errors[at])
    low, high = float(np.min(lens.draws[:, at])), float(np.max(lens.draws[:, at]))
    figure.add_histogram(
        x=lens.draws[:, at],
        marker_color=BLUE,
        showlegend=number == 0,
        name=f"Results of the draws (n = {len(lens.draws)})",
        xbins={"start": low, "end": high + 1e-12, "size": max((high - low) / BINS, 1e-12)},
        hovertemplate=f"{name} %{{x}}{unit}<br>%{{y}} draws<extra></extra>",
        **place,
    )
    # One tick, at the median: at 420 px there is no room for more.
    reach = 1.1 * max(high - value, value - low, sigma)
    shown, _, error = with_error(value, sigma).partition(" ")
    tick = {"tickangle": 0, "tickvals": [value], "ticktext": [shown]}
    ends = [value - reach, value + reach]
    figure.update_xaxes(title_text=f"{name} {error}{unit}", range=ends, **tick, **place)
    figure.update_yaxes(nticks=4, title_text="draws" if place["col"] == 1 else "", **place)


def describe_draws(lens: LensCalibration) -> str:
    """The figure in words."""
    settings = lens.settings
    widest = lens.spread[:2].max() / lens.values[0]
    found = [
        f"{settings.parameters[at]} "
        f"{with_error(float(lens.values[at]), float(lens.standard_errors[at]))}"
        f"{' px' if at < 4 else ''}"
        for at in range(len(PARAMETERS))
        if settings.free[at]
    ]
    return (
        f"{settings.repeats} calibrations, each with {lens.per_draw} of {len(lens.search.views)} "
        f"photographs; the focal lengths spread by {100 * widest:.3f} %. Median and standard "
        f"error: {', '.join(found)}. The line is the median, the band one standard error, which "
        "differs from the spread of the results because they share photographs."
    )


def plot_view_errors(lens: LensCalibration) -> go.Figure:
    """The RMS reprojection error of the corners of each photograph."""
    names = [view.name for view in lens.search.views]
    outlying = np.isin(names, list(lens.outlying))
    figure = blank(380)
    for title, chosen, colour, pattern in (
        ("Photographs", np.flatnonzero(~outlying), BLUE, ""),
        ("Outlying photographs", np.flatnonzero(outlying), ORANGE, "/"),
    ):
        if not len(chosen):
            continue
        figure.add_bar(
            x=[names[at] for at in chosen],
            y=lens.view_errors[chosen],
            name=f"{title} (n = {len(chosen)})",
            marker={"color": colour, "pattern_shape": pattern},
            showlegend=True,
            customdata=[len(lens.search.views[at].ids) for at in chosen],
            hovertemplate="%{x}<br>%{y:.3f} px over %{customdata} corners<extra></extra>",
        )
    middle, dashed = float(np.median(lens.view_errors)), line_of(width=1.5, dash="dash")
    figure.add_hline(y=middle, line=dashed)
    figure.add_scatter(
        x=[None], y=[None], mode="lines", name=f"Median {middle:.3f} px", line=dashed
    )
    figure.update_xaxes(
        categoryorder="array",
        categoryarray=names,
        tickangle=-60,
        showgrid=False,
        showticklabels=len(names) <= 60,
        title_text="photograph" if len(names) > 60 else "",
    )
    figure.update_yaxes(title_text="error, root mean square (px)", rangemode="tozero")
    return figure


def describe_view_errors(lens: LensCalibration) -> str:
    """The figure in words."""
    worst, many = int(np.argmax(lens.view_errors)), len(lens.outlying)
    note = f"; {count(many, 'photograph')} more than twice the median" if many else ""
    return (
        f"Errors of {count(len(lens.view_errors), 'photograph')}: median "
        f"{np.median(lens.view_errors):.3f} px, the largest {lens.view_errors[worst]:.3f} px in "
        f"{lens.search.views[worst].name}{note}."
    )
