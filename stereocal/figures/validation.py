"""The paper's Fig. 4 for the user's rig: PDFs of the errors of each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import (
    ACCEPTABLE,
    Discrimination,
    MethodSummary,
    Pdf,
    best_methods,
)
from stereocal.figures.style import (
    CORRECT_COLOUR,
    FILLS,
    METHOD_COLOURS,
    METHOD_NAMES,
    NEUTRAL,
    WRONG_COLOUR,
    count,
    finish,
)
from stereocal.verdict.in_words import digits, interval, percent

ROW_HEIGHT = 300
COLUMNS = ("residual", "reprojection", "reconstruction")
HEADINGS = {
    "residual": "|Residual|",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}
AXIS_TITLES = {
    "residual": "log<sub>10</sub> of |residual|<br>(no unit)",
    "reprojection": "log<sub>10</sub> of<br>reprojection error (px)",
    "reconstruction": "log<sub>10</sub> of 3D error<br>|D − D<sup>R</sup>| / D (fraction)",
}
UNITS = {"residual": "", "reprojection": " px", "reconstruction": ""}
SHOWN = (0.01, 0.999)
"""Quantiles of every PDF of a column that its axis must include."""
LEGEND_LINE, LINE_HEIGHT, FOOT_HEIGHT = 24, 17, 80


@dataclass(frozen=True, eq=False)
class _Panel:
    """One method and one quantity, and their position in the grid."""

    method: Method
    quantity: str
    summary: MethodSummary
    is_best: bool
    row: int
    column: int
    axis: str
    """Suffix of Plotly's axis names `x` and `y` for this panel."""

    @property
    def matching(self) -> Discrimination | None:
        """Figures of correct and wrong pairs; None in the column of the 3D error."""
        if self.quantity == "residual":
            return self.summary.residual
        return self.summary.reprojection if self.quantity == "reprojection" else None

    @property
    def pdfs(self) -> tuple[Pdf, ...]:
        found = self.matching
        return (found.correct, found.wrong) if found else (self.summary.reconstruction.pdf,)

    @property
    def line(self) -> float:
        """Position of the vertical line, in the unit of the quantity."""
        return self.matching.threshold if self.matching else ACCEPTABLE


def plot_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = COLUMNS
) -> go.Figure:
    """PDFs of residual, reprojection error and 3D error; one row per method, the best framed.

    Args:
        columns: the quantities to draw, of `COLUMNS`; on a narrow screen one at a time.

    Raises:
        StereocalError: an unknown column.
    """
    panels = _panels(summaries, columns)
    methods = [method for method in ALL_METHODS if method in summaries]
    titles = {(panel.row, panel.column): _title(panel) for panel in panels}
    height = ROW_HEIGHT * len(methods)
    lines = max(len(title) for title in titles.values())
    # On a narrow screen, each entry of the legend is on a separate line.
    top = LEGEND_LINE * (4 if len(columns) == 1 else 2) + LINE_HEIGHT * lines + 8
    figure = make_subplots(
        rows=len(methods), cols=len(columns), shared_xaxes="columns",
        horizontal_spacing=0.065 if len(columns) > 1 else 0.0,
        vertical_spacing=(LINE_HEIGHT * lines + 24) / (height - top - FOOT_HEIGHT),
    )  # fmt: skip
    finish(figure, height)
    for column, quantity in enumerate(columns, start=1):
        own = [panel for panel in panels if panel.column == column]
        _add_column(figure, quantity, own)
    _add_key(figure, columns)
    # All at once, because Plotly copies the earlier ones when one is added.
    figure.update_layout(
        hovermode="x", dragmode=False, margin_t=top,
        annotations=[_heading(panel, titles[panel.row, panel.column]) for panel in panels],
        shapes=[_frame(panel) for panel in panels if panel.is_best],
        legend={"xref": "container", "yref": "container", "y": 1.0, "yanchor": "top"},
    )  # fmt: skip
    return figure


