"""Map of the predicted accuracy of the rig, seen from above."""

from __future__ import annotations

from typing import Literal

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import NEUTRAL, finish, sentence_only
from stereocal.refined.refine import RefinedResult
from stereocal.refined.uncertainty import AccuracyMap
from stereocal.rig.compiled import FloatArray

HEIGHT = 560
Quantity = Literal["distance", "point"]
TITLES: dict[Quantity, str] = {
    "distance": "Error of a distance as long as the bar (%)",
    "point": "Error of a point (mm)",
}
UNITS: dict[Quantity, str] = {"distance": " %", "point": " mm"}


def plot_accuracy(
    found: AccuracyMap, result: RefinedResult, quantity: Quantity = "distance"
) -> go.Figure:
    """Predicted standard error of points or distances where both cameras see, from above."""
    values = _values(found, quantity)
    if not np.isfinite(values).any():
        return sentence_only("The cameras share no view at the height of the primary camera.")
    figure = finish(go.Figure(), HEIGHT)
    low, high = np.nanpercentile(np.log10(values), [1, 99])
    ticks = np.unique([float(f"{10**at:.1g}") for at in np.linspace(low, high, 6)])
    figure.add_trace(
        go.Heatmap(
            x=found.x_m, y=found.z_m, z=np.log10(values), customdata=values, zmin=low, zmax=high,
            colorscale="Cividis", hoverongaps=False,
            colorbar={"title": {"text": TITLES[quantity], "side": "right"},
                      "tickvals": np.log10(ticks), "ticktext": [f"{tick:g}" for tick in ticks]},
            hovertemplate="%{x:.1f} m to the right, %{y:.1f} m ahead<br>"
            f"%{{customdata:.2g}}{UNITS[quantity]}<extra></extra>",
        )
    )  # fmt: skip
    centre = -result.pose.R.T @ result.pose.T
    figure.add_trace(
        go.Scatter(
            x=[0.0, centre[0]], y=[0.0, centre[2]], mode="markers+text",
            text=["primary", "secondary"], textposition="bottom center", cliponaxis=False,
            marker={"symbol": "square", "size": 11, "color": NEUTRAL}, showlegend=False,
            hovertemplate="%{text} camera<extra></extra>",
        )
    )  # fmt: skip
    ends = result.points_m[~result.outlying].reshape(-1, 3)
    figure.add_trace(
        go.Scatter(
            x=ends[:, 0], y=ends[:, 2], mode="markers", name="Targets of the bar", showlegend=False,
            marker={"size": 4, "color": "white", "line": {"color": "black", "width": 1}},
            hovertemplate="a target of the bar<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text="To the right of the primary camera (m)", showgrid=False)
    figure.update_yaxes(title_text="Ahead (m)", scaleanchor="x", constrain="domain", showgrid=False)
    return figure


def describe_accuracy(found: AccuracyMap, quantity: Quantity = "distance") -> str:
    """The figure in words."""
    values = _values(found, quantity)
    if not np.isfinite(values).any():
        return "The cameras share no view at the height of the primary camera."
    low, middle, high = np.nanpercentile(values, [5, 50, 95])
    j, i = np.unravel_index(int(np.nanargmin(values)), values.shape)
    unit = UNITS[quantity]
    return (
        f"Seen from above: {TITLES[quantity].lower().split(' (')[0]}, one standard error, is "
        f"{middle:.2g}{unit} (median) where both cameras see, from {low:.2g} to {high:.2g}{unit} "
        f"(5th to 95th percentile), and least {found.z_m[j]:.1f} m ahead and "
        f"{found.x_m[i]:.1f} m to the right of the primary camera. Points: the targets of the bar."
    )


def _values(found: AccuracyMap, quantity: Quantity) -> FloatArray:
    return 100 * found.distance if quantity == "distance" else 1000 * found.point_m
