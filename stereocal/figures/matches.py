"""The pairs of one frame in an image, or what several cameras see, points without a partner; and
histograms of best and second-best matching errors with the threshold."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures import style
from stereocal.figures.style import Photograph, add_trace, count, thinned
from stereocal.matching.threshold import ThresholdChoice
from stereocal.rig.camera import camera_in_words
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import listed

MAXIMUM_DRAWN = 3000
"""Maximum number of points of one kind that are drawn in an image, evenly thinned."""
MAXIMUM_NUMBERS = 40
"""Maximum number of pairs that are numbered; more numbers would overlap."""
PAIR_COLOURS = ((0.0, "#1F83C4"), (0.33, "#009E73"), (0.67, "#D55E00"), (1.0, "#CC79A7"))
ON_PHOTOGRAPH = {"color": "white", "shadow": "0 0 3px #000, 0 0 3px #000"}
"""Text that can be read on bright and dark photographs."""
BINS_PER_DECADE = 10
MAXIMUM_DECADES = 5.0
"""Range of the histogram below the largest error; smaller errors count in the first bin."""
HATCH = {"shape": "/", "fgcolor": style.WRONG_COLOUR, "bgcolor": style.TRANSPARENT, "size": 6}


def plot_matches(
    pairs: pd.DataFrame,
    points: FloatArray,
    side: str,
    size: tuple[int, int],
    photograph: Photograph | None = None,
) -> go.Figure:
    """One image of one frame; partners have the same number and colour in all.

    Args:
        pairs: the rows of `pairs.csv`, or of `tracks.csv`, of this frame.
        side: the camera.
        points: (n, 2) all points of the frame in this image, raw pixels.
        size: width and height of the image.
        photograph: what is drawn behind the points.
    """
    figure = style.blank(350)
    figure.layout.uirevision, figure.layout.showlegend, figure.layout.margin.pad = side, False, 0
    colour = style.NEUTRAL
    if photograph is not None:
        box, colour = (-0.5, -0.5, size[0] - 0.5, size[1] - 0.5), style.WRONG_COLOUR
        figure.layout.images = style.photograph_behind(photograph, box)
    alone = points[unmatched(pairs, points, side)]
    marker = {"symbol": "circle-open", "size": 9, "line": {"width": 2}, "color": colour}
    hover, name = "no partner<br>u %{x:.2f} px, v %{y:.2f} px", f"No partner (n = {len(alone):,})"
    add_trace(figure, alone[thinned(len(alone), MAXIMUM_DRAWN)], hover, marker=marker, name=name)
    first = next(name for name in map(str, pairs) if name.startswith("u_"))
    ordered = pairs.sort_values(first, ignore_index=True)
    _add_pairs(figure, side, ordered, photograph is not None)
    x = {"nticks": 4, "tickangle": 0, "ticksuffix": " px", "mirror": True}
    style.set_image_axes(figure, size, 0.0, x, {"nticks": 5, "mirror": True})
    return figure


def describe_matches(pairs: pd.DataFrame, seen: Mapping[str, FloatArray], frame: int) -> str:
    """How many pairs, or points of several cameras, there are, and images without a partner.

    Args:
        seen: all points of the frame by camera, (n, 2) raw pixels.
    """
    left = {side: int(unmatched(pairs, points, side).sum()) for side, points in seen.items()}
    most, what = max(len(pairs), *left.values()), "pair"
    if "views" in pairs:
        what = "point"
    alone = listed(
        [
            f"{left[side]} of {count(len(points), 'point')} of {camera_in_words(side)}"
            for side, points in seen.items()
        ]
    )
    text = (
        f"Frame {frame}: {count(len(pairs), what)}, {int(pairs['ambiguous'].sum())} of them "
        f"ambiguous (diamonds); without a partner (hollow): {alone}."
    )
    if most > MAXIMUM_DRAWN:
        text += f" At most {MAXIMUM_DRAWN} of each kind are drawn, evenly spread."
    return text


def unmatched(pairs: pd.DataFrame, points: FloatArray, side: str) -> BoolArray:
    """(n,): which of the points (n, 2) are in no pair."""
    taken = {tuple(row) for row in pairs[[f"u_{side}", f"v_{side}"]].to_numpy(dtype=np.float64)}
    return np.array([tuple(point) not in taken for point in points], dtype=np.bool_)


def _add_pairs(figure: go.Figure, side: str, pairs: pd.DataFrame, on_photograph: bool) -> None:
    """Pairs as discs, ambiguous ones as diamonds, coloured by their order in the first image."""
    rank = np.arange(len(pairs)) / max(len(pairs) - 1, 1)
    ambiguous = pairs["ambiguous"].to_numpy(dtype=np.bool_)
    seen = pairs[f"u_{side}"].notna().to_numpy()
    quality, runner_up = ["error_px"], ""
    if "runner_up_px" in pairs:
        quality, runner_up = ["error_px", "runner_up_px"], ", runner-up %{customdata[1]:.3f} px"
    for chosen, name, symbol in (
        (seen & ~ambiguous, "Pair", "circle"),
        (seen & ambiguous, "Ambiguous pair", "diamond"),
    ):
        if not chosen.any():
            continue
        drawn = np.flatnonzero(chosen)[thinned(len(pairs), MAXIMUM_DRAWN)]
        rows = pairs.iloc[drawn]
        add_trace(
            figure,
            rows[[f"u_{side}", f"v_{side}"]].to_numpy(dtype=np.float64),
            f"{name.lower()} %{{text}}<br>u %{{x:.2f}} px, v %{{y:.2f}} px<br>error "
            f"%{{customdata[0]:.3f}} px{runner_up}",
            mode="markers+text" if len(pairs) <= MAXIMUM_NUMBERS else "markers",
            text=[str(k + 1) for k in drawn],
            textposition="top center",
            textfont={"size": 13, **(ON_PHOTOGRAPH if on_photograph else {})},
            name=f"{name} (n = {np.count_nonzero(chosen):,})",
            marker={
                "symbol": symbol,
                "size": 9 if len(pairs) <= 200 else 6,
                "color": rank[drawn],
                "colorscale": [list(stop) for stop in PAIR_COLOURS],
                "cmin": 0.0,
                "cmax": 1.0,
                "line": {"width": 1 if on_photograph else 0, "color": "white"},
            },
            customdata=rows[quality],
        )


def plot_pair_errors(nearest: FloatArray, threshold_px: float) -> go.Figure:
    """Histograms of the best and the second-best error (n, 2) of each point, and the threshold."""
    positive = nearest[np.isfinite(nearest) & (nearest > 0)]
    if not len(positive):
        return style.sentence_only("No pair of points meets in front of both cameras.")
    top = max(float(positive.max()), 2 * threshold_px)
    low = max(min(float(positive.min()), threshold_px / 2 or np.inf), top / 10**MAXIMUM_DECADES)
    ends = np.floor(np.log10(low) * 10) / 10, np.ceil(np.log10(top) * 10) / 10
    decades = max(ends[1] - ends[0], 0.1)
    edges = np.logspace(*ends, round(decades * BINS_PER_DECADE) + 1)
    figure = style.blank(340)
    for name, errors, colour, fill in (
        (
            "Best partner",
            nearest[:, 0],
            style.CORRECT_COLOUR,
            {"fillcolor": style.FILLS["correct"]},
        ),
        ("Runner-up", nearest[:, 1], style.WRONG_COLOUR, {"fillpattern": HATCH}),
    ):
        known = errors[np.isfinite(errors)]
        counts, _ = np.histogram(np.clip(known, edges[0], edges[-1]), edges)
        steps = np.column_stack([np.repeat(edges, 2), np.pad(np.repeat(counts, 2), 1)])
        hover, line = f"{name}: %{{y}} points at %{{x:.3~r}} px", style.line_of(colour)
        named = {"name": f"{name} (n = {len(known):,})", "fill": "tozeroy", **fill}
        add_trace(figure, steps, hover, line=line, **named)
    if threshold_px > 0:
        text = f"<b>{rounded(threshold_px, 3)} px</b>"
        place = {"x": np.log10(threshold_px), "yanchor": "top", "font": {"size": 14}}
        figure.add_vline(x=threshold_px, line=style.DASHED, annotation={"text": text, **place})
    scale = {"type": "log", "range": list(ends), "dtick": 1 if np.ptp(ends) > 2 else None}
    figure.update_xaxes(title_text="Reprojection error (px)", **scale)
    figure.update_yaxes(title_text="Points of the primary", rangemode="tozero")
    return figure


def describe_pair_errors(
    nearest: FloatArray, frames: int, threshold_px: float, choice: ThresholdChoice | None
) -> str:
    """How many points have partners within the threshold, and whether it separates.

    Args:
        nearest: as of `plot_pair_errors`.
        frames: their number.
        choice: the threshold, and what it does; None if there is none.
    """
    best, second = np.count_nonzero(nearest <= threshold_px, axis=0)
    shares = None if choice is None else choice.shares
    if not np.isfinite(nearest[:, 1]).any():
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
        f"{count(frames, 'frame')}, {best} have a partner within "
        f"{rounded(threshold_px, 3)} px, and {second} have a second one. {advice}"
    )
