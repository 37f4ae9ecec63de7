"""Reprojection and length error of every frame, for print."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from stereocal.calibration.methods import Method
from stereocal.figures.frame_panels import KINDS, FrameKind, FramePanel, frame_panels
from stereocal.figures.journal.page import PAGE_MM, sheet
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, NEUTRAL
from stereocal.refined.results import Calibration

HEIGHT_MM = 90.0
MARKERS: dict[Method, str] = {"essential": "s", "2d": "o", "3d": "^", "refined": "D"}
LARGER: dict[Method, float] = {"essential": 1.4, "2d": 1.0, "3d": 1.1, "refined": 0.9}
"""Sizes of the symbols: the essential matrix and the 2D set often have the same errors."""
MANY = 100
"""Frames above which symbols are smaller."""


def draw_frame_errors(calibration: Calibration, width_mm: float) -> Figure:
    """Filled: calibrated with; open: held out; dotted: left out."""
    figure = sheet(width_mm, HEIGHT_MM)
    grid, panels = figure.subplots(2, 1, sharex=True), frame_panels(calibration)
    for axes, panel in zip(grid, panels, strict=True):
        _draw_panel(axes, panel)
    grid[1].set_xlabel(f"Frame (n = {len(panels[0].frames)})")
    symbols, labels = _key(panels[0])
    figure.legend(
        symbols,
        labels,
        loc="outside upper left",
        ncols=6 if width_mm >= PAGE_MM else 3,
        handler_map={tuple: HandlerTuple(ndivide=1)},
    )
    return figure


def _draw_panel(axes: Axes, panel: FramePanel) -> None:
    size = 1.6 if len(panel.frames) > MANY else 3.0
    for method, values in panel.values.items():
        for kind, chosen in panel.kinds.items():
            for style in _symbols(kind, MARKERS[method], size * LARGER[method]):
                axes.plot(
                    panel.frames[chosen], values[chosen], color=METHOD_COLOURS[method], **style
                )
    axes.set_ylabel(f"{panel.title} ({panel.unit})")
    axes.set_yscale("log" if panel.is_log else "linear")
    axes.set_ylim(*panel.ends)
    if panel.is_log:
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _symbols(kind: FrameKind, marker: str, size: float) -> list[dict[str, Any]]:
    """The symbol of a kind of frames, and the dot in it."""
    outer = {
        "linestyle": "none",
        "marker": marker,
        "markersize": size,
        "markeredgewidth": 0.4,
        "markerfacecolor": "none" if kind.is_open else None,
    }
    dot = {"linestyle": "none", "marker": ".", "markersize": 0.4 * size}
    return [outer, *([dot] if kind.is_dotted else [])]


def _key(panel: FramePanel) -> tuple[list[Any], list[str]]:
    """The symbols, and their labels."""
    methods = [
        (METHOD_NAMES[method], METHOD_COLOURS[method], MARKERS[method], KINDS[0])
        for method in panel.values
    ]
    kinds = [
        (kind.key, NEUTRAL, "o", kind)
        for kind, n in zip(panel.kinds, panel.counts, strict=True)
        if kind.key and n
    ]
    every = (*methods, *kinds)
    symbols = [
        tuple(Line2D([], [], color=colour, **style) for style in _symbols(kind, marker, 3))
        for _, colour, marker, kind in every
    ]
    return symbols, [label for label, *_ in every]
