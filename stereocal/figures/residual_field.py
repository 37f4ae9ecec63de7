"""Mean residuals over the image as arrows: of board corners, or of the pairs of a rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import FAINT, METHOD_COLOURS, NEUTRAL, add, blank, with_gaps
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.quality import coverage, lens_residuals, typical_and_noise_px
from stereocal.refined.misfit import FEWEST_POINTS, LEVEL, Misfit
from stereocal.rig.camera import CAMERAS
from stereocal.rig.residual_field import ResidualField
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent

LONGEST_ARROW = 0.9
"""As a fraction of the spacing of the cells."""


def plot_residual_field(lens: LensCalibration) -> go.Figure:
    """Positions of the corners, and the mean residual in each part of the image, enlarged."""
    return _plot([lens_residuals(lens)], ["u (px)"], "Corners")


def describe_residual_field(lens: LensCalibration) -> str:
    """The figure in words."""
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
    titles = [
        f"<b>{name.capitalize()}</b>: {percent(share)} % of squared residuals<br>u (px)"
        for name, share in zip(CAMERAS, misfit.shares, strict=True)
    ]
    return _plot(misfit.fields, titles, "Targets", narrow)


def describe_misfit(misfit: Misfit) -> str:
    """The figure in words."""
    cells, apart = (
        sum(int(each.sum()) for each in masks)
        for masks in zip(*((field.known, field.apart) for field in misfit.fields), strict=True)
    )
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
    scale = arrow_scale(fields)
    for at, field in enumerate(fields):
        place = {"row": at + 1, "col": 1} if narrow else {"row": 1, "col": at + 1}
        figure.add_scattergl(
            x=field.points[:, 0],
            y=field.points[:, 1],
            mode="markers",
            hoverinfo="skip",
            marker={"size": 3, "color": FAINT},
            name=f"{what} (n = {len(field.points)})",
            legendgroup="points",
            showlegend=at == 0,
            **place,
        )
        for apart in (False, True):
            if (field.apart[field.known] == apart).any():
                _add_arrows(figure, field, apart, scale, place)
        # Image axes, and the border of the image.
        width, height = field.image_size
        edge = {"type": "rect", "x0": -0.5, "y0": -0.5, "x1": width - 0.5, "y1": height - 0.5}
        figure.add_shape(edge, line={"color": NEUTRAL, "width": 1.5}, **place)
        margin = 0.02 * width
        common = {"showgrid": False, "constrain": "domain", "nticks": 6, **place}
        figure.update_xaxes(range=[-margin, width + margin], title_text=titles[at], **common)
        common |= {"scaleanchor": "x" if at == 0 else f"x{at + 1}", "constraintoward": "top"}
        figure.update_yaxes(range=[height + margin, -margin], title_text="v (px)", **common)
    return figure


def _add_arrows(
    figure: go.Figure, field: ResidualField, apart: bool, scale: float, place: dict[str, int]
) -> None:
    """Arrows of the cells that are, or are not, apart from 0."""
    shown, colour = field.known & (field.apart == apart), METHOD_COLOURS["3d" if apart else "2d"]
    tails, means = field.centres[shown], field.mean[shown]
    name = "Apart from 0" if apart else f"Mean residual, ×{scale:g}"
    add(
        figure,
        with_gaps(np.stack([tails, tails + scale * means], axis=1)),
        "mean residual %{customdata[0]:.3f}, %{customdata[1]:.3f} px<br>"
        "of %{customdata[2]:.0f} points",
        line={"color": colour, "width": 3 if apart else 2},
        name=name,
        legendgroup=str(apart),
        marker={
            "color": colour,
            "symbol": "arrow-wide" if apart else "arrow",
            "angleref": "previous",
            "size": np.tile([0, 10 if apart else 7, 0], len(tails)),
        },
        customdata=np.repeat(np.column_stack([means, field.count[shown]]), 3, axis=0),
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
    power = 10.0 ** np.floor(np.log10(min(wanted)))
    return float(max(step * power for step in (1, 2, 5) if step * power <= min(wanted)))
