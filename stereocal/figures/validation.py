"""The paper's Fig. 4 for the user's rig: PDFs of the errors of each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import Method
from stereocal.evaluation.summary import MethodSummary, Pdf
from stereocal.figures.style import (
    AXIS,
    CORRECT_COLOUR,
    FILLS,
    LAYOUT,
    METHOD_COLOURS,
    METHOD_NAMES,
    NEUTRAL,
    WRONG_COLOUR,
    note,
)
from stereocal.figures.validation_panels import COLUMNS, HEADINGS, UNITS, Panel, panels_of
from stereocal.verdict.in_words import digits

PANEL_HEIGHT, SPACING = 190, 0.065
AXIS_TITLES = {
    "residual": "|Residual| (no unit)",
    "reprojection": "Reprojection error (px)",
    "reconstruction": "3D error |D − D<sup>R</sup>| / D (%)",
}
SHOWN = (0.01, 0.999)
"""Quantiles of every PDF of a column that its axis must include."""
MOST_LABELS = 7
"""Decades of an axis that are all labelled; of more, every second one."""
LEGEND_LINE, LINE_HEIGHT, FOOT_HEIGHT = 24, 17, 80
HATCH = {"shape": "/", "fillmode": "replace", "size": 6, "solidity": 0.3, "fgcolor": WRONG_COLOUR}


def plot_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = COLUMNS
) -> go.Figure:
    """PDFs of residual, reprojection error and 3D error; one row per method.

    In each column the best panel is framed if it is apart from the others beyond the 95 %
    intervals; otherwise those whose intervals overlap its own are marked as level.

    Args:
        columns: the quantities to draw, of `COLUMNS`; on a narrow screen one at a time.
    """
    panels = panels_of(summaries, columns)
    rows = 1 + max(panel.row for panel in panels)
    above = LINE_HEIGHT * max(len(panel.title) for panel in panels) + 20
    # On a narrow screen, each entry of the legend is on a separate line.
    top = LEGEND_LINE * (4 if len(columns) == 1 else 2) + LINE_HEIGHT + above
    inside = rows * PANEL_HEIGHT + (rows - 1) * above
    layout: dict[str, Any] = {
        **LAYOUT,
        "height": top + inside + FOOT_HEIGHT,
        "hovermode": "x",
        "dragmode": False,
        "margin": {**LAYOUT["margin"], "t": top, "b": FOOT_HEIGHT},
        "legend": {
            **LAYOUT["legend"],
            "xref": "container",
            "yref": "container",
            "y": 1.0,
            "yanchor": "top",
        },
        "annotations": [_title(panel) for panel in panels],
        "shapes": [_frame(panel) for panel in panels if panel.standing == "best"],
    }
    traces: list[dict[str, Any]] = _key(columns)
    for column in range(len(columns)):
        own = [panel for panel in panels if panel.column == column]
        span = span_of(own)
        most = max((float(pdf.density.max(initial=0)) for p in own for pdf in p.pdfs), default=0.0)
        for panel in own:
            traces += _traces(panel, span, most or 1.0)
            layout |= _axes(panel, len(columns), (PANEL_HEIGHT, above, inside))
            layout[f"xaxis{panel.axis}"] |= _decades(panel, span, panel.row == rows - 1)
            layout[f"yaxis{panel.axis}"]["range"] = [0, 1.22 * (most or 1.0)]
        layout[f"xaxis{own[-1].axis}"]["title"] = {
            **AXIS["title"],
            "text": "<br>".join(foot_of(own, span)),
        }
    # In one step: axis by axis, and trace by trace, Plotly takes 0.2 s.
    return go.Figure(data=traces, layout=layout)


def _axes(panel: Panel, columns: int, heights: tuple[int, int, int]) -> dict[str, dict[str, Any]]:
    """Both axes of a panel and their part of the figure.

    Args:
        columns: number of columns of the figure.
        heights: of a panel, of the titles above one, and of everything, in px.
    """
    height, above, inside = heights
    spacing = SPACING if columns > 1 else 0.0
    width = (1 - spacing * (columns - 1)) / columns
    left = panel.column * (width + spacing)
    top = 1 - panel.row * (height + above) / inside
    title = f"<b>{METHOD_NAMES[panel.method]}</b><br>Density per decade"
    return {
        f"xaxis{panel.axis}": {**AXIS, "domain": [left, left + width], "anchor": f"y{panel.axis}"},
        f"yaxis{panel.axis}": {
            **AXIS,
            "domain": [max(top - height / inside, 0.0), top],
            "anchor": f"x{panel.axis}",
            "nticks": 5,
            "title": {**AXIS["title"], "text": title if panel.column == 0 else None},
        },
    }


def _decades(panel: Panel, span: tuple[float, float], labelled: bool) -> dict[str, Any]:
    """A logarithmic axis: 0.01, 0.1, 1, 10; of the residual 10^-6, 10^-5."""
    return {
        "type": "log",
        "range": list(span),
        "showticklabels": labelled,
        "tickangle": 0,
        "dtick": 1 if span[1] - span[0] <= MOST_LABELS else 2,
        "exponentformat": "power" if panel.quantity == "residual" else "none",
        "minor": {"ticks": "outside", "ticklen": 2, "dtick": "D1"},
    }


def span_of(panels: Sequence[Panel]) -> tuple[float, float]:
    """log10 of the ends of a column's axis: the quantiles `SHOWN` of all PDFs, and all lines."""
    ends = [float(np.log10(panel.line)) for panel in panels]
    for panel in panels:
        for pdf in panel.pdfs:
            running = np.cumsum(pdf.density)
            if running[-1] > 0:
                first, last = np.searchsorted(running / running[-1], SHOWN)
                shift = np.log10(panel.scale)
                ends += [float(pdf.edges[first] + shift), float(pdf.edges[last + 1] + shift)]
    margin = 0.03 * max(max(ends) - min(ends), 1.0)
    return min(ends) - margin, max(ends) + margin


