"""Positions of the targets in the two images."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.figures.style import count, n_drawn
from stereocal.rig.camera import CAMERAS
from stereocal.rig.dataset import Dataset
from stereocal.rig.residual_field import cells_of

GRID_CELLS = 4
"""The description counts the covered cells of a grid with this many rows and columns."""


def plot_coverage(dataset: Dataset, narrow: bool = False) -> go.Figure:
    """The points of A and B in both images, joined by the bar of each frame.

    Args:
        narrow: the images one below the other, else side by side.
    """
    rows, columns = (2, 1) if narrow else (1, 2)
    spacing = {"horizontal_spacing": 0.04, "vertical_spacing": 0.17}
    figure = style.blank(880 if narrow else 440, rows, columns, **spacing)
    for number in (1, 2):
        place = {"row": min(number, rows), "col": min(number, columns)}
        _add_points(figure, dataset, number, place)
        _set_axes(figure, dataset, number, place, narrow)
    # Fixed margins, because the panels' titles are between the legend and the images.
    figure.update_layout(margin_t=125, legend={"yref": "container", "y": 1.0, "yanchor": "top"})
    return figure


def describe_coverage(dataset: Dataset) -> str:
    """The figure in words."""
    rows = dataset.correspondences
    (first, of_first, *_), *others = style.marks_of(rows)
    parts = [
        f"in the {side} image they fall into "
        f"{len(np.unique(cells_of(points, camera.image_size, (GRID_CELLS, GRID_CELLS))))} of "
        f"{GRID_CELLS**2} equal parts of its {camera.image_size[0]} × {camera.image_size[1]} px"
        for side, camera, points in zip(
            CAMERAS,
            (dataset.primary, dataset.secondary),
            (rows.primary, rows.secondary),
            strict=True,
        )
    ]
    return (
        f"Image points of {count(int(of_first.sum()), 'target')} "
        f"{' and '.join([first, *(f'{of.sum()} {name}' for name, of, *_ in others)])} in "
        f"{count(len(rows.frames), 'frame')}: {' and '.join(parts)}."
    )


def _add_points(figure: go.Figure, dataset: Dataset, number: int, place: dict[str, int]) -> None:
    """The border of an image, 0.5 px beyond the outermost pixel centres, its bars and targets."""
    rows, first = dataset.correspondences, number == 1
    camera, points = (
        (dataset.primary, rows.primary) if first else (dataset.secondary, rows.secondary)
    )
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * camera.image_size - 0.5
    border, place = style.line_of(width=1.5), {**place, "showlegend": False}
    style.add(figure, corners, line=border, name="Border of the image", **place)
    place["showlegend"] = first
    drawn = style.evenly_drawn(len(rows.frames))[np.searchsorted(rows.frames, rows.frame)]
    bars = style.with_gaps(points[rows.bars[drawn[rows.bars[:, 0]]]])
    name = "Bar A–B" if rows.rigid_object is None else "Known distance"
    bar = {"name": f"{name} ({n_drawn(len(rows.bars))})", "legendgroup": "bars"}
    style.add(figure, bars, line=style.line_of(style.FAINT, 1), **bar, **place)
    size = 8 if len(rows.frames) <= 100 else 5
    for target, of_target, colour, symbol in style.marks_of(rows):
        shown = of_target & drawn
        style.add(
            figure,
            points[shown],
            f"frame %{{customdata}}, target {target}<br>u %{{x:.2f}} px, v %{{y:.2f}} px",
            marker={"color": colour, "symbol": symbol, "size": size},
            customdata=rows.frame[shown],
            legendgroup=target,
            name=f"Target {target} (n = {of_target.sum()})",
            **place,
        )


def _set_axes(
    figure: go.Figure, dataset: Dataset, number: int, place: dict[str, int], narrow: bool
) -> None:
    """Set image axes: u to the right along the top, v downwards, equal scales."""
    width, height = (dataset.primary, dataset.secondary)[number - 1].image_size
    margin = 0.01 * max(width, height)
    common = {"constrain": "domain", "showgrid": False, **place}
    figure.update_xaxes(
        side="top",
        range=[-0.5 - margin, width - 0.5 + margin],
        title_text=f"<b>{CAMERAS[number - 1].capitalize()}</b><br>{width} × {height} px<br>u (px)",
        nticks=3,
        constraintoward="left" if narrow or number == 2 else "right",
        tickangle=0,
        **common,
    )
    figure.update_yaxes(
        range=[height - 0.5 + margin, -0.5 - margin],
        title_text="v (px)",
        side="left" if narrow or number == 1 else "right",
        scaleanchor="x" if number == 1 else "x2",
        constraintoward="top",
        nticks=6,
        **common,
    )
