"""The common style of all figures: colours (after Okabe and Ito), symbols, axes, photographs.

The colours have a contrast of at least 3:1 on the light and the dark page, and the methods can be
distinguished with colour blindness (tests/figures/test_every_figure.py).
"""

import base64
from collections.abc import Container, Mapping
from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.calibration.methods import METHOD_NAMES as METHOD_NAMES
from stereocal.rig.correspondences import TARGETS, Correspondences
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import count as count
from stereocal.system.sampling import evenly_spread

METHOD_COLOURS: Mapping[Method, str] = {
    "essential": "#7F7F7F",
    "2d": "#1F83C4",
    "3d": "#D55E00",
    "refined": "#A1458A",
}
METHOD_SYMBOLS: Mapping[Method, str] = {
    "essential": "square",
    "2d": "circle",
    "3d": "triangle-up",
    "refined": "diamond",
}
CORRECT_COLOUR, WRONG_COLOUR = "#009E73", "#C77700"
FILLS: Mapping[str, str] = {
    name: f"rgba({int(c[1:3], 16)},{int(c[3:5], 16)},{int(c[5:], 16)},0.45)"
    for name, c in (("correct", CORRECT_COLOUR), *METHOD_COLOURS.items())
}
"""Colours of the area below a curve; the area of wrong pairs is hatched."""
TARGET_COLOURS: Mapping[str, str] = {"A": "#009E73", "B": "#CC79A7"}
TARGET_SYMBOLS: Mapping[str, str] = {"A": "circle", "B": "diamond"}
OBJECT = "of the object"
"""Stands for the name of a target where an object has more than two."""
MOST_DRAWN = 2000
"""Frames or bars in one figure: the points of 20,000 were 5 MB for the browser."""
NEUTRAL = "#7F7F7F"
FAINT = "rgba(127,127,127,0.45)"
GRID = "rgba(127,127,127,0.25)"
GRID_3D = "#8C9399"
"""Opaque, because Plotly blends transparent lines in 3D scenes with white on every page."""
TRANSPARENT = "rgba(0,0,0,0)"
NOWHERE = np.full((1, 2), np.nan)
"""A point that is only in the legend."""
Photograph = npt.NDArray[np.uint8]
"""(height, width), grey."""
LONGEST_PHOTOGRAPH, JPEG_QUALITY = 1000, 85
"""Longer side in px, and quality, of a photograph behind a panel."""


LAYOUT: Mapping[str, Any] = {
    "paper_bgcolor": TRANSPARENT,
    "plot_bgcolor": TRANSPARENT,
    "margin": {"l": 8, "r": 8, "t": 8, "b": 8},
    "font": {"size": 14},
    "legend": {
        "orientation": "h",
        "x": 0,
        "xanchor": "left",
        "y": 1.0,
        "yanchor": "bottom",
        "font": {"size": 14},
        "bgcolor": TRANSPARENT,
        "itemsizing": "constant",
    },
}
"""Transparent, small margins, legend in rows above the plot."""
AXIS: Mapping[str, Any] = {
    "automargin": True,
    "showgrid": True,
    "gridcolor": GRID,
    "zeroline": False,
    "showline": True,
    "linecolor": FAINT,
    "ticks": "outside",
    "tickcolor": FAINT,
    "tickfont": {"size": 13},
    "title": {"font": {"size": 14}, "standoff": 6},
}


def blank(height: float, rows: int = 1, cols: int = 1, /, **grid: Any) -> go.Figure:
    """A figure in the common style, of one panel or, with spacings, of several."""
    if not grid and rows * cols == 1:
        return go.Figure(layout={**LAYOUT, "height": height, "xaxis": AXIS, "yaxis": AXIS})
    figure = go.Figure(_panels(rows, cols, **grid))
    figure.layout.height = height
    return figure


@cache
def _panels(rows: int, cols: int, /, **grid: Any) -> go.Figure:
    """Several panels, to be copied, which takes a fifth of the time that Plotly lays them out in.

    Without its template, which would be looked through with each copy; each is given it anew.
    """
    figure = make_subplots(rows, cols, **grid)
    figure.layout.template = None
    for axis in (*figure.select_xaxes(), *figure.select_yaxes()):
        figure.layout[axis.plotly_name] = {**AXIS, **axis.to_plotly_json()}
    # One by one, because `update_layout` takes four times as long.
    for name, value in LAYOUT.items():
        figure.layout[name] = value
    return figure


def scatter(points: FloatArray, hover: str = "", /, **trace: Any) -> dict[str, Any]:
    """Points (n, 2), or (n, 3) of a scene, drawn as what is given of `line`, `marker` and `text`.

    Args:
        hover: Plotly's template, or `name`; empty: nothing.
    """
    points = np.asarray(points)
    parts = {"line": "lines", "marker": "markers", "text": "text"}
    drawn = {"mode": "+".join(mode for part, mode in parts.items() if part in trace), **trace}
    if hover in ("", "name"):
        drawn["hoverinfo"] = hover or "skip"
    else:
        drawn["hovertemplate"] = hover if "<extra>" in hover else f"{hover}<extra></extra>"
    if points.shape[1] == 3:
        return {"type": "scatter3d", **dict(zip("xyz", upright(points).T, strict=True)), **drawn}
    return {"type": "scatter", "x": points[:, 0], "y": points[:, 1], **drawn}


