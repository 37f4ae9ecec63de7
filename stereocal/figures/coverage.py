"""Positions of the targets in the two images."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.figures.style import FAINT, NEUTRAL, count, evenly_drawn, finish, marks_of, n_drawn
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.residual_field import cells_of

HEIGHT, NARROW_HEIGHT = 440, 880
GRID_CELLS = 4
"""The description counts the covered cells of a grid with this many rows and columns."""


def plot_coverage(dataset: Dataset, narrow: bool = False) -> go.Figure:
    """The points of A and B in both images, joined by the bar of each frame.

    Args:
        narrow: the images one below the other, else side by side.
    """
    rows, columns = (2, 1) if narrow else (1, 2)
    figure = make_subplots(rows, columns, horizontal_spacing=0.04, vertical_spacing=0.17)
    finish(figure, NARROW_HEIGHT if narrow else HEIGHT)
    for number, (side, camera, points) in enumerate(_sides(dataset), start=1):
        place = {"row": min(number, rows), "col": min(number, columns)}
        _add_image(figure, place, camera)
        _add_points(figure, place, dataset, points, number == 1)
        _set_axes(figure, place, number, side, camera, narrow)
    # Fixed margins, because the panels' titles are between the legend and the images.
    figure.update_layout(margin_t=125, legend={"yref": "container", "y": 1.0, "yanchor": "top"})
    return figure


def describe_coverage(dataset: Dataset) -> str:
    """The figure in words."""
    rows = dataset.correspondences
    marks = marks_of(rows)
    parts = [
        f"in the {side.lower()} image they fall into "
        f"{len(np.unique(cells_of(points, camera.image_size, (GRID_CELLS, GRID_CELLS))))} of "
        f"{GRID_CELLS**2} equal parts of its {_size(camera)}"
        for side, camera, points in _sides(dataset)
    ]
    return (
        f"Image points of {count(int(marks[0][1].sum()), 'target')} "
        f"{' and '.join([marks[0][0], *(f'{of.sum()} {name}' for name, of, *_ in marks[1:])])} in "
        f"{count(len(rows.frames), 'frame')}: {' and '.join(parts)}."
    )


def _sides(dataset: Dataset) -> tuple[tuple[str, Camera, FloatArray], ...]:
    rows = dataset.correspondences
    return (
        ("Primary", dataset.primary, rows.primary),
        ("Secondary", dataset.secondary, rows.secondary),
    )


def _size(camera: Camera) -> str:
    return f"{camera.image_size[0]} × {camera.image_size[1]} px"


def _add_image(figure: go.Figure, place: dict[str, int], camera: Camera) -> None:
    """Draw the border of the image, 0.5 px beyond the outermost pixel centres."""
    right, bottom = (side - 0.5 for side in camera.image_size)
    figure.add_scatter(
        x=[-0.5, right, right, -0.5, -0.5],
        y=[-0.5, -0.5, bottom, bottom, -0.5],
        mode="lines",
        line={"color": NEUTRAL, "width": 1.5},
        name="Border of the image",
        hoverinfo="skip",
        showlegend=False,
        **place,
    )


def _add_points(
    figure: go.Figure, place: dict[str, int], dataset: Dataset, points: FloatArray, first: bool
) -> None:
    rows = dataset.correspondences
    drawn = evenly_drawn(len(rows.frames))[np.searchsorted(rows.frames, rows.frame)]
    ends = rows.bars[drawn[rows.bars[:, 0]]]
    name = "Bar A–B" if rows.rigid_object is None else "Known distance"
    bars = np.full((len(ends), 3, 2), np.nan)  # A, B, gap
    bars[:, :2] = points[ends]
    figure.add_scatter(
        x=bars[..., 0].ravel(),
        y=bars[..., 1].ravel(),
        mode="lines",
        line={"color": FAINT, "width": 1},
        hoverinfo="skip",
        legendgroup="bars",
        name=f"{name} ({n_drawn(len(rows.bars))})",
        showlegend=first,
        **place,
    )
    for target, of_target, colour, symbol in marks_of(rows):
        shown = of_target & drawn
        figure.add_scatter(
            x=points[shown, 0],
            y=points[shown, 1],
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 8 if len(rows.frames) <= 100 else 5},
            customdata=rows.frame[shown],
            legendgroup=target,
            name=f"Target {target} (n = {of_target.sum()})",
            showlegend=first,
            hovertemplate=(
                f"frame %{{customdata}}, target {target}<br>"
                "u %{x:.2f} px, v %{y:.2f} px<extra></extra>"
            ),
            **place,
        )


def _set_axes(
    figure: go.Figure, place: dict[str, int], number: int, side: str, camera: Camera, narrow: bool
) -> None:
    """Set image axes: u to the right along the top, v downwards, equal scales."""
    width, height = camera.image_size
    margin = 0.01 * max(width, height)
    figure.update_xaxes(
        **place,
        side="top",
        range=[-0.5 - margin, width - 0.5 + margin],
        title_text=f"<b>{side}</b><br>{_size(camera)}<br>u (px)",
        constrain="domain",
        nticks=3,
        constraintoward="left" if narrow or number == 2 else "right",
        tickangle=0,
        showgrid=False,
    )
    figure.update_yaxes(
        **place,
        range=[height - 0.5 + margin, -0.5 - margin],
        title_text="v (px)",
        side="left" if narrow or number == 1 else "right",
        scaleanchor="x" if number == 1 else "x2",
        constrain="domain",
        constraintoward="top",
        nticks=6,
        showgrid=False,
    )