def foot_of(panels: Sequence[Panel], span: tuple[float, float]) -> list[str]:
    """The lines below a column: its quantity, and the numbers of values in bins out of view."""
    below = above = 0.0
    for panel in panels:
        for pdf in panel.pdfs:
            edges = pdf.edges + np.log10(panel.scale)
            counts = pdf.density * np.diff(pdf.edges) * pdf.n
            below += float(counts[edges[1:] <= span[0]].sum())
            above += float(counts[edges[:-1] >= span[1]].sum())
    sides = [(round(below), "smaller"), (round(above), "larger")]
    beyond = " and ".join(f"{n} {side}" for n, side in sides if n)
    title = [AXIS_TITLES[panels[0].quantity]]
    return [*title, f"Not in view: {beyond} values"] if beyond else title


def _title(panel: Panel) -> dict[str, Any]:
    heading = [f"<b>{HEADINGS[panel.quantity]}</b>"] if panel.row == 0 else []
    above = {"x": 0, "xanchor": "left", "y": 1, "yanchor": "bottom", "yshift": 3, "align": "left"}
    return note("<br>".join([*heading, *panel.title]), panel.axis, {"size": 12}) | above


def _frame(panel: Panel) -> dict[str, Any]:
    return {
        "type": "rect",
        "xref": f"x{panel.axis} domain",
        "yref": f"y{panel.axis} domain",
        "x0": 0,
        "x1": 1,
        "y0": 0,
        "y1": 1,
        "name": f"best {panel.quantity}",
        "line": {"color": METHOD_COLOURS[panel.method], "width": 4},
    }


def _traces(panel: Panel, span: tuple[float, float], highest: float) -> list[dict[str, Any]]:
    """The PDFs of a panel and its line."""
    if panel.matching:
        pdfs = [
            _pdf(panel, panel.matching.correct, "correct"),
            _pdf(panel, panel.matching.wrong, "wrong"),
        ]
    else:
        pdfs = [_pdf(panel, panel.summary.reconstruction.pdf, panel.method)]
    axes = {"xaxis": f"x{panel.axis}", "yaxis": f"y{panel.axis}", "showlegend": False}
    return [{**trace, **axes} for trace in (*pdfs, _line(panel, span, highest))]


