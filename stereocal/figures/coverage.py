"""Positions of the targets in the two images."""

import numpy as np
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.figures.style import n_drawn
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.residual_field import cells_of
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import count

GRID_CELLS = 4
"""The description counts the covered cells of a grid with this many rows and columns."""


def plot_coverage(dataset: Pair, narrow: bool = False) -> go.Figure:
    """The points of A and B in both images, joined by the bar of each frame.

    Args:
        narrow: the images one below the other, else side by side.
    """
    shape, rows = ((2, 1) if narrow else (1, 2)), dataset.correspondences
    spacing = {"horizontal_spacing": 0.04, "vertical_spacing": 0.17}
    figure = style.blank(880 if narrow else 440, *shape, **spacing)
    for k, (name, (camera, points)) in enumerate(_images(dataset).items()):
        place = {"row": k + 1, "col": 1} if narrow else {"row": 1, "col": k + 1}
        width, height = camera.image_size
        _add_points(figure, rows, camera, points, place)
        x = {
            "side": "top",
            "title_text": f"<b>{name.capitalize()}</b><br>{width} × {height} px<br>u (px)",
            "nticks": 3,
            "constraintoward": "left" if narrow or k else "right",
            "tickangle": 0,
        }
        y = {"title_text": "v (px)", "side": "left" if narrow or not k else "right", "nticks": 6}
        style.set_image_axes(figure, camera.image_size, 0.01 * max(width, height), x, y, **place)
    # Fixed margins, because the panels' titles are between the legend and the images.
    figure.update_layout(margin_t=125, legend={"yref": "container", "y": 1.0, "yanchor": "top"})
    return figure


def describe_coverage(dataset: Pair) -> str:
    """The figure in words."""
    rows = dataset.correspondences
    (first, of_first, *_), *others = style.marks_of(rows)
    parts = [
        f"in the {name} image they fall into "
        f"{len(np.unique(cells_of(points, camera.image_size, (GRID_CELLS, GRID_CELLS))))} of "
        f"{GRID_CELLS**2} equal parts of its {camera.image_size[0]} × {camera.image_size[1]} px"
        for name, (camera, points) in _images(dataset).items()
    ]
    return (
        f"Image points of {count(int(of_first.sum()), 'target')} "
        f"{' and '.join([first, *(f'{of.sum()} {name}' for name, of, *_ in others)])} in "
        f"{count(len(rows.frames), 'frame')}: {' and '.join(parts)}."
    )


def _images(dataset: Pair) -> dict[str, tuple[Camera, FloatArray]]:
    """Cameras and their points (n, 2) by name."""
    rows = dataset.correspondences
    images = (dataset.primary, rows.primary), (dataset.secondary, rows.secondary)
    return dict(zip(CAMERAS, images, strict=True))


def _add_points(
    figure: go.Figure,
    rows: Correspondences,
    camera: Camera,
    points: FloatArray,
    place: dict[str, int],
) -> None:
    """The border of an image, 0.5 px beyond the outermost pixel centres, its bars and targets."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * camera.image_size - 0.5
    legend = {**place, "showlegend": not figure.data}
    border = style.line_of(width=1.5)
    style.add_trace(
        figure, corners, line=border, name="Border of the image", showlegend=False, **place
    )
    drawn = style.evenly_drawn(len(rows.frames))[np.searchsorted(rows.frames, rows.frame)]
    bars = style.with_gaps(points[rows.bars[drawn[rows.bars[:, 0]]]])
    name = "Bar A–B" if rows.rigid_object is None else "Known distance"
    bar = {"name": f"{name} ({n_drawn(len(rows.bars))})", "legendgroup": "bars"}
    style.add_trace(figure, bars, line=style.line_of(style.FAINT, 1), **bar, **legend)
    size = 8 if len(rows.frames) <= 100 else 5
    for target, of_target, colour, symbol in style.marks_of(rows):
        rows_drawn = of_target & drawn
        style.add_trace(
            figure,
            points[rows_drawn],
            f"frame %{{customdata}}, target {target}<br>u %{{x:.2f}} px, v %{{y:.2f}} px",
            marker={"color": colour, "symbol": symbol, "size": size},
            customdata=rows.frame[rows_drawn],
            legendgroup=target,
            name=f"Target {target} (n = {of_target.sum():,})",
            **legend,
        )