def add_trace(figure: go.Figure, points: FloatArray, hover: str = "", /, **trace: Any) -> None:
    """Draw what `scatter` describes, in the panel at `row` and `col`."""
    place = {name: trace.pop(name, None) for name in ("row", "col")}
    figure.add_trace(scatter(points, hover, **trace), **place)


def upright(points: npt.ArrayLike) -> FloatArray:
    """Points (..., 3) of a scene, whose y axis points down, as the figure's: x, depth, up."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    return np.stack([x, z, -y], axis=-1)


def axis_of(title: str | None = None, /, **settings: Any) -> dict[str, Any]:
    """An axis in the common style, for a layout that is given as a whole."""
    return {**AXIS, "title": {**AXIS["title"], "text": title}, **settings}


def set_image_axes(
    figure: go.Figure,
    size: tuple[int, int],
    margin: float,
    x: Mapping[str, Any],
    y: Mapping[str, Any],
    **place: int,
) -> None:
    """The axes of an image of a size in px: u to the right, v downwards, equal scales."""
    (width, height), number = size, max(place.values(), default=1)
    common = {"constrain": "domain", "showgrid": False, **place}
    figure.update_xaxes(range=[-0.5 - margin, width - 0.5 + margin], **common, **x)
    common |= {"scaleanchor": "x" if number == 1 else f"x{number}", "constraintoward": "top"}
    figure.update_yaxes(range=[height - 0.5 + margin, -0.5 - margin], **common, **y)


def with_gaps(paths: FloatArray) -> FloatArray:
    """(n (k + 1), d): paths (n, k, d) one after the other, with a gap of NaN after each."""
    n, _, dimensions = paths.shape
    gaps = np.full((n, 1, dimensions), np.nan)
    return np.concatenate([paths, gaps], axis=1).reshape(-1, dimensions)


def line_of(colour: str = NEUTRAL, width: float = 2, dash: str = "solid") -> dict[str, Any]:
    """Plotly's line."""
    return {"color": colour, "width": width, "dash": dash}


DASHED = line_of(dash="dash")
"""A threshold or another line to compare with."""


def marker_of(method: Method, size: float, **more: Any) -> dict[str, Any]:
    """The symbol of a method."""
    marker = {"color": METHOD_COLOURS[method], "symbol": METHOD_SYMBOLS[method], "size": size}
    return marker | more


def sentence_only(text: str) -> go.Figure:
    """An empty figure with a message."""
    figure = blank(160)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    figure.add_annotation(
        text=text, x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False, font={"size": 15}
    )
    return figure


def note(text: str, number: str, font: Mapping[str, Any]) -> dict[str, Any]:
    """A text in or beside the panel whose axes have this number."""
    refs = {"xref": f"x{number} domain", "yref": f"y{number} domain"}
    return {"text": text, "showarrow": False, "font": font, **refs}


def evenly_drawn(n: int) -> BoolArray:
    """(n,): which of n frames or bars a figure draws: all, or `MOST_DRAWN` spread evenly."""
    drawn = np.zeros(n, dtype=np.bool_)
    drawn[evenly_spread(n, MOST_DRAWN)] = True
    return drawn


def thinned(n: int, most: int) -> slice:
    """Selects at most `most` of n points, evenly spread."""
    return slice(None, None, -(-n // most) or 1)


def n_drawn(n: int) -> str:
    """`n = 25`, for a legend; and how many are drawn, if fewer."""
    return f"n = {n:,}" + (f", {MOST_DRAWN:,} drawn" if n > MOST_DRAWN else "")


def in_order(methods: Container[Method]) -> list[Method]:
    """These methods, in the order of all."""
    return [method for method in ALL_METHODS if method in methods]


def marks_of(rows: Correspondences) -> list[tuple[str, BoolArray, str, str]]:
    """How targets are drawn: name, rows (n,), colour and symbol of A and of B, or of all those of
    an object."""
    if rows.rigid_object is not None:
        every = np.ones(len(rows), dtype=np.bool_)
        return [(OBJECT, every, TARGET_COLOURS["A"], TARGET_SYMBOLS["A"])]
    return [
        (name, rows.target == number, TARGET_COLOURS[name], TARGET_SYMBOLS[name])
        for number, name in enumerate(TARGETS)
    ]


def photograph_behind(
    image: Photograph, box: tuple[float, float, float, float], number: str = ""
) -> list[dict[str, Any]]:
    """The part of a photograph that is in a box behind a panel, for `layout.images`; none outside.

    Args:
        box: left, top, right, bottom in pixels, the centre of the first pixel at (0, 0).
        number: of the panel's axes.
    """
    height, width = image.shape
    left, top = (max(int(np.floor(end + 0.5)), 0) for end in box[:2])
    right, bottom = min(int(np.ceil(box[2] + 0.5)), width), min(int(np.ceil(box[3] + 0.5)), height)
    part = image[top:bottom, left:right]
    if not part.size:
        return []
    shrink = LONGEST_PHOTOGRAPH / max(part.shape)
    if shrink < 1:
        part = np.asarray(
            cv2.resize(part, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8
        )
    _, packed = cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    source = "data:image/jpeg;base64," + base64.b64encode(packed.tobytes()).decode()
    place = {"x": left - 0.5, "y": top - 0.5, "sizex": right - left, "sizey": bottom - top}
    axes = {"xref": f"x{number}", "yref": f"y{number}"}
    return [{"source": source, "sizing": "stretch", "layer": "below", **place, **axes}]
