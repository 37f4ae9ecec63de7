"""Histograms of best and second-best matching errors, with the threshold."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import (
    CORRECT_COLOUR,
    FILLS,
    NEUTRAL,
    WRONG_COLOUR,
    count,
    finish,
    sentence_only,
)
from stereocal.matching.matching import NearestErrors
from stereocal.matching.threshold import ThresholdChoice
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

HEIGHT = 340
BINS_PER_DECADE = 10
MAXIMUM_DECADES = 5.0
"""Range of the histogram below the largest error; smaller errors count in the first bin."""


def plot_pair_errors(nearest: NearestErrors, threshold_px: float) -> go.Figure:
    """Histograms of the best and the second-best error of each point, and the threshold."""
    edges = _edges(nearest, threshold_px)
    if edges is None:
        return sentence_only("No pair of points meets in front of both cameras.")
    figure = finish(go.Figure(), HEIGHT)
    for name, errors, colour, fill in (
        ("Best partner", nearest.best_px, CORRECT_COLOUR, FILLS["correct"]),
        ("Runner-up", nearest.runner_up_px, WRONG_COLOUR, None),
    ):
        known = errors[np.isfinite(errors)]
        counts, _ = np.histogram(np.clip(known, edges[0], edges[-1]), edges)
        pattern = {"shape": "/", "fgcolor": colour, "bgcolor": "rgba(0,0,0,0)", "size": 6}
        figure.add_scatter(
            x=np.repeat(edges, 2),
            y=np.concatenate([[0], np.repeat(counts, 2), [0]]),
            mode="lines",
            line={"color": colour, "width": 2},
            fill="tozeroy",
            **({"fillcolor": fill} if fill else {"fillpattern": pattern}),
            name=f"{name} (n = {len(known)})",
            hovertemplate=f"{name}: %{{y}} points at %{{x:.3~r}} px<extra></extra>",
        )
    _add_threshold(figure, threshold_px)
    figure.update_xaxes(
        type="log",
        title_text="Reprojection error (px)",
        range=np.log10(edges[[0, -1]]).tolist(),
        dtick=1 if np.log10(edges[-1] / edges[0]) > 2 else None,
    )
    figure.update_yaxes(title_text="Points of the primary", rangemode="tozero")
    return figure


def describe_pair_errors(
    nearest: NearestErrors, threshold_px: float, choice: ThresholdChoice | None
) -> str:
    """The figure in words.

    Args:
        choice: the threshold, and what it does; None if there is none.
    """
    best, second = nearest.within(threshold_px)
    return (
        f"Of {count(len(nearest), 'point')} of the primary camera in "
        f"{count(nearest.frames, 'frame')}, {best} have a partner within "
        f"{rounded(threshold_px, 3)} px, and {second} have a second one. {_advice(nearest, choice)}"
    )


def _advice(nearest: NearestErrors, choice: ThresholdChoice | None) -> str:
    """Where a good threshold is, if there is one."""
    if not np.isfinite(nearest.runner_up_px).any():
        return "No point has a second candidate, so the threshold only leaves out poor pairs."
    shares = None if choice is None else choice.shares
    if choice is None or shares is None:
        return "The two distributions overlap too much: no threshold separates them."
    if shares.apart:
        return "A good threshold lies between the two distributions."
    return (
        f"The two distributions overlap: at {rounded(choice.threshold_px, 3)} px, about "
        f"{100 * shares.lost:.0f} % of the correct pairs are lost, and "
        f"{100 * shares.wrong:.0f} % of the pairs are wrong."
    )


def _edges(nearest: NearestErrors, threshold_px: float) -> FloatArray | None:
    both = np.concatenate([nearest.best_px, nearest.runner_up_px])
    positive = both[np.isfinite(both) & (both > 0)]
    if not len(positive):
        return None
    top = max(float(positive.max()), 2 * threshold_px)
    low = max(min(float(positive.min()), threshold_px / 2 or np.inf), top / 10**MAXIMUM_DECADES)
    first, last = (np.floor(np.log10(low) * 10) / 10, np.ceil(np.log10(top) * 10) / 10)
    decades = max(last - first, 0.1)
    edges: FloatArray = np.logspace(first, last, round(decades * BINS_PER_DECADE) + 1)
    return edges


def _add_threshold(figure: go.Figure, threshold_px: float) -> None:
    if threshold_px <= 0:
        return
    figure.add_vline(
        x=threshold_px,
        line={"color": NEUTRAL, "width": 2, "dash": "dash"},
        annotation={
            "text": f"<b>{rounded(threshold_px, 3)} px</b>",
            "font": {"size": 14},
            "x": np.log10(threshold_px),
            "yanchor": "top",
        },
    )
