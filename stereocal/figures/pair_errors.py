"""Histograms of best and second-best matching errors, with the threshold."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.figures.style import count
from stereocal.matching.matching import NearestErrors
from stereocal.matching.threshold import ThresholdChoice
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

BINS_PER_DECADE = 10
MAXIMUM_DECADES = 5.0
"""Range of the histogram below the largest error; smaller errors count in the first bin."""
HATCH = {"shape": "/", "fgcolor": style.WRONG_COLOUR, "bgcolor": style.TRANSPARENT, "size": 6}


def plot_pair_errors(nearest: NearestErrors, threshold_px: float) -> go.Figure:
    """Histograms of the best and the second-best error of each point, and the threshold."""
    edges = _edges(nearest, threshold_px)
    if edges is None:
        return style.sentence_only("No pair of points meets in front of both cameras.")
    figure = style.blank(340)
    for name, errors, colour, fill in (
        (
            "Best partner",
            nearest.best_px,
            style.CORRECT_COLOUR,
            {"fillcolor": style.FILLS["correct"]},
        ),
        ("Runner-up", nearest.runner_up_px, style.WRONG_COLOUR, {"fillpattern": HATCH}),
    ):
        known = errors[np.isfinite(errors)]
        counts, _ = np.histogram(np.clip(known, edges[0], edges[-1]), edges)
        steps = np.column_stack([np.repeat(edges, 2), np.pad(np.repeat(counts, 2), 1)])
        hover, line = f"{name}: %{{y}} points at %{{x:.3~r}} px", style.line_of(colour)
        named = {"name": f"{name} (n = {len(known)})", "fill": "tozeroy", **fill}
        style.add(figure, steps, hover, line=line, **named)
    if threshold_px > 0:
        text = f"<b>{rounded(threshold_px, 3)} px</b>"
        at = {"x": np.log10(threshold_px), "yanchor": "top", "font": {"size": 14}}
        figure.add_vline(x=threshold_px, line=style.DASHED, annotation={"text": text, **at})
    ends = np.log10(edges[[0, -1]])
    scale = {"type": "log", "range": ends.tolist(), "dtick": 1 if np.ptp(ends) > 2 else None}
    figure.update_xaxes(title_text="Reprojection error (px)", **scale)
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
    shares = None if choice is None else choice.shares
    if not np.isfinite(nearest.runner_up_px).any():
        advice = "No point has a second candidate, so the threshold only leaves out poor pairs."
    elif choice is None or shares is None:
        advice = "The two distributions overlap too much: no threshold separates them."
    elif shares.apart:
        advice = "A good threshold lies between the two distributions."
    else:
        advice = (
            f"The two distributions overlap: at {rounded(choice.threshold_px, 3)} px, about "
            f"{100 * shares.lost:.0f} % of the correct pairs are lost, and "
            f"{100 * shares.wrong:.0f} % of the pairs are wrong."
        )
    return (
        f"Of {count(len(nearest), 'point')} of the primary camera in "
        f"{count(nearest.frames, 'frame')}, {best} have a partner within "
        f"{rounded(threshold_px, 3)} px, and {second} have a second one. {advice}"
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