def describe_validation(summaries: Mapping[Method, MethodSummary]) -> str:
    """The figure in words, one sentence per column."""
    best = best_methods(summaries)
    sentences = []
    for quantity in COLUMNS:
        parts = [
            f"{METHOD_NAMES[panel.method]} {_in_words(panel)}"
            + (" (best)" if best[quantity] == panel.method and panel.is_best else "")
            for panel in _panels(summaries, [quantity])
        ]
        what = (
            "3D error of bars, median and 95 %"
            if quantity == "reconstruction"
            else f"How often a wrong pair looks right (FCP), by {HEADINGS[quantity].lower()}"
        )
        sentences.append(f"{what}: {'; '.join(parts)}.")
    return f"{' '.join(sentences)} In brackets: 95 % intervals."


def _panels(summaries: Mapping[Method, MethodSummary], columns: Sequence[str]) -> list[_Panel]:
    for quantity in columns:
        if quantity not in COLUMNS:
            raise StereocalError(f'The column "{quantity}" is not known: {", ".join(COLUMNS)}.')
    best = best_methods(summaries)
    found = []
    for row, method in enumerate((m for m in ALL_METHODS if m in summaries), start=1):
        summary = summaries[method]
        for column, quantity in enumerate(columns, start=1):
            number = (row - 1) * len(columns) + column
            known = quantity != "reconstruction" or bool(
                np.isfinite(summary.reconstruction.median.value)
            )
            found.append(
                _Panel(
                    method, quantity, summary, known and best[quantity] == method, row, column,
                    "" if number == 1 else str(number),
                )
            )  # fmt: skip
    return found


def _title(panel: _Panel) -> list[str]:
    """The lines above a panel: the main figure, the number of values, and values not in the PDF."""
    found, lengths = panel.matching, panel.summary.reconstruction
    heading = f"<b>{HEADINGS[panel.quantity]}{': best' if panel.is_best else ''}</b>"
    if found:
        lines = [
            f"FCP <b>{percent(found.fcp.value)} %</b> ({interval(found.fcp)})",
            f"n = {found.correct.n} correct, {found.wrong.n} wrong",
        ]
    elif np.isfinite(lengths.median.value):
        lines = [
            f"median <b>{percent(lengths.median.value)} %</b> ({interval(lengths.median)})",
            f"95 % within {percent(lengths.p95)} %, n = {lengths.pdf.n}",
        ]
    else:
        lines = ["no bar could be measured", f"n = {lengths.pdf.n}"]
    missing = sum(pdf.nans for pdf in panel.pdfs)
    zeros = sum(pdf.zeros for pdf in panel.pdfs)
    notes = [f"{missing} without value"] * bool(missing) + [f"{zeros} of zero"] * bool(zeros)
    return [heading, *lines, *([", ".join(notes)] if notes else [])]


def _in_words(panel: _Panel) -> str:
    found, lengths = panel.matching, panel.summary.reconstruction
    missing = sum(pdf.nans for pdf in panel.pdfs)
    zeros = sum(pdf.zeros for pdf in panel.pdfs)
    notes = (f", {missing} without value" if missing else "") + (
        f", {zeros} of zero" if zeros else ""
    )
    if found:
        return (
            f"{percent(found.fcp.value)} % ({interval(found.fcp)}) with the threshold at "
            f"{digits(found.threshold, 2)}{UNITS[panel.quantity]}, n = {found.correct.n} correct "
            f"and {found.wrong.n} wrong pairs{notes}"
        )
    if not np.isfinite(lengths.median.value):
        return f"none{notes}"
    return (
        f"{percent(lengths.median.value)} % ({interval(lengths.median)}) and "
        f"{percent(lengths.p95)} %, n = {lengths.pdf.n}{notes}"
    )


