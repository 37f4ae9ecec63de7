"""Figures of lenses: results of a calibration's draws, errors by photograph, and mean residuals
over the image as arrows, of board corners or of the pairs of a rig."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.figures.style import NOWHERE, add_trace, blank, line_of
from stereocal.fit.errors.misfit import FEWEST_POINTS, LEVEL, Misfit
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.lens_fit import PARAMETERS
from stereocal.intrinsics.quality import coverage, lens_residuals, typical_and_noise_px
from stereocal.rig.camera import CAMERAS
from stereocal.rig.residual_field import ResidualField
from stereocal.system.numbers import count, rounded, with_error
from stereocal.verdict.in_words import percent

BLUE, ORANGE = style.METHOD_COLOURS["2d"], style.METHOD_COLOURS["3d"]
BAND = "rgba(213,94,0,0.22)"
COLUMNS = 3
BINS = 14
LONGEST_ARROW = 0.9
"""Fraction of the spacing of the cells."""


def plot_draws(lens: LensCalibration) -> go.Figure:
    """Histogram of each parameter over the draws, with median and standard error."""
    free = [k for k in range(len(PARAMETERS)) if lens.settings.free[k]]
    rows = -(-len(free) // COLUMNS)
    spacing = {"horizontal_spacing": 0.06, "vertical_spacing": 0.34 / rows}
    figure = blank(60 + 190 * rows, rows, COLUMNS, **spacing)
    shapes = []
    for number, k in enumerate(free):
        value, sigma = float(lens.values[k]), float(lens.standard_errors[k])
        _add_draws(figure, lens, k, number)
        suffix = str(number + 1) if number else ""
        height = {"xref": f"x{suffix}", "yref": f"y{suffix} domain", "y0": 0, "y1": 1}
        band = {"type": "rect", "x0": value - sigma, "x1": value + sigma, "layer": "below"}
        filled = {"fillcolor": BAND, "line": {"width": 0}}
        line = {"type": "line", "x0": value, "x1": value, "line": {"color": ORANGE, "width": 2}}
        shapes += [{**height, **band, **filled}, {**height, **line}]
    squares = {"color": "rgba(213,94,0,0.4)", "symbol": "square", "size": 12}
    add_trace(figure, NOWHERE, line=line_of(ORANGE), name="Median", row=1, col=1)
    add_trace(figure, NOWHERE, marker=squares, name="± 1 standard error", row=1, col=1)
    # All at once, because Plotly copies the earlier ones when one is added.
    figure.update_layout(shapes=shapes)
    return figure


def _add_draws(figure: go.Figure, lens: LensCalibration, k: int, number: int) -> None:
    place = {"row": number // COLUMNS + 1, "col": number % COLUMNS + 1}
    unit, name = " px" if k < 4 else "", lens.settings.parameters[k]
    value, sigma = float(lens.values[k]), float(lens.standard_errors[k])
    low, high = float(np.min(lens.draws[:, k])), float(np.max(lens.draws[:, k]))
    figure.add_histogram(
        x=lens.draws[:, k],
        marker_color=BLUE,
        showlegend=number == 0,
        name=f"Results of the draws (n = {len(lens.draws):,})",
        xbins={"start": low, "end": high + 1e-12, "size": max((high - low) / BINS, 1e-12)},
        hovertemplate=f"{name} %{{x}}{unit}<br>%{{y}} draws<extra></extra>",
        **place,
    )
    # One tick, at the median: at 420 px there is no room for more.
    reach = 1.1 * max(high - value, value - low, sigma)
    value_text, _, error = with_error(value, sigma).partition(" ")
    tick = {"tickangle": 0, "tickvals": [value], "ticktext": [value_text]}
    ends = [value - reach, value + reach]
    figure.update_xaxes(title_text=f"{name} {error}{unit}", range=ends, **tick, **place)
    figure.update_yaxes(nticks=4, title_text="draws" if place["col"] == 1 else "", **place)


def describe_draws(lens: LensCalibration) -> str:
    settings = lens.settings
    widest = lens.spread[:2].max() / lens.values[0]
    every = zip(settings.parameters, lens.values, lens.standard_errors, strict=True)
    estimates = [
        f"{name} {with_error(float(value), float(sigma))}{' px' if k < 4 else ''}"
        for k, (name, value, sigma) in enumerate(every)
        if settings.free[k]
    ]
    return (
        f"{settings.repeats} calibrations, each with {lens.per_draw} of {len(lens.search.views)} "
        f"photographs; the focal lengths spread by {100 * widest:.3f} %. Median and standard "
        f"error: {', '.join(estimates)}. The line is the median, the band one standard error, "
        "which differs from the spread of the results because they share photographs."
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
            x=[names[k] for k in chosen],
            y=lens.view_errors[chosen],
            name=f"{title} (n = {len(chosen):,})",
            marker={"color": colour, "pattern_shape": pattern},
            showlegend=True,
            customdata=[len(lens.search.views[k].ids) for k in chosen],
            hovertemplate="%{x}<br>%{y:.3f} px over %{customdata} corners<extra></extra>",
        )
    middle, dashed = float(np.median(lens.view_errors)), line_of(width=1.5, dash="dash")
    figure.add_hline(y=middle, line=dashed)
    add_trace(figure, NOWHERE, line=dashed, name=f"Median {middle:.3f} px")
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
    worst, outlying = int(np.argmax(lens.view_errors)), len(lens.outlying)
    note = f"; {count(outlying, 'photograph')} more than twice the median" if outlying else ""
    return (
        f"Errors of {count(len(lens.view_errors), 'photograph')}: median "
        f"{np.median(lens.view_errors):.3f} px, the largest {lens.view_errors[worst]:.3f} px in "
        f"{lens.search.views[worst].name}{note}."
    )


def plot_residual_field(lens: LensCalibration) -> go.Figure:
    """Positions of the corners, and the mean residual in each part of the image, enlarged."""
    return _plot([lens_residuals(lens)], ["u (px)"], "Corners")


def describe_residual_field(lens: LensCalibration) -> str:
    field, (typical, noise) = lens_residuals(lens), typical_and_noise_px(lens)
    return (
        f"Mean residuals in {field.known.sum()} parts of the image: typically {typical:.3f} px, at "
        f"most {field.largest_px:.3f} px; noise alone would cause {noise:.3f} px. The corners "
        f"cover {100 * coverage(lens.search):.0f} % of the image."
    )


def plot_misfit(misfit: Misfit, narrow: bool = False) -> go.Figure:
    """The same of both cameras, across the epipolar lines; cells that differ from 0 are marked.

    Args:
        narrow: one below the other.
    """
    separator = "<br>" if narrow else " "
    titles = [
        f"<b>{name.capitalize()}</b>: place explains {percent(share)} %{separator}of the squared "
        "residuals<br>u (px)"
        for name, share in zip(CAMERAS, misfit.shares, strict=True)
    ]
    return _plot(misfit.fields, titles, "Targets", narrow)


def describe_misfit(misfit: Misfit) -> str:
    cells, apart = np.sum([[side.known.sum(), side.apart.sum()] for side in misfit.fields], axis=0)
    largest = np.nanmax([0.0, *(field.largest_px for field in misfit.fields)])
    what = "Noise explains them: they accuse no lens."
    if misfit.is_sure:
        what = (
            "Noise does not explain them: a lens is wrong, or has errors that its model does not "
            "contain. Calibrate the lenses again, with boards where the arrows are longest. Pairs "
            "cannot tell which of the two lenses it is."
        )
    return (
        f"Mean residuals across the epipolar lines in {cells} cells of at least {FEWEST_POINTS} "
        f"points: at most {rounded(float(largest))} px, and {apart or 'none'} apart from 0 "
        f"({100 * LEVEL:.0f} % for all cells together, tested by random signs of frames that "
        f"follow each other). {what} Beyond chance, the cells explain {percent(misfit.shares[0])} "
        f"% of the squared residuals in the primary and {percent(misfit.shares[1])} % in the "
        f"secondary; noise makes such means with a probability of {rounded(misfit.probability)}."
    )


def _plot(
    fields: Sequence[ResidualField], titles: Sequence[str], what: str, narrow: bool = False
) -> go.Figure:
    rows, columns = (len(fields), 1) if narrow else (1, len(fields))
    figure = blank(100 + 290 * rows if narrow else 450, rows, columns, horizontal_spacing=0.1)
    scale, largest = arrow_scale(fields), np.nanmax([0.0, *(field.largest_px for field in fields)])
    shown_px = _round_below(largest) if largest else 0.0
    scale_text = f"; an arrow over {scale * shown_px:g} px is {shown_px:g} px" if shown_px else ""
    for k, field in enumerate(fields):
        place = {"row": k + 1, "col": 1} if narrow else {"row": 1, "col": k + 1}
        figure.add_scattergl(
            x=field.points[:, 0],
            y=field.points[:, 1],
            mode="markers",
            hoverinfo="skip",
            marker={"size": 3, "color": style.FAINT},
            name=f"{what} (n = {len(field.points):,})",
            legendgroup="points",
            showlegend=k == 0,
            **place,
        )
        for apart in (False, True):
            if (field.apart[field.known] == apart).any():
                _add_arrows(figure, field, apart, scale, place)
        width, height = field.image_size
        edge = {"type": "rect", "x0": -0.5, "y0": -0.5, "x1": width - 0.5, "y1": height - 0.5}
        figure.add_shape(edge, line={"color": style.NEUTRAL, "width": 1.5}, **place)
        x, y = ({"title_text": title, "nticks": 6} for title in (titles[k] + scale_text, "v (px)"))
        style.set_image_axes(figure, field.image_size, 0.02 * width, x, y, **place)
    return figure


def _add_arrows(
    figure: go.Figure, field: ResidualField, is_apart: bool, scale: float, place: dict[str, int]
) -> None:
    """Arrows of the cells that are, or are not, apart from 0."""
    cells, colour = field.known & (field.apart == is_apart), ORANGE if is_apart else BLUE
    tails, means = field.centres[cells], field.mean[cells]
    name = "Apart from 0" if is_apart else "Mean residual"
    add_trace(
        figure,
        style.with_gaps(np.stack([tails, tails + scale * means], axis=1)),
        "mean residual %{customdata[0]:.3f}, %{customdata[1]:.3f} px<br>"
        "of %{customdata[2]:.0f} points",
        line={"color": colour, "width": 3 if is_apart else 2},
        name=name,
        legendgroup=str(is_apart),
        marker={
            "color": colour,
            "symbol": "arrow-wide" if is_apart else "arrow",
            "angleref": "previous",
            "size": np.tile([0, 10 if is_apart else 7, 0], len(tails)),
        },
        customdata=np.repeat(np.column_stack([means, field.count[cells]]), 3, axis=0),
        showlegend=all(name != trace.name for trace in figure.data),
        **place,
    )


def arrow_scale(fields: Sequence[ResidualField]) -> float:
    """Enlargement of the arrows: 1, 2 or 5 times a power of ten."""
    wanted = [
        LONGEST_ARROW * field.image_size[0] / field.count.shape[1] / field.largest_px
        for field in fields
        if field.largest_px > 0
    ]
    if not wanted:
        return 1.0
    return _round_below(min(wanted))


def _round_below(value: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten up to a value above 0."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1, 2, 5) if step * power <= value))
