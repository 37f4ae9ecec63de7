"""Maps of the predicted accuracy of the rig, seen from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import AXIS, LAYOUT, NEUTRAL, note, sentence_only
from stereocal.refined.refine import RefinedResult
from stereocal.refined.uncertainty import AccuracyMap
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 860, 140, 420
"""Of a map in px: at this width of the page, equal axes fill their room."""
LEAST_STEP = 0.12
"""Least distance of two ticks of the scale over its length: numbers nearer than that touch on a
narrow page."""
FEWEST_TICKS = 3
TOP, TITLE, GAP, FOOT = 112, 26, 72, 62
Quantity = Literal["distance", "point"]
TITLES: dict[Quantity, str] = {
    "distance": "Error of a distance as long as the bar (%)",
    "point": "Error of a point (mm)",
}
UNITS: dict[Quantity, str] = {"distance": " %", "point": " mm"}
NO_VIEW = "The cameras share no view in these planes."
AXIS_OF = {"above": 0, "side": 1}
ACROSS = {"above": "To the right (m)", "side": "Down (m)"}


def plot_accuracy(
    maps: Sequence[AccuracyMap], result: RefinedResult, quantity: Quantity = "distance"
) -> go.Figure:
    """Predicted standard error of points or distances where both cameras see.

    Args:
        maps: one below the other, with the depth to the right and equal axes.
    """
    if not np.isfinite(_values(maps, quantity)).any():
        return sentence_only(NO_VIEW)
    low, high = np.nanpercentile(np.log10(_values(maps, quantity)), [1, 99])
    ticks = _ticks(float(low), float(high))
    bounds = [_bounds(found, result) for found in maps]
    near, far = (f(b[1, end] for b in bounds) for f, end in ((min, 0), (max, 1)))
    heights = [
        float(np.clip(WIDTH * np.ptp(b[0]) / (far - near), LEAST_HEIGHT, MOST_HEIGHT))
        for b in bounds
    ]
    inside = sum(heights) + GAP * (len(maps) - 1)
    layout: dict[str, Any] = {
        **LAYOUT,
        "height": inside + TOP + FOOT,
        "showlegend": False,
        "margin": {**LAYOUT["margin"], "t": TOP, "b": FOOT},
        "coloraxis": {
            "colorscale": "Cividis",
            "cmin": low,
            "cmax": high,
            "colorbar": {
                "title": {"text": TITLES[quantity], "side": "top"},
                "orientation": "h",
                "y": 1 + (TITLE + 6) / inside,
                "yanchor": "bottom",
                "thickness": 14,
                "tickvals": np.log10(ticks),
                "ticktext": [f"{t:g}" for t in ticks],
            },
        },
        "annotations": [*(_title(found, at) for at, found in enumerate(maps)), _depth(len(maps))],
    }
    traces: list[dict[str, Any]] = []
    top = 1.0
    for at, (found, height) in enumerate(zip(maps, heights, strict=True)):
        domain = [max(top - height / inside, 0.0), top]
        top = domain[0] - GAP / inside
        layout |= _axes(at, found, bounds[at][0], (near, far), domain)
        traces += _traces(at, found, result, quantity)
    return go.Figure(data=traces, layout=layout)


def _ticks(low: float, high: float) -> FloatArray:
    """Round values from 10**low to 10**high, far enough apart for their numbers."""
    ticks = np.empty(0)
    for digits in (1, 2, 3):
        ticks = np.unique([float(f"{10**at:.{digits}g}") for at in np.linspace(low, high, 6)])
        at = np.log10(ticks)
        ticks = ticks[(at >= low - 1e-9) & (at <= high + 1e-9)]
        ticks = ticks[np.diff(np.log10(ticks), prepend=-np.inf) > LEAST_STEP * (high - low)]
        if len(ticks) >= FEWEST_TICKS:
            break
    return np.asarray(ticks)


def _bounds(found: AccuracyMap, result: RefinedResult) -> FloatArray:
    """(2, 2): least and most of the axis across and of the depth, the cameras included, in m."""
    values = np.isfinite(found.point_m)
    across, depth = found.across_m[values.any(axis=0)], found.z_m[values.any(axis=1)]
    axis, centre = AXIS_OF[found.plane], -result.pose.R.T @ result.pose.T
    ends = np.array(
        [
            [min([*across, 0.0, centre[axis]]), max([*across, 0.0, centre[axis]])],
            [min([*depth, 0.0, centre[2]]), max([*depth, 0.0, centre[2]])],
        ]
    )
    margin = 0.03 * np.ptp(ends[1])
    return np.asarray(ends + np.array([[-margin, margin], [-margin, 0.0]]))


def _axes(
    at: int, found: AccuracyMap, across: FloatArray, depth: tuple[float, float], domain: list[float]
) -> dict[str, Any]:
    """Equal axes; what is to the right, or down, is drawn downwards."""
    number, title = str(at + 1) if at else "", AXIS["title"]
    return {
        f"xaxis{number}": {
            **AXIS,
            "anchor": f"y{number}",
            "range": list(depth),
            "showgrid": False,
            "constrain": "domain",
        },
        f"yaxis{number}": {
            **AXIS,
            "anchor": f"x{number}",
            "range": [across[1], across[0]],
            "domain": domain,
            "scaleanchor": f"x{number}",
            "constrain": "domain",
            "showgrid": False,
            "title": {**title, "text": ACROSS[found.plane]},
        },
    }


def _title(found: AccuracyMap, at: int) -> dict[str, Any]:
    number = str(at + 1) if at else ""
    away, primary = f"{abs(found.at_m):.1f} m", "the primary camera"
    if found.plane == "side":
        side = "right" if found.at_m >= 0 else "left"
        where = f"{away} to the {side} of" if found.at_m else "straight ahead of"
        text = f"<b>From the side</b>, {where} {primary}"
    else:
        where = (
            f"{away} {'below' if found.at_m > 0 else 'above'}" if found.at_m else "at the height of"
        )
        text = f"<b>From above</b>, {where} {primary}"
    left = {"xref": "paper", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom", "yshift": 4}
    return note(text, number, {"size": 13}) | left


def _depth(maps: int) -> dict[str, Any]:
    """The title of the depth, below the last map; Plotly puts that of an axis with a constrained
    domain into the map.
    """
    number = str(maps) if maps > 1 else ""
    below = {"x": 0.5, "y": 0, "xanchor": "center", "yanchor": "top", "yshift": -30}
    return note("Ahead of the primary camera (m)", number, AXIS["title"]["font"]) | below


def _traces(
    at: int, found: AccuracyMap, result: RefinedResult, quantity: Quantity
) -> list[dict[str, Any]]:
    """The map, the cameras and the targets of the bar."""
    number, axis = str(at + 1) if at else "", AXIS_OF[found.plane]
    own = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
    values = _values([found], quantity)[0].T
    centre = -result.pose.R.T @ result.pose.T
    ends = result.used_points_m.reshape(-1, 3)
    towards = "to the right" if found.plane == "above" else "down"
    of_map = {
        "type": "heatmap",
        "x": found.z_m,
        "y": found.across_m,
        "z": np.log10(values),
        "customdata": values,
        "coloraxis": "coloraxis",
        "hoverongaps": False,
        "hovertemplate": f"%{{y:.1f}} m {towards}, %{{x:.1f}} m ahead<br>"
        f"%{{customdata:.2~r}}{UNITS[quantity]}<extra></extra>",
    }
    cameras = {
        "type": "scatter",
        "x": [0.0, centre[2]],
        "y": [0.0, centre[axis]],
        "mode": "markers+text" if found.plane == "above" else "markers",
        # On a narrow page the names reach into the map, where only grey is seen in both themes.
        "text": [f'<span style="color:{NEUTRAL}">{name}</span>' for name in CAMERAS],
        "textposition": "middle right",
        "cliponaxis": False,
        "marker": {"symbol": "square", "size": 11, "color": NEUTRAL},
        "hovertemplate": "%{text} camera<extra></extra>",
        "name": "Cameras",
    }
    targets = {
        "type": "scatter",
        "x": ends[:, 2],
        "y": ends[:, axis],
        "mode": "markers",
        "name": "Targets of the bar",
        "marker": {"size": 4, "color": "white", "line": {"color": "black", "width": 1}},
        "hovertemplate": "a target of the bar<extra></extra>",
    }
    return [{**trace, **own} for trace in (of_map, cameras, targets)]


def describe_accuracy(maps: Sequence[AccuracyMap], quantity: Quantity = "distance") -> str:
    """The figure in words."""
    values = _values(maps, quantity)
    if not np.isfinite(values).any():
        return NO_VIEW
    low, middle, high = np.nanpercentile(values, [5, 50, 95])
    best, j, i = np.unravel_index(int(np.nanargmin(values)), values.shape)
    unit, found = UNITS[quantity], maps[int(best)]
    across = found.across_m[i]
    sides = ("left of", "right of") if found.plane == "above" else ("above", "below")
    towards = sides[int(across >= 0)]
    return (
        f"From above and from the side: {TITLES[quantity].lower().split(' (')[0]}, one standard "
        f"error, is {rounded(middle)}{unit} (median) where both cameras see, from {rounded(low)} "
        f"to {rounded(high)}{unit} (5th to 95th percentile), and least {found.z_m[j]:.1f} m ahead "
        f"and {abs(across):.1f} m {towards} the primary camera. Points: the targets of the bar."
    )


def _values(maps: Sequence[AccuracyMap], quantity: Quantity) -> FloatArray:
    """(maps, j, i), in the unit of the quantity."""
    if quantity == "distance":
        return np.array([100 * found.distance for found in maps])
    return np.array([1000 * found.point_m for found in maps])
