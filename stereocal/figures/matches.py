"""The pairs of one frame in both images, and the points without a partner."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.figures.style import NEUTRAL, count, finish
from stereocal.rig.compiled import BoolArray, FloatArray

HEIGHT = 480
MAXIMUM_NUMBERS = 40
"""Maximum number of pairs that are numbered; more numbers would overlap."""
PAIR_COLOURS = ((0.0, "#1F83C4"), (0.33, "#009E73"), (0.67, "#D55E00"), (1.0, "#CC79A7"))
ImageSize = tuple[int, int]


def plot_matches(
    pairs: pd.DataFrame,
    primary: FloatArray,
    secondary: FloatArray,
    sizes: tuple[ImageSize, ImageSize],
) -> go.Figure:
    """Both images of one frame side by side; partners have the same number and colour.

    Args:
        pairs: the rows of `pairs.csv` of this frame.
        primary: (n, 2) all points of the frame, raw pixels; `secondary`: (m, 2).
        sizes: width and height of both images.
    """
    pairs = pairs.sort_values("u_primary", ignore_index=True)
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.04)
    finish(figure, HEIGHT)
    for column, (side, points, size) in enumerate(
        (("primary", primary, sizes[0]), ("secondary", secondary, sizes[1])), start=1
    ):
        _add_border(figure, column, size)
        _add_unmatched(figure, column, side, points[unmatched(pairs, points, side)])
        _add_pairs(figure, column, side, pairs)
        _set_axes(figure, column, side, size)
    figure.update_layout(margin_t=125, legend={"yref": "container", "y": 1.0, "yanchor": "top"})
    return figure


def describe_matches(
    pairs: pd.DataFrame, primary: FloatArray, secondary: FloatArray, frame: int
) -> str:
    """The figure in words."""
    left = [
        int(unmatched(pairs, points, side).sum())
        for side, points in (("primary", primary), ("secondary", secondary))
    ]
    return (
        f"Frame {frame}: {count(len(pairs), 'pair')}, {int(pairs['ambiguous'].sum())} of them "
        f"ambiguous; without a partner (hollow): {left[0]} of {len(primary)} points of the primary "
        f"camera and {left[1]} of {len(secondary)} of the secondary."
    )


def unmatched(pairs: pd.DataFrame, points: FloatArray, side: str) -> BoolArray:
    """(n,): which of the points (n, 2) are in no pair."""
    taken = {tuple(row) for row in pairs[[f"u_{side}", f"v_{side}"]].to_numpy(dtype=np.float64)}
    return np.array([tuple(point) not in taken for point in points], dtype=np.bool_)


def _add_border(figure: go.Figure, column: int, size: ImageSize) -> None:
    """Draw the border of the image, 0.5 px beyond the outermost pixel centres."""
    right, bottom = (side - 0.5 for side in size)
    figure.add_trace(
        go.Scatter(
            x=[-0.5, right, right, -0.5, -0.5], y=[-0.5, -0.5, bottom, bottom, -0.5],
            mode="lines", line={"color": NEUTRAL, "width": 1.5}, name="Border of the image",
            hoverinfo="skip", showlegend=False,
        ),
        row=1, col=column,
    )  # fmt: skip


def _add_unmatched(figure: go.Figure, column: int, side: str, points: FloatArray) -> None:
    figure.add_trace(
        go.Scatter(
            x=points[:, 0], y=points[:, 1], mode="markers",
            marker={"symbol": "circle-open", "color": NEUTRAL, "size": 9, "line": {"width": 2}},
            name=f"No partner, {side} (n = {len(points)})",
            hovertemplate="no partner<br>u %{x:.2f} px, v %{y:.2f} px<extra></extra>",
        ),
        row=1, col=column,
    )  # fmt: skip


def _add_pairs(figure: go.Figure, column: int, side: str, pairs: pd.DataFrame) -> None:
    """Pairs as discs, ambiguous ones as diamonds, coloured by their order in the primary image."""
    numbered = len(pairs) <= MAXIMUM_NUMBERS
    rank = np.arange(len(pairs)) / max(len(pairs) - 1, 1)
    ambiguous = pairs["ambiguous"].to_numpy(dtype=np.bool_)
    for chosen, name, symbol in (
        (~ambiguous, "Pair", "circle"),
        (ambiguous, "Ambiguous pair", "diamond"),
    ):
        if not chosen.any():
            continue
        rows = pairs[chosen]
        figure.add_trace(
            go.Scatter(
                x=rows[f"u_{side}"], y=rows[f"v_{side}"],
                mode="markers+text" if numbered else "markers",
                text=[str(k + 1) for k in np.flatnonzero(chosen)], textposition="top center",
                textfont={"size": 13}, legendgroup=name, showlegend=column == 1,
                name=f"{name} (n = {int(chosen.sum())})",
                marker={
                    "symbol": symbol, "size": 9 if len(pairs) <= 200 else 6, "color": rank[chosen],
                    "colorscale": [list(stop) for stop in PAIR_COLOURS], "cmin": 0.0, "cmax": 1.0,
                },
                customdata=np.column_stack([rows["error_px"], rows["runner_up_px"]]),
                hovertemplate=(
                    f"{name.lower()} %{{text}}<br>u %{{x:.2f}} px, v %{{y:.2f}} px<br>error "
                    "%{customdata[0]:.3f} px, runner-up %{customdata[1]:.3f} px<extra></extra>"
                ),
            ),
            row=1, col=column,
        )  # fmt: skip


def _set_axes(figure: go.Figure, column: int, side: str, size: ImageSize) -> None:
    """Set image axes: u to the right along the top, v downwards, equal scales."""
    width, height = size
    margin = 0.01 * max(width, height)
    figure.update_xaxes(
        row=1, col=column, side="top", range=[-0.5 - margin, width - 0.5 + margin],
        title_text=f"<b>{side.capitalize()}</b><br>{width} × {height} px<br>u (px)",
        constrain="domain", nticks=4, constraintoward="right" if column == 1 else "left",
        tickangle=0, showgrid=False,
    )  # fmt: skip
    figure.update_yaxes(
        row=1, col=column, range=[height - 0.5 + margin, -0.5 - margin], title_text="v (px)",
        side="left" if column == 1 else "right", scaleanchor="x" if column == 1 else "x2",
        constrain="domain", constraintoward="top", nticks=6, showgrid=False,
    )  # fmt: skip
