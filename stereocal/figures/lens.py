"""Figures of a lens calibration: results of the draws, errors by photograph, residual field."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.figures.style import FAINT, NEUTRAL, count, finish
from stereocal.intrinsics.calibrate_lens import PARAMETERS, LensCalibration
from stereocal.intrinsics.quality import coverage, residual_field
from stereocal.intrinsics.tables import with_error

BLUE, ORANGE = "#1F83C4", "#D55E00"
BAND = "rgba(213,94,0,0.22)"
COLUMNS = 3
BINS = 14
LONGEST_ARROW = 0.9
"""As a fraction of the spacing of the cells."""


def plot_draws(lens: LensCalibration) -> go.Figure:
    """Histogram of each parameter over the draws, with median and standard error."""
    free = [at for at in range(len(PARAMETERS)) if lens.settings.free[at]]
    rows = -(-len(free) // COLUMNS)
    figure = make_subplots(
        rows=rows, cols=COLUMNS, horizontal_spacing=0.06, vertical_spacing=0.34 / rows
    )
    finish(figure, 60 + 190 * rows)
    shapes: list[dict[str, object]] = []
    for number, at in enumerate(free):
        row, column = number // COLUMNS + 1, number % COLUMNS + 1
        unit = " px" if at < 4 else ""
        name, value = PARAMETERS[at], float(lens.values[at])
        sigma = float(lens.standard_errors[at])
        low, high = float(np.min(lens.draws[:, at])), float(np.max(lens.draws[:, at]))
        figure.add_trace(
            go.Histogram(
                x=lens.draws[:, at],
                marker_color=BLUE,
                showlegend=number == 0,
                name=f"Results of the draws (n = {len(lens.draws)})",
                xbins={"start": low, "end": high + 1e-12, "size": max((high - low) / BINS, 1e-12)},
                hovertemplate=f"{name} %{{x}}{unit}<br>%{{y}} draws<extra></extra>",
            ),
            row=row,
            col=column,
        )
        suffix = str(number + 1) if number else ""
        height = {"xref": f"x{suffix}", "yref": f"y{suffix} domain", "y0": 0, "y1": 1}
        shapes += [
            {
                **height,
                "type": "rect",
                "x0": value - sigma,
                "x1": value + sigma,
                "fillcolor": BAND,
                "line": {"width": 0},
                "layer": "below",
            },
            {
                **height,
                "type": "line",
                "x0": value,
                "x1": value,
                "line": {"color": ORANGE, "width": 2},
            },
        ]
        # One tick, at the median: at 420 px there is no room for more.
        reach = 1.1 * max(high - value, value - low, sigma)
        shown, _, error = with_error(value, sigma).partition(" ")
        figure.update_xaxes(
            row=row,
            col=column,
            title_text=f"{name} {error}{unit}",
            tickangle=0,
            tickvals=[value],
            ticktext=[shown],
            range=[value - reach, value + reach],
        )
        title = "draws" if column == 1 else ""
        figure.update_yaxes(row=row, col=column, nticks=4, title_text=title)
    for name, style in (
        ("Median", {"mode": "lines", "line": {"color": ORANGE, "width": 2}}),
        (
            "± 1 standard error",
            {
                "mode": "markers",
                "marker": {"color": "rgba(213,94,0,0.4)", "symbol": "square", "size": 12},
            },
        ),
    ):
        figure.add_trace(go.Scatter(x=[None], y=[None], name=name, **style), row=1, col=1)
    # All at once, because Plotly copies the earlier ones when one is added.
    figure.update_layout(shapes=shapes)
    return figure


def describe_draws(lens: LensCalibration) -> str:
    """The figure in words."""
    settings = lens.settings
    widest = lens.spread[:2].max() / lens.values[0]
    found = [
        f"{name} {with_error(float(value), float(sigma))}{' px' if at < 4 else ''}"
        for at, (name, value, sigma) in enumerate(
            zip(PARAMETERS, lens.values, lens.standard_errors, strict=True)
        )
        if settings.free[at]
    ]
    return (
        f"{settings.repeats} calibrations, each with {lens.per_draw} of "
        f"{len(lens.search.views)} photographs; the focal lengths spread by {100 * widest:.3f} %. "
        f"Median and standard error: {', '.join(found)}. "
        "The line is the median, the band one standard error, which differs from the spread of "
        "the results because they share photographs."
    )


def plot_view_errors(lens: LensCalibration) -> go.Figure:
    """The RMS reprojection error of the corners of each photograph."""
    names = [view.name for view in lens.search.views]
    outlying = set(lens.outlying)
    figure = finish(go.Figure(), 380)
    for wanted, title, colour, pattern in (
        (False, "Photographs", BLUE, ""),
        (True, "Outlying photographs", ORANGE, "/"),
    ):
        chosen = [at for at, name in enumerate(names) if (name in outlying) == wanted]
        if not chosen:
            continue
        figure.add_trace(
            go.Bar(
                x=[names[at] for at in chosen],
                y=lens.view_errors[chosen],
                name=f"{title} (n = {len(chosen)})",
                marker={"color": colour, "pattern_shape": pattern},
                showlegend=True,
                customdata=[len(lens.search.views[at].ids) for at in chosen],
                hovertemplate="%{x}<br>%{y:.3f} px over %{customdata} corners<extra></extra>",
            )
        )
    middle = float(np.median(lens.view_errors))
    figure.add_hline(y=middle, line={"color": NEUTRAL, "width": 1.5, "dash": "dash"})
    figure.add_trace(
        go.Scatter(
            x=[None],
            y=[None],
            mode="lines",
            name=f"Median {middle:.3f} px",
            line={"color": NEUTRAL, "width": 1.5, "dash": "dash"},
        )
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
    worst = int(np.argmax(lens.view_errors))
    outlying = lens.outlying
    note = f"; {count(len(outlying), 'photograph')} more than twice the median" if outlying else ""
    return (
        f"Errors of {count(len(lens.view_errors), 'photograph')}: median "
        f"{np.median(lens.view_errors):.3f} px, the largest {lens.view_errors[worst]:.3f} px in "
        f"{lens.search.views[worst].name}{note}."
    )


def plot_residual_field(lens: LensCalibration) -> go.Figure:
    """Positions of the corners, and the mean residual in each part of the image, enlarged."""
    field = residual_field(lens)
    width, height = field.image_size
    figure = finish(go.Figure(), 480)
    corners = np.concatenate([view.corners for view in lens.search.views])
    figure.add_trace(
        go.Scattergl(
            x=corners[:, 0],
            y=corners[:, 1],
            mode="markers",
            hoverinfo="skip",
            marker={"size": 3, "color": FAINT},
            name=f"Corners (n = {len(corners)})",
        )
    )
    known = np.isfinite(field.mean[..., 0])
    tails, arrows = field.centres[known], field.mean[known]
    scale = arrow_scale(lens)
    tips = tails + scale * arrows
    lines = np.full((len(tails), 3, 2), np.nan)
    lines[:, 0], lines[:, 1] = tails, tips
    figure.add_trace(
        go.Scatter(
            x=lines[..., 0].ravel(),
            y=lines[..., 1].ravel(),
            mode="lines+markers",
            line={"color": ORANGE, "width": 2},
            name=f"Mean residual, ×{scale:g}",
            marker={
                "color": ORANGE,
                "symbol": "arrow",
                "angleref": "previous",
                "size": np.tile([0, 9, 0], len(tails)),
            },
            customdata=np.repeat(np.column_stack([arrows, field.count[known]]), 3, axis=0),
            hovertemplate="mean residual %{customdata[0]:.3f}, %{customdata[1]:.3f} px<br>"
            "of %{customdata[2]:.0f} corners<extra></extra>",
        )
    )
    edge = {"type": "rect", "x0": -0.5, "y0": -0.5, "x1": width - 0.5, "y1": height - 0.5}
    figure.add_shape(edge, line={"color": NEUTRAL, "width": 1.5})
    margin = 0.02 * width
    figure.update_xaxes(
        range=[-margin, width + margin],
        title_text="u (px)",
        showgrid=False,
        constrain="domain",
        nticks=6,
    )
    figure.update_yaxes(
        range=[height + margin, -margin],
        title_text="v (px)",
        showgrid=False,
        scaleanchor="x",
        constrain="domain",
        constraintoward="top",
        nticks=6,
    )
    return figure


def arrow_scale(lens: LensCalibration) -> float:
    """Enlargement of the arrows: 1, 2 or 5 times a power of ten."""
    field = residual_field(lens)
    if not field.largest_px > 0:
        return 1.0
    cell = field.image_size[0] / field.count.shape[1]
    wanted = LONGEST_ARROW * cell / field.largest_px
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))


def describe_residual_field(lens: LensCalibration) -> str:
    """The figure in words."""
    field = residual_field(lens)
    return (
        f"Mean residuals in {int(np.isfinite(field.mean[..., 0]).sum())} "
        f"parts of the image: typically {field.typical_px:.3f} px, at most {field.largest_px:.3f} "
        f"px; noise alone would cause {field.noise_px:.3f} px. The corners cover "
        f"{100 * coverage(lens.search):.0f} % of the image."
    )