def _pdf(panel: Panel, pdf: Pdf, kind: str) -> dict[str, Any]:
    """A PDF as a filled step line; wrong pairs are hatched and dotted."""
    drawn = drawn_bins(pdf)
    ends = panel.scale * 10 ** np.column_stack([pdf.edges[:-1], pdf.edges[1:]])[drawn]
    pairs = {"correct": CORRECT_COLOUR, "wrong": WRONG_COLOUR}
    unit, what = UNITS[panel.quantity], f"{kind} pairs" if panel.matching else "3D error"
    wrong = kind == "wrong"
    return {
        "type": "scatter",
        "mode": "lines",
        "fill": "tozeroy",
        "hoveron": "points",
        "x": np.sqrt(ends.prod(axis=1)),
        "y": pdf.density[drawn],
        "customdata": ends,
        "line": {
            "color": pairs.get(kind, METHOD_COLOURS[panel.method]),
            "shape": "hvh",
            "width": 2,
            "dash": "dot" if wrong else "solid",
        },
        "fillcolor": WRONG_COLOUR if wrong else FILLS[kind],
        **({"fillpattern": HATCH} if wrong else {}),
        "name": f"{METHOD_NAMES[panel.method]}, {what}",
        "hovertemplate": f"{what}: %{{customdata[0]:.3~r}} to %{{customdata[1]:.3~r}}{unit}<br>"
        "%{y:.3~r} per decade<extra></extra>",
    }


def drawn_bins(pdf: Pdf) -> slice:
    """The bins to draw, from one before the first value to one after the last."""
    filled = np.flatnonzero(pdf.density)
    if not len(filled):
        return slice(0, 0)
    return slice(max(0, int(filled[0]) - 1), min(len(pdf.density), int(filled[-1]) + 2))


def _line(panel: Panel, span: tuple[float, float], highest: float) -> dict[str, Any]:
    """The threshold, or the line at 1 %, with its value above the PDFs."""
    relative = (np.log10(panel.line) - span[0]) / (span[1] - span[0])
    side = "center" if 0.15 < relative < 0.85 else "right" if relative < 0.5 else "left"
    value = f"{digits(panel.line, 2)}{UNITS[panel.quantity]}" if panel.matching else "1 %"
    name = "Recommended threshold" if panel.matching else "3D error of 1 %"
    return {
        "type": "scatter",
        "x": [panel.line] * 2,
        "y": [0, 1.06 * highest],
        "mode": "lines+text",
        "text": ["", value],
        "textposition": f"top {side}",
        "textfont": {"size": 12},
        "cliponaxis": False,
        "line": {"color": NEUTRAL, "dash": "dash", "width": 2},
        "name": name,
        "hovertemplate": f"{name.lower()}: {value}<extra></extra>",
    }


def _key(columns: Sequence[str]) -> list[dict[str, Any]]:
    """The legend, made of traces without points, so that clicks do not hide single panels."""
    filled = {"mode": "lines", "fill": "tozeroy"}
    keys: list[dict[str, Any]] = []
    if set(columns) - {"reconstruction"}:
        correct = {"fillcolor": FILLS["correct"], "line": {"color": CORRECT_COLOUR}}
        hatched = {"fillpattern": HATCH, "fillcolor": WRONG_COLOUR}
        wrong = {**hatched, "line": {"color": WRONG_COLOUR, "dash": "dot"}}
        keys += [
            {**filled, "name": "Correct pairs", **correct},
            {**filled, "name": "Wrong pairs", **wrong},
        ]
    lines = "Dashed: threshold"
    if "reconstruction" in columns:
        lines = "Dashed: 1 %" if len(columns) == 1 else "Dashed: threshold, or 1 %"
    keys += [
        {"mode": "lines", "name": lines, "line": {"color": NEUTRAL, "dash": "dash", "width": 2}},
        {
            "mode": "markers",
            "name": "Framed: best; level: not apart",
            "marker": {"symbol": "square-open", "size": 12, "color": NEUTRAL, "line": {"width": 3}},
        },
    ]
    return [
        {"type": "scatter", "x": [None], "y": [None], "hoverinfo": "skip", **key} for key in keys
    ]
