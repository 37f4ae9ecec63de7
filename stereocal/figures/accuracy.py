"""Maps of the predicted accuracy of the rig, seen from above and from the side."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import AXIS, NEUTRAL, blank, note, scatter, sentence_only
from stereocal.fit.errors.uncertainty import AccuracyMap
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import CAMERAS
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 860, 140, 420
"""Sizes of a map in px: at this width of the page, equal axes fill their room."""
LEAST_STEP = 0.12
"""Least distance of two ticks of the scale over its length: numbers nearer than that touch on a
narrow page."""
FEWEST_TICKS = 3
TOP, TITLE, GAP, FOOT = 112, 26, 72, 62
Quantity = Literal["distance", "point"]
TITLES: dict[Quantity, str] = {
    "distance": "Standard error of a distance as long as the bar (%)",
    "point": "Standard error of a point (mm)",
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
    values = _values(maps, quantity)
    if not np.isfinite(values).any():
        return sentence_only(NO_VIEW)
    low, high = np.nanpercentile(np.log10(values), [1, 99])
    ticks = _ticks(float(low), float(high))
    bounds = [_bounds(error_map, result) for error_map in maps]
    depth = [min(b[1, 0] for b in bounds), max(b[1, 1] for b in bounds)]
    heights = [
        float(np.clip(WIDTH * np.ptp(b[0]) / np.ptp(depth), LEAST_HEIGHT, MOST_HEIGHT))
        for b in bounds
    ]
    inside = sum(heights) + GAP * (len(maps) - 1)
    bar = {
        "title": {"text": TITLES[quantity], "side": "top"},
        "orientation": "h",
        "y": 1 + (TITLE + 6) / inside,
        "yanchor": "bottom",
        "thickness": 14,
        "tickvals": np.log10(ticks),
        "ticktext": [f"{t:g}" for t in ticks],
    }
    grid = {"row_heights": tuple(heights), "vertical_spacing": GAP / inside}
    figure = blank(inside + TOP + FOOT, len(maps), **grid)
    scale = {"colorscale": "Cividis", "cmin": low, "cmax": high, "colorbar": bar}
    figure.update_layout(showlegend=False, margin_t=TOP, margin_b=FOOT, coloraxis=scale)
    common, number = {"constrain": "domain", "showgrid": False}, ""
    figure.update_xaxes(range=depth, **common)
    for row, (error_map, ends) in enumerate(zip(maps, bounds, strict=True), start=1):
        number = str(row) if row > 1 else ""
        # What is to the right, or down, is drawn downwards; axes are equal.
        y_axis = {"range": ends[0, ::-1].tolist(), "scaleanchor": f"x{number}", **common}
        figure.update_yaxes(title_text=ACROSS[error_map.plane], row=row, col=1, **y_axis)
        figure.add_annotation(_title(error_map, number))
        for trace in _traces(error_map, result, quantity, values[row - 1]):
            figure.add_trace(trace, row=row, col=1)
    # Below the last map: Plotly puts the title of an axis with a constrained domain into the map.
    below = {"x": 0.5, "y": 0, "xanchor": "center", "yanchor": "top", "yshift": -30}
    font = AXIS["title"]["font"]
    figure.add_annotation(note("Ahead of the primary camera (m)", number, font) | below)
    return figure


def _ticks(low: float, high: float) -> FloatArray:
    """Round values from 10**low to 10**high, far enough apart for their numbers."""
    ticks = np.empty(0)
    for digits in (1, 2, 3):
        ticks = np.unique([float(f"{10**log:.{digits}g}") for log in np.linspace(low, high, 6)])
        exponents = np.log10(ticks)
        ticks = ticks[(exponents >= low - 1e-9) & (exponents <= high + 1e-9)]
        ticks = ticks[np.diff(np.log10(ticks), prepend=-np.inf) > LEAST_STEP * (high - low)]
        if len(ticks) >= FEWEST_TICKS:
            break
    return np.asarray(ticks)


def _bounds(error_map: AccuracyMap, result: RefinedResult) -> FloatArray:
    """(2, 2): least and most of the axis across and of the depth, the cameras included, in m."""
    values = np.isfinite(error_map.point_m)
    centre = result.pose.inverse().T[[AXIS_OF[error_map.plane], 2]]
    across = np.append(error_map.across_m[values.any(axis=0)], [0.0, centre[0]])
    depth = np.append(error_map.z_m[values.any(axis=1)], [0.0, centre[1]])
    ends = np.array([[axis.min(), axis.max()] for axis in (across, depth)])
    margin = 0.03 * np.ptp(ends[1])
    return np.asarray(ends + np.array([[-margin, margin], [-margin, 0.0]]))


def _title(error_map: AccuracyMap, number: str) -> dict[str, Any]:
    seen, sides, straight = {
        "side": ("the side", ("to the left of", "to the right of"), "straight ahead of"),
        "above": ("above", ("above", "below"), "at the height of"),
    }[error_map.plane]
    level = error_map.at_m
    where = f"{abs(level):.1f} m {sides[level >= 0]}" if level else straight
    text = f"<b>From {seen}</b>, {where} the primary camera"
    left = {"xref": "paper", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom", "yshift": 4}
    return note(text, number, {"size": 13}) | left


def _traces(
    error_map: AccuracyMap, result: RefinedResult, quantity: Quantity, values: FloatArray
) -> list[dict[str, Any]]:
    """The map, the cameras and the targets of the bar."""
    above, seen = error_map.plane == "above", [2, AXIS_OF[error_map.plane]]
    of_map = {
        "type": "heatmap",
        "x": error_map.z_m,
        "y": error_map.across_m,
        "z": np.log10(values.T),
        "customdata": values.T,
        "coloraxis": "coloraxis",
        "hoverongaps": False,
        "hovertemplate": f"%{{y:.1f}} m {'to the right' if above else 'down'}, %{{x:.1f}} m ahead"
        f"<br>%{{customdata:.2~r}}{UNITS[quantity]}<extra></extra>",
    }
    cameras = scatter(
        np.array([np.zeros(3), result.pose.inverse().T])[:, seen],
        "%{text} camera",
        mode="markers+text" if above else "markers",
        text=list(CAMERAS),
        textposition="middle right",
        cliponaxis=False,
        marker={"symbol": "square", "size": 11, "color": NEUTRAL},
        name="Cameras",
    )
    marker = {"size": 4, "color": "white", "line": {"color": "black", "width": 1}}
    ends = result.used_points_m.reshape(-1, 3)[:, seen]
    targets = scatter(ends, "a target of the bar", marker=marker, name="Targets of the bar")
    return [of_map, cameras, targets]


def describe_accuracy(maps: Sequence[AccuracyMap], quantity: Quantity = "distance") -> str:
    """The figure in words."""
    values = _values(maps, quantity)
    if not np.isfinite(values).any():
        return NO_VIEW
    low, middle, high = np.nanpercentile(values, [5, 50, 95])
    best, j, i = np.unravel_index(int(np.nanargmin(values)), values.shape)
    unit, error_map = UNITS[quantity], maps[int(best)]
    across = error_map.across_m[i]
    sides = ("left of", "right of") if error_map.plane == "above" else ("above", "below")
    towards = sides[int(across >= 0)]
    return (
        f"From above and from the side: {TITLES[quantity].lower().split(' (')[0]} "
        f"is {rounded(middle)}{unit} (median) where both cameras see, from {rounded(low)} "
        f"to {rounded(high)}{unit} (5th to 95th percentile), and least "
        f"{error_map.z_m[j]:.1f} m ahead and {abs(across):.1f} m {towards} the primary camera. "
        "Points: the targets of the bar."
    )


def _values(maps: Sequence[AccuracyMap], quantity: Quantity) -> FloatArray:
    """(maps, j, i), in the unit of the quantity."""
    if quantity == "distance":
        return np.array([100 * error_map.distance for error_map in maps])
    return np.array([1000 * error_map.point_m for error_map in maps])
