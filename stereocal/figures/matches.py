"""The pairs of one frame in an image, and the points without a partner."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures.photograph import Photograph, photograph_behind
from stereocal.figures.style import NEUTRAL, WRONG_COLOUR, add, blank, count
from stereocal.rig.camera import CameraName
from stereocal.rig.compiled import BoolArray, FloatArray

MAXIMUM_DRAWN = 3000
"""Maximum number of points of one kind that are drawn in an image, evenly thinned."""
MAXIMUM_NUMBERS = 40
"""Maximum number of pairs that are numbered; more numbers would overlap."""
PAIR_COLOURS = ((0.0, "#1F83C4"), (0.33, "#009E73"), (0.67, "#D55E00"), (1.0, "#CC79A7"))
ON_PHOTOGRAPH = {"color": "white", "shadow": "0 0 3px #000, 0 0 3px #000"}
"""Text that can be read on bright and dark photographs."""


def plot_matches(
    pairs: pd.DataFrame,
    points: FloatArray,
    side: CameraName,
    size: tuple[int, int],
    photograph: Photograph | None = None,
) -> go.Figure:
    """One image of one frame; partners have the same number and colour in both.

    Args:
        pairs: the rows of `pairs.csv` of this frame.
        points: (n, 2) all points of the frame in this image, raw pixels.
        size: width and height of the image.
        photograph: what is drawn behind the points.
    """
    pairs = pairs.sort_values("u_primary", ignore_index=True)
    figure, (width, height) = blank(350), size
    figure.layout.uirevision, figure.layout.showlegend, figure.layout.margin.pad = side, False, 0
    if photograph is not None:
        box = (-0.5, -0.5, width - 0.5, height - 0.5)
        figure.layout.images = photograph_behind(photograph, box)
    alone = points[unmatched(pairs, points, side)]
    colour = WRONG_COLOUR if photograph is not None else NEUTRAL
    marker = {"symbol": "circle-open", "size": 9, "line": {"width": 2}, "color": colour}
    hover, name = "no partner<br>u %{x:.2f} px, v %{y:.2f} px", f"No partner (n = {len(alone)})"
    add(figure, alone[:: thinned(len(alone))], hover, marker=marker, name=name)
    _add_pairs(figure, side, pairs, photograph is not None)
    common = {"constrain": "domain", "showgrid": False, "mirror": True}
    ticks = {"nticks": 4, "tickangle": 0, "ticksuffix": " px"}
    figure.update_xaxes(range=[-0.5, width - 0.5], **ticks, **common)
    common |= {"nticks": 5, "scaleanchor": "x", "constraintoward": "top"}
    figure.update_yaxes(range=[height - 0.5, -0.5], **common)
    return figure


def describe_matches(
    pairs: pd.DataFrame, primary: FloatArray, secondary: FloatArray, frame: int
) -> str:
    """The figure in words."""
    left = [
        int(unmatched(pairs, points, side).sum())
        for side, points in (("primary", primary), ("secondary", secondary))
    ]
    most = max(len(pairs), *left)
    text = (
        f"Frame {frame}: {count(len(pairs), 'pair')}, {int(pairs['ambiguous'].sum())} of them "
        f"ambiguous (diamonds); without a partner (hollow): {left[0]} of {len(primary)} points of "
        f"the primary camera and {left[1]} of {len(secondary)} of the secondary."
    )
    if most > MAXIMUM_DRAWN:
        text += f" At most {MAXIMUM_DRAWN} of each kind are drawn, evenly spread."
    return text


def unmatched(pairs: pd.DataFrame, points: FloatArray, side: str) -> BoolArray:
    """(n,): which of the points (n, 2) are in no pair."""
    taken = {tuple(row) for row in pairs[[f"u_{side}", f"v_{side}"]].to_numpy(dtype=np.float64)}
    return np.array([tuple(point) not in taken for point in points], dtype=np.bool_)


def _add_pairs(
    figure: go.Figure, side: CameraName, pairs: pd.DataFrame, on_photograph: bool
) -> None:
    """Pairs as discs, ambiguous ones as diamonds, coloured by their order in the primary image."""
    rank = np.arange(len(pairs)) / max(len(pairs) - 1, 1)
    ambiguous = pairs["ambiguous"].to_numpy(dtype=np.bool_)
    step = thinned(len(pairs))
    for chosen, name, symbol in (
        (~ambiguous, "Pair", "circle"),
        (ambiguous, "Ambiguous pair", "diamond"),
    ):
        if not chosen.any():
            continue
        drawn = np.flatnonzero(chosen)[::step]
        rows = pairs.iloc[drawn]
        add(
            figure,
            rows[[f"u_{side}", f"v_{side}"]].to_numpy(dtype=np.float64),
            f"{name.lower()} %{{text}}<br>u %{{x:.2f}} px, v %{{y:.2f}} px<br>error "
            "%{customdata[0]:.3f} px, runner-up %{customdata[1]:.3f} px",
            mode="markers+text" if len(pairs) <= MAXIMUM_NUMBERS else "markers",
            text=[str(k + 1) for k in drawn],
            textposition="top center",
            textfont={"size": 13, **(ON_PHOTOGRAPH if on_photograph else {})},
            name=f"{name} (n = {np.count_nonzero(chosen)})",
            marker={
                "symbol": symbol,
                "size": 9 if len(pairs) <= 200 else 6,
                "color": rank[drawn],
                "colorscale": [list(stop) for stop in PAIR_COLOURS],
                "cmin": 0.0,
                "cmax": 1.0,
                "line": {"width": 1 if on_photograph else 0, "color": "white"},
            },
            customdata=rows[["error_px", "runner_up_px"]],
        )


def thinned(points: int) -> int:
    """Every n-th point is drawn."""
    return -(-points // MAXIMUM_DRAWN) or 1
