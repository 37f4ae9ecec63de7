"""Why two sets: one frame seen with each set, in both images and in space.

A set that matches well has epipolar lines that pass through the points, and rays that nearly meet.
A set that measures well gives the bar its length. No set of the paper does both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.figures.frame_view import FrameView
from stereocal.figures.photograph import Photograph, photograph_behind
from stereocal.figures.space import SCENE_AXIS
from stereocal.figures.style import (
    LAYOUT,
    METHOD_COLOURS,
    TARGET_COLOURS,
    TARGET_SYMBOLS,
    TRANSPARENT,
    add,
    axis_of,
    blank,
    line_of,
)
from stereocal.rig.camera import CAMERAS
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent

HEIGHT = 480
DOMAINS = (((0.0, 1.0), (0.478, 1.0)), ((0.0, 0.47), (0.0, 0.378)), ((0.53, 1.0), (0.0, 0.378)))
"""Of the panels, in x and y: the image, and a close-up of each target."""
SMALLEST_WINDOW_PX, SMALLEST_WINDOW_M = 3.0, 1e-4


def plot_image(
    views: Mapping[Method, FrameView],
    method: Method,
    camera: int,
    photograph: Photograph | None = None,
) -> go.Figure:
    """One image with the targets and their epipolar lines; below, close-ups of the targets.

    The close-ups have the same size with every set.
    """
    view = views[method]
    half = 1.4 * max(
        SMALLEST_WINDOW_PX, *(float(each.distances_px.max()) for each in views.values())
    )
    width, height = view.cameras[camera].image_size
    boxes = [(-0.5, -0.5, width - 0.5, height - 0.5)]
    boxes += [(u - half, v - half, u + half, v + half) for u, v in view.pixels[camera]]
    # As plain dictionaries: subplots and updates of Plotly take four times as long.
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {**LAYOUT, "height": HEIGHT, "showlegend": False, "images": []}
    layout["margin"] = {**LAYOUT["margin"], "r": 16}
    for at, (box, (across, down)) in enumerate(zip(boxes, DOMAINS, strict=False)):
        number, ticks = "" if at == 0 else f"{at + 1}", "outside" if at == 0 else ""
        if photograph is not None:
            layout["images"] += photograph_behind(photograph, box, number)
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}"}
        traces += [{**axes, **trace} for trace in _lines(view, camera, 2 if at == 0 else 3)]
        title = "" if at == 0 else f"{view.letters[at - 1]} ± {rounded(half)} px"
        left, top, right, bottom = box
        common = {"showgrid": False, "nticks": 4, "constrain": "domain", "mirror": True}
        common |= {"showticklabels": at == 0, "ticks": ticks}
        x = {"domain": across, "anchor": f"y{number}", "range": [left, right]}
        y = {"domain": down, "anchor": f"x{number}", "range": [bottom, top]}
        layout[f"xaxis{number}"] = axis_of(title, **common, **x)
        layout[f"yaxis{number}"] = axis_of(**common, **y, scaleanchor=f"x{number}")
    return go.Figure(traces, layout)


def _lines(view: FrameView, camera: int, width: int) -> list[dict[str, Any]]:
    """The targets of an image with their epipolar lines."""
    found: list[dict[str, Any]] = []
    for target, letter in enumerate(view.letters):
        u, v = view.line(camera, target).T
        line, name = line_of(METHOD_COLOURS[view.method], width), f"epipolar line of {letter}"
        own = {"line": line, "name": name, "hoverinfo": "name"}
        found.append({"type": "scatter", "x": u, "y": v, "mode": "lines", **own})
        marker = {
            "color": TARGET_COLOURS.get(letter, TARGET_COLOURS["AB"[target]]),
            "size": 9,
            "symbol": TARGET_SYMBOLS.get(letter, TARGET_SYMBOLS["AB"[target]]),
            "line": {"color": "white", "width": 1},
        }
        at, text = view.pixels[camera][target], {"text": [letter], "textposition": "top right"}
        found.append(
            {
                "type": "scatter",
                "x": at[:1],
                "y": at[1:],
                "mode": "markers+text",
                "textfont": {"size": 16},
                "marker": marker,
                "hovertemplate": f"{letter} (%{{x:.2f}}, %{{y:.2f}})<br>"
                f"{view.distances_px[target, camera]:.2f} px from its line<extra></extra>",
                **text,
            }
        )
    return found


def plot_gap(views: Mapping[Method, FrameView], method: Method) -> go.Figure:
    """The two rays of one target where they pass each other, in mm; equal axes.

    The target with the widest gap; the size of the view is the same with every set.
    """
    view, target = views[method], _widest(views)
    ends = view.nearest_m[target]
    middle = ends.mean(axis=0)
    reach = 1.5 * max(SMALLEST_WINDOW_M, *(float(each.gaps_m[target]) for each in views.values()))
    centres = np.zeros(3), view.rig.pose.inverse().T
    figure = blank(HEIGHT)
    for name, centre, end, dash in zip(CAMERAS, centres, ends, ("solid", "dash"), strict=True):
        along = (end - centre) / np.linalg.norm(end - centre)
        path = 1000 * (end + np.array([[-reach], [reach]]) * along - middle)
        line = line_of(width=5, dash=dash)
        add(figure, path, "name", line=line, name=f"ray of the {name}")
    colour, gap = METHOD_COLOURS[method], f"gap {rounded(1000 * view.gaps_m[target])} mm"
    style = {"line": line_of(colour, 9), "marker": {"color": colour, "size": 4}}
    add(figure, 1000 * (ends - middle), "name", name=gap, **style)
    axis = {**SCENE_AXIS, "range": [-1000 * reach, 1000 * reach], "nticks": 4}
    titles = {"xaxis": "x (mm)", "yaxis": "z (mm)", "zaxis": "−y (mm)"}
    figure.layout.scene = {
        "aspectmode": "cube",
        "bgcolor": TRANSPARENT,
        "camera": {"eye": {"x": 0.9, "y": -1.5, "z": 0.9}},
        **{name: {**axis, "title": {"text": title}} for name, title in titles.items()},
    }
    return figure


def _widest(views: Mapping[Method, FrameView]) -> int:
    return int(np.argmax(np.max([view.gaps_m for view in views.values()], axis=0)))


def describe_gap(views: Mapping[Method, FrameView], method: Method) -> str:
    """The bar and the gap of one set."""
    view, target = views[method], _widest(views)
    gap = f"The rays of {view.letters[target]} pass {rounded(1000 * view.gaps_m[target])} mm apart"
    if view.length_m is None or view.stated_m is None:
        return f"{gap}."
    return f"{gap}; the bar is {view.length_m:.4f} m long (measured: {view.stated_m:.4f} m)."


def describe_image(views: Mapping[Method, FrameView], method: Method, camera: int) -> str:
    """How far the points of an image are from their lines."""
    view = views[method]
    found = " and ".join(
        f"{letter} {rounded(px)} px"
        for letter, px in zip(view.letters, view.distances_px[:, camera], strict=True)
    )
    return f"Distance from the epipolar line: {found}."


def describe_two_sets(views: Mapping[Method, FrameView]) -> str:
    """All sets in one sentence with numbers."""
    parts: list[str] = []
    for method, view in views.items():
        name = "the refined set" if method == "refined" else f"the {METHOD_NAMES[method]}"
        px, error = rounded(float(view.distances_px.mean())), view.length_error
        bar = "" if error is None else _too_long(error)
        if not parts:
            parts.append(f"With {name} the epipolar lines pass {px} px from the points")
            parts[0] += f" and the bar is {bar}" if bar else ""
        else:
            parts.append(f"with {name} {px} px" + (f" and {bar}" if bar else ""))
    return f"{'; '.join(parts)}."


def _too_long(error: float) -> str:
    if abs(error) < 5e-6:
        return "as long as measured"
    return f"{percent(abs(error))} % too {'long' if error > 0 else 'short'}"
