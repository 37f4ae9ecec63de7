"""Positions of the targets in the two images."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.figures.style import (
    FAINT,
    NEUTRAL,
    TARGET_COLOURS,
    TARGET_SYMBOLS,
    count,
    evenly_drawn,
    finish,
    n_drawn,
)
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import TARGETS, Dataset
from stereocal.rig.residual_field import cells_of

HEIGHT = 440
GRID_CELLS = 4
"""The description counts the covered cells of a grid with this many rows and columns."""


def plot_coverage(dataset: Dataset) -> go.Figure:
    """The points of A and B in both images, side by side, joined by the bar of each frame."""
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.04)
    finish(figure, HEIGHT)
    for column, (side, camera, points) in enumerate(_sides(dataset), start=1):
        _add_image(figure, column, camera)
        _add_points(figure, column, dataset, points)
        _set_axes(figure, column, side, camera)
    # Fixed margins, because the panels' titles are between the legend and the images.
    figure.update_layout(margin_t=125, legend={"yref": "container", "y": 1.0, "yanchor": "top"})
    return figure


def describe_coverage(dataset: Dataset) -> str:
    """The figure in words."""
    rows = dataset.correspondences
    parts = [
        f"in the {side.lower()} image they fall into {_covered_cells(points, camera)} of "
        f"{GRID_CELLS**2} equal parts of its {_size(camera)}"
        for side, camera, points in _sides(dataset)
    ]
    return (
        f"Image points of {count(int((rows.target == 0).sum()), 'target')} A and "
        f"{int((rows.target == 1).sum())} B in {count(len(rows.frames), 'frame')}: "
        f"{' and '.join(parts)}."
    )


def _sides(dataset: Dataset) -> tuple[tuple[str, Camera, FloatArray], ...]:
    rows = dataset.correspondences
    return (
        ("Primary", dataset.primary, rows.primary),
        ("Secondary", dataset.secondary, rows.secondary),
    )


def _size(camera: Camera) -> str:
    return f"{camera.image_size[0]} × {camera.image_size[1]} px"


def _add_image(figure: go.Figure, column: int, camera: Camera) -> None:
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
        row=1,
        col=column,
    )


def _add_points(figure: go.Figure, column: int, dataset: Dataset, points: FloatArray) -> None:
    rows = dataset.correspondences
    drawn = evenly_drawn(len(rows.frames))[np.searchsorted(rows.frames, rows.frame)]
    ends = rows.bars[drawn[rows.bars[:, 0]]]
    bars = np.full((len(ends), 3, 2), np.nan)  # A, B, gap
    bars[:, :2] = points[ends]
    figure.add_scatter(
        x=bars[..., 0].ravel(),
        y=bars[..., 1].ravel(),
        mode="lines",
        line={"color": FAINT, "width": 1},
        hoverinfo="skip",
        legendgroup="bars",
        name=f"Bar A–B ({n_drawn(len(rows.bars))})",
        showlegend=column == 1,
        row=1,
        col=column,
    )
    for number, target in enumerate(TARGETS):
        of_target = rows.target == number
        shown = of_target & drawn
        figure.add_scatter(
            x=points[shown, 0],
            y=points[shown, 1],
            mode="markers",
            marker={
                "color": TARGET_COLOURS[target],
                "symbol": TARGET_SYMBOLS[target],
                "size": 8 if len(rows.frames) <= 100 else 5,
            },
            customdata=rows.frame[shown],
            legendgroup=target,
            name=f"Target {target} (n = {of_target.sum()})",
            showlegend=column == 1,
            hovertemplate=(
                f"frame %{{customdata}}, target {target}<br>"
                "u %{x:.2f} px, v %{y:.2f} px<extra></extra>"
            ),
            row=1,
            col=column,
        )


def _set_axes(figure: go.Figure, column: int, side: str, camera: Camera) -> None:
    """Set image axes: u to the right along the top, v downwards, equal scales."""
    width, height = camera.image_size
    margin = 0.01 * max(width, height)
    figure.update_xaxes(
        row=1,
        col=column,
        side="top",
        range=[-0.5 - margin, width - 0.5 + margin],
        title_text=f"<b>{side}</b><br>{_size(camera)}<br>u (px)",
        constrain="domain",
        nticks=3,
        constraintoward="right" if column == 1 else "left",
        tickangle=0,
        showgrid=False,
    )
    figure.update_yaxes(
        row=1,
        col=column,
        range=[height - 0.5 + margin, -0.5 - margin],
        title_text="v (px)",
        side="left" if column == 1 else "right",
        scaleanchor="x" if column == 1 else "x2",
        constrain="domain",
        constraintoward="top",
        nticks=6,
        showgrid=False,
    )


def _covered_cells(points: FloatArray, camera: Camera) -> int:
    """Number of cells of a grid over the image that contain a point."""
    return len(np.unique(cells_of(points, camera.image_size, (GRID_CELLS, GRID_CELLS))))