def _span(panels: Sequence[_Panel]) -> tuple[float, float]:
    """The range of a column's axis: the quantiles `SHOWN` of all PDFs, and all lines."""
    ends = [float(np.log10(panel.line)) for panel in panels]
    for pdf in (pdf for panel in panels for pdf in panel.pdfs):
        running = np.cumsum(pdf.density)
        if running[-1] > 0:
            first, last = np.searchsorted(running / running[-1], SHOWN)
            ends += [float(pdf.edges[first]), float(pdf.edges[last + 1])]
    margin = 0.03 * max(max(ends) - min(ends), 1.0)
    return min(ends) - margin, max(ends) + margin


def _outside(panels: Sequence[_Panel], span: tuple[float, float]) -> int:
    """Number of values in bins that are completely outside the axis."""
    total = 0.0
    for pdf in (pdf for panel in panels for pdf in panel.pdfs):
        beside = (pdf.edges[1:] <= span[0]) | (pdf.edges[:-1] >= span[1])
        total += float((pdf.density * np.diff(pdf.edges))[beside].sum() * pdf.n)
    return round(total)


def _add_column(figure: go.Figure, quantity: str, own: Sequence[_Panel]) -> None:
    """Draw the panels of one quantity, with equal axes."""
    span = _span(own)
    highest = max((float(pdf.density.max(initial=0)) for p in own for pdf in p.pdfs), default=0.0)
    for panel in own:
        _add_panel(figure, panel, span, highest or 1.0)
    outside = _outside(own, span)
    figure.update_xaxes(
        row=own[-1].row, col=own[-1].column,
        title_text=AXIS_TITLES[quantity]
        + (f"<br>{count(outside, 'value')} out of view" if outside else ""),
    )  # fmt: skip


def _add_panel(figure: go.Figure, panel: _Panel, span: tuple[float, float], highest: float) -> None:
    if panel.matching:
        _add_pdf(figure, panel, panel.matching.correct, "correct")
        _add_pdf(figure, panel, panel.matching.wrong, "wrong")
    else:
        _add_pdf(figure, panel, panel.summary.reconstruction.pdf, panel.method)
    _add_line(figure, panel, span, highest)
    figure.update_xaxes(row=panel.row, col=panel.column, range=span, tickangle=0, nticks=8)
    figure.update_yaxes(
        row=panel.row, col=panel.column, range=[0, 1.22 * highest], nticks=5,
        title_text=f"<b>{METHOD_NAMES[panel.method]}</b><br>Density per decade"
        if panel.column == 1 else None,
    )  # fmt: skip


def _heading(panel: _Panel, title: list[str]) -> dict[str, object]:
    return {
        "text": "<br>".join(title), "xref": f"x{panel.axis} domain", "x": 0, "xanchor": "left",
        "yref": f"y{panel.axis} domain", "y": 1, "yanchor": "bottom", "yshift": 3,
        "align": "left", "showarrow": False, "font": {"size": 12},
    }  # fmt: skip


def _frame(panel: _Panel) -> dict[str, object]:
    return {
        "type": "rect", "xref": f"x{panel.axis} domain", "yref": f"y{panel.axis} domain",
        "x0": 0, "x1": 1, "y0": 0, "y1": 1, "name": f"best {panel.quantity}",
        "line": {"color": METHOD_COLOURS[panel.method], "width": 4},
    }  # fmt: skip


