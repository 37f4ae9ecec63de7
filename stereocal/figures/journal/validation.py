"""The validation for print: PDFs of the errors, one row per method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullFormatter

from stereocal.calibration.methods import Method
from stereocal.evaluation.summary import MethodSummary
from stereocal.figures.journal.page import PAGE_MM, SMALL, TEXT, sheet, write_left
from stereocal.figures.style import (
    CORRECT_COLOUR,
    METHOD_COLOURS,
    METHOD_NAMES,
    NEUTRAL,
    WRONG_COLOUR,
)
from stereocal.figures.validation import MOST_LABELS, drawn_bins, foot_of, span_of
from stereocal.figures.validation_panels import COLUMNS, HEADINGS, UNITS, Panel, panels_of
from stereocal.verdict.in_words import digits, interval, percent

ROW_MM, REST_MM = 36.0, 18.0
FILL = 0.45
HATCH = "/////"
IN_A_COLUMN = COLUMNS[1:]
"""What one column of a journal has room for: the errors that choose the sets."""


def draw_validation(summaries: Mapping[Method, MethodSummary], width_mm: float) -> Figure:
    """All three quantities over the width of a page, or reprojection and 3D error in a column."""
    wide = width_mm >= PAGE_MM
    columns = COLUMNS if wide else IN_A_COLUMN
    panels = panels_of(summaries, columns)
    rows = 1 + max(panel.row for panel in panels)
    figure = sheet(width_mm, rows * ROW_MM + REST_MM)
    grid = figure.subplots(rows, len(columns), squeeze=False)
    for column in range(len(columns)):
        own = [panel for panel in panels if panel.column == column]
        span = span_of(own)
        most = max((float(pdf.density.max(initial=0)) for p in own for pdf in p.pdfs), default=0.0)
        for panel in own:
            axes = grid[panel.row][column]
            _draw_panel(axes, panel, most or 1.0)
            _set_axes(axes, panel, span, panel.row == rows - 1)
            write_left(axes, "\n".join(_title(panel, wide)), fontsize=SMALL)
        foot = "\n".join(foot_of(own, span)).replace("<sup>R</sup>", "ᴿ")
        grid[rows - 1][column].set_xlabel(foot, fontsize=TEXT if wide else SMALL)
    figure.legend(handles=_key(), loc="outside upper left", ncols=4 if wide else 2)
    return figure


def _draw_panel(axes: Axes, panel: Panel, most: float) -> None:
    if panel.matching:
        colours = (CORRECT_COLOUR, WRONG_COLOUR)
    else:
        colours = (METHOD_COLOURS[panel.method],) * 2
    for pdf, colour in zip(panel.pdfs, colours, strict=False):
        drawn = drawn_bins(pdf)
        edges = panel.scale * 10.0 ** pdf.edges[drawn.start : drawn.stop + 1]
        density, wrong = pdf.density[drawn], colour == WRONG_COLOUR
        if len(density):
            axes.stairs(
                density,
                edges,
                fill=True,
                facecolor="none" if wrong else colour,
                linewidth=0,
                edgecolor=colour,
                hatch=HATCH if wrong else None,
                alpha=None if wrong else FILL,
            )
            axes.stairs(density, edges, color=colour, linestyle=":" if wrong else "-")
    axes.plot([panel.line] * 2, [0, 1.04 * most], color="black", linestyle="--", linewidth=0.7)
    value = f"{digits(panel.line, 2)}{UNITS[panel.quantity]}" if panel.matching else "1 %"
    axes.annotate(
        value,
        (panel.line, 1.04 * most),
        (0, 1),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=SMALL,
    )
    axes.set_ylim(0, 1.25 * most)


def _set_axes(axes: Axes, panel: Panel, span: tuple[float, float], lowest: bool) -> None:
    axes.set_xscale("log")
    axes.set_xlim(10 ** span[0], 10 ** span[1])
    base = 10.0 if span[1] - span[0] <= MOST_LABELS else 100.0
    axes.xaxis.set_major_locator(LogLocator(base, numticks=20))
    axes.xaxis.set_minor_locator(LogLocator(10.0, subs=(2.0, 5.0), numticks=200))
    axes.xaxis.set_minor_formatter(NullFormatter())
    power = panel.quantity == "residual"
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_major_formatter(LogFormatterMathtext() if power else plain)
    axes.tick_params(labelbottom=lowest)
    if panel.standing == "best":
        for spine in axes.spines.values():
            spine.set(visible=True, linewidth=1.5, color=METHOD_COLOURS[panel.method])
    if panel.column == 0:
        axes.set_ylabel(f"{METHOD_NAMES[panel.method]}\nDensity per decade")


def _title(panel: Panel, wide: bool) -> list[str]:
    """The quantity above the first row, and the figure with its interval and standing."""
    found, lengths = panel.matching, panel.summary.reconstruction
    heading = [HEADINGS[panel.quantity]] if panel.row == 0 else []
    name, estimate = ("FCP", found.fcp) if found else ("median", lengths.median)
    if not np.isfinite(estimate.value):
        return [*heading, "no bar could be measured"]
    value, among = f"{name} {percent(estimate.value)} %", f"({interval(estimate)})"
    mark = f", {panel.standing}" if panel.standing else ""
    lines = [f"{value} {among}{mark}"] if wide else [f"{value}{mark}", among]
    return [*heading, *lines]


def _key() -> Sequence[Patch | Line2D]:
    return [
        Patch(facecolor=CORRECT_COLOUR, alpha=FILL, label="Correct pairs"),
        Patch(
            facecolor="none", edgecolor=WRONG_COLOUR, hatch=HATCH, linewidth=0, label="Wrong pairs"
        ),
        Line2D([], [], color="black", linestyle="--", linewidth=0.7, label="Threshold, or 1 %"),
        Line2D(
            [],
            [],
            color=NEUTRAL,
            marker="s",
            markerfacecolor="none",
            linestyle="none",
            markersize=5,
            markeredgewidth=1.5,
            label="Framed: best; level: not apart",
        ),
    ]
