"""Reprojection and length error of every frame, for print."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from stereocal.calibration.methods import Method
from stereocal.figures.frame_errors import FramePanel, frame_panels, lowest_drawn
from stereocal.figures.journal.page import PAGE_MM, sheet
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES, NEUTRAL
from stereocal.refined.outliers import held_out, left_out
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import BoolArray

HEIGHT_MM = 90.0
MARKERS: dict[Method, str] = {"essential": "s", "2d": "o", "3d": "^", "refined": "D"}
LARGER: dict[Method, float] = {"essential": 1.4, "2d": 1.0, "3d": 1.1, "refined": 0.9}
"""Sizes of the symbols: the essential matrix and the 2D set often have the same errors."""
MANY = 100
"""Frames above which symbols are smaller."""


def draw_frame_errors(calibration: Calibration, width_mm: float) -> Figure:
    """Filled: calibrated with; open: held out; crosses: left out."""
    figure = sheet(width_mm, HEIGHT_MM)
    grid = figure.subplots(2, 1, sharex=True)
    kinds: set[str] = set()
    for axes, panel in zip(grid, frame_panels(calibration), strict=True):
        kinds |= _draw_panel(axes, calibration, panel)
    grid[1].set_xlabel(f"Frame (n = {len(calibration.dataset.correspondences.frames)})")
    figure.legend(
        handles=_key(kinds, calibration.errors),
        loc="outside upper left",
        ncols=6 if width_mm >= PAGE_MM else 3,
    )
    return figure


def _draw_panel(axes: Axes, calibration: Calibration, panel: FramePanel) -> set[str]:
    """Draw the values; returns which kinds of frames there are."""
    held, out = held_out(calibration, panel.frames), left_out(calibration, panel.frames)
    kinds: list[tuple[str, BoolArray]] = [
        ("used", ~(held | out)),
        ("held out", held),
        ("left out", out),
    ]
    size = 1.6 if len(panel.frames) > MANY else 3.0
    for method in panel.values:
        for kind, chosen in kinds:
            crossed = kind == "left out"
            axes.plot(
                panel.frames[chosen],
                panel.values[method][chosen],
                linestyle="none",
                marker="x" if crossed else MARKERS[method],
                color=METHOD_COLOURS[method],
                markersize=size * LARGER[method] + crossed,
                markeredgewidth=0.4,
                markerfacecolor="none" if kind == "held out" else None,
            )
    axes.set_ylabel(f"{panel.title} ({panel.unit})")
    if panel.is_log:
        axes.set_yscale("log")
        axes.set_ylim(lowest_drawn(panel) / 1.3, 1.5 * panel.known.max())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    else:
        axes.set_ylim(0, 1.1 * float(np.max(panel.known, initial=0.0)) or 1.0)
    return {kind for kind, chosen in kinds if chosen.any()}


def _key(kinds: set[str], methods: Iterable[Method]) -> list[Line2D]:
    shown = [
        Line2D(
            [],
            [],
            color=METHOD_COLOURS[method],
            marker=MARKERS[method],
            markersize=3,
            linestyle="none",
            label=METHOD_NAMES[method],
        )
        for method in methods
    ]
    if "held out" in kinds:
        shown.append(
            Line2D(
                [],
                [],
                color=NEUTRAL,
                marker="o",
                markerfacecolor="none",
                markersize=3,
                linestyle="none",
                label="Open: held out",
            )
        )
    if "left out" in kinds:
        shown.append(
            Line2D(
                [],
                [],
                color=NEUTRAL,
                marker="x",
                markersize=3,
                linestyle="none",
                label="Cross: left out",
            )
        )
    return shown