def _add_pdf(figure: go.Figure, panel: _Panel, pdf: Pdf, kind: str) -> None:
    """Draw a PDF as a filled step line; wrong pairs are hatched and dotted."""
    drawn = _drawn(pdf)
    ends = 10 ** np.column_stack([pdf.edges[:-1], pdf.edges[1:]])[drawn]
    pairs = {"correct": CORRECT_COLOUR, "wrong": WRONG_COLOUR}
    colour = pairs.get(kind, METHOD_COLOURS[panel.method])
    unit = UNITS[panel.quantity]
    fill: dict[str, object] = {"fillcolor": FILLS.get(kind)}
    if kind == "wrong":
        fill = {
            "fillcolor": WRONG_COLOUR,
            "fillpattern": {"shape": "/", "fillmode": "replace", "size": 6, "solidity": 0.3,
                            "fgcolor": WRONG_COLOUR},
        }  # fmt: skip
    what = f"{kind} pairs" if panel.matching else "3D error"
    figure.add_trace(
        go.Scatter(
            x=((pdf.edges[:-1] + pdf.edges[1:]) / 2)[drawn], y=pdf.density[drawn], mode="lines",
            line={"color": colour, "shape": "hvh", "width": 2,
                  "dash": "dot" if kind == "wrong" else "solid"},
            fill="tozeroy", hoveron="points", customdata=ends, showlegend=False,
            name=f"{METHOD_NAMES[panel.method]}, {what}",
            hovertemplate=(
                f"{what}: %{{customdata[0]:.3g}} to %{{customdata[1]:.3g}}{unit}<br>"
                "%{y:.3g} per decade<extra></extra>"
            ),
            **fill,
        ),
        row=panel.row, col=panel.column,
    )  # fmt: skip


def _drawn(pdf: Pdf) -> slice:
    """The bins to draw, from one before the first value to one after the last."""
    filled = np.flatnonzero(pdf.density)
    if not len(filled):
        return slice(0, 0)
    return slice(max(0, int(filled[0]) - 1), min(len(pdf.density), int(filled[-1]) + 2))


def _add_line(figure: go.Figure, panel: _Panel, span: tuple[float, float], highest: float) -> None:
    """Draw the threshold, or the line at 1 %, with its value above the PDFs."""
    at = float(np.log10(panel.line))
    relative = (at - span[0]) / (span[1] - span[0])
    side = "center" if 0.15 < relative < 0.85 else "right" if relative < 0.5 else "left"
    value = f"{digits(panel.line, 2)}{UNITS[panel.quantity]}" if panel.matching else "1 %"
    name = "Recommended threshold" if panel.matching else "3D error of 1 %"
    figure.add_trace(
        go.Scatter(
            x=[at, at], y=[0, 1.06 * highest], mode="lines+text", text=["", value],
            textposition=f"top {side}", textfont={"size": 12}, cliponaxis=False,
            line={"color": NEUTRAL, "dash": "dash", "width": 2}, showlegend=False,
            name=name, hovertemplate=f"{name.lower()}: {value}<extra></extra>",
        ),
        row=panel.row, col=panel.column,
    )  # fmt: skip


def _add_key(figure: go.Figure, columns: Sequence[str]) -> None:
    """The legend, made of traces without points, so that clicks do not hide single panels."""
    filled = {"mode": "lines", "fill": "tozeroy"}
    keys: list[dict[str, object]] = []
    if set(columns) - {"reconstruction"}:
        hatch = {"shape": "/", "fillmode": "replace", "size": 6, "fgcolor": WRONG_COLOUR}
        keys += [
            {**filled, "name": "Correct pairs", "fillcolor": FILLS["correct"],
             "line": {"color": CORRECT_COLOUR}},
            {**filled, "name": "Wrong pairs", "fillpattern": hatch,
             "fillcolor": WRONG_COLOUR, "line": {"color": WRONG_COLOUR, "dash": "dot"}},
        ]  # fmt: skip
    lines = "Dashed: threshold"
    if "reconstruction" in columns:
        lines = "Dashed: 1 %" if len(columns) == 1 else "Dashed: threshold, or 1 %"
    keys += [
        {"mode": "lines", "name": lines, "line": {"color": NEUTRAL, "dash": "dash", "width": 2}},
        {"mode": "markers", "name": "Framed: best",
         "marker": {"symbol": "square-open", "size": 12, "color": NEUTRAL, "line": {"width": 3}}},
    ]  # fmt: skip
    for key in keys:
        figure.add_trace(go.Scatter(x=[None], y=[None], hoverinfo="skip", **key), row=1, col=1)
