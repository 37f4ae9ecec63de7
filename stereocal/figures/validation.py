"""The paper's Fig. 4 for the user's rig: PDFs of the errors of each method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import (
    ACCEPTABLE,
    FEWEST_RUNS,
    QUANTITIES,
    Discrimination,
    MethodSummary,
    Pdf,
    best_methods,
)
from stereocal.figures import style
from stereocal.figures.style import CORRECT_COLOUR, METHOD_COLOURS, WRONG_COLOUR, in_order, scatter
from stereocal.verdict.in_words import digits, interval, percent

COLUMNS = QUANTITIES
HEADINGS = {
    "residual": "Residual",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}
AXIS_TITLES = {
    "residual": "Residual of the essential<br>matrix (no unit)",
    "reprojection": "Reprojection error (px)",
    "reconstruction": "3D error |D − D<sup>R</sup>| / D (%)",
}
SHOWN = (0.01, 0.999)
"""Quantiles of every PDF of a column that its axis must include."""
MOST_LABELS = 7
"""Decades of an axis that are all labelled; of more, every second one."""
UNITS = {"residual": "", "reprojection": " px", "reconstruction": " %"}
FCP = "false correspondence probability, FCP"
Standing = Literal["best", "no clear winner", ""]


@dataclass(frozen=True, eq=False)
class Panel:
    """One method and one quantity, and their position in the grid."""

    method: Method
    quantity: str
    summary: MethodSummary
    standing: Standing
    """`best` if apart from all others beyond the intervals; `no clear winner` if it is the lowest,
    or its interval overlaps that of the lowest; of too few runs for intervals none has one."""
    row: int
    column: int
    axis: str
    """Suffix of Plotly's axis names `x` and `y` for this panel."""

    @property
    def matching(self) -> Discrimination | None:
        """Figures of correct and wrong pairs; None in the column of the 3D error."""
        return None if self.quantity == "reconstruction" else getattr(self.summary, self.quantity)

    @property
    def curves(self) -> tuple[tuple[str, Pdf, str], ...]:
        """What each PDF is of, the PDF, and its colour."""
        if distributions := self.matching:
            correct = ("correct", distributions.correct, CORRECT_COLOUR)
            return correct, ("wrong", distributions.wrong, WRONG_COLOUR)
        return ((self.method, self.summary.reconstruction.pdf, METHOD_COLOURS[self.method]),)

    @property
    def pdfs(self) -> tuple[Pdf, ...]:
        """The PDFs that it shows."""
        return tuple(pdf for _, pdf, _ in self.curves)

    @property
    def scale(self) -> float:
        """Units of the axis per unit of the quantity: 3D errors are fractions, drawn in %."""
        return 1.0 if self.matching else 100.0

    @property
    def line(self) -> float:
        """Position of the vertical line, in the unit of the axis."""
        return self.matching.threshold if self.matching else self.scale * ACCEPTABLE

    @property
    def line_text(self) -> str:
        """The value of that line."""
        return f"{digits(self.line, 2)}{UNITS[self.quantity]}" if self.matching else "1 %"

    @property
    def figure(self) -> tuple[str, str] | None:
        """Its value, and the interval if there is one; None if no bar could be measured."""
        estimate = self.summary.main(self.quantity)
        if not np.isfinite(estimate.value):
            return None
        among = f" ({interval(estimate)})" * self.summary.has_intervals
        return f"{percent(estimate.value)} %", among

    @property
    def title(self) -> list[str]:
        """The lines above the panel: its figure, what was counted, and values not in the PDF."""
        distributions, lengths = self.matching, self.summary.reconstruction
        line, counted = "no bar could be measured", f"n = {lengths.pdf.n:,}"
        if self.figure:
            value, among = self.figure
            line = f"{'FCP' if distributions else 'median'} <b>{value}</b>{among}"
            counted = f"95 % within {percent(lengths.p95)} %, {counted}"
        if distributions:
            counted = f"n = {distributions.correct.n:,} correct, {distributions.wrong.n:,} wrong"
        mark = self.standing and f"<b>{self.standing}</b>"
        return [*filter(None, [line, mark, counted, ", ".join(self.notes)])]

    @property
    def notes(self) -> list[str]:
        """The numbers of values that cannot be in the PDF."""
        missing, zeros = (sum(getattr(p, name) for p in self.pdfs) for name in ("nans", "zeros"))
        return [f"{missing} without value"] * bool(missing) + [f"{zeros} of zero"] * bool(zeros)

    @property
    def words(self) -> str:
        """The panel in words."""
        distributions, lengths, text = self.matching, self.summary.reconstruction, "none"
        if self.figure:
            value = "".join(self.figure)
            text = f"{value} and {percent(lengths.p95)} %, n = {lengths.pdf.n:,}"
            if distributions:
                text = (
                    f"{value} with the threshold at {self.line_text}, n = "
                    f"{distributions.correct.n:,} correct and {distributions.wrong.n:,} wrong pairs"
                )
        return ", ".join([text, *self.notes])


@dataclass(frozen=True, eq=False)
class PanelColumn:
    """The panels of one quantity, and the axes that they share."""

    panels: list[Panel]

    @cached_property
    def most(self) -> float:
        """The largest share of a bin, in %."""
        shares = (pdf.shares.max(initial=0) for panel in self.panels for pdf in panel.pdfs)
        return 100 * float(max(shares)) or 1.0

    @cached_property
    def span(self) -> tuple[float, float]:
        """log10 of the ends of the axis: the quantiles `SHOWN` of all PDFs, and all lines."""
        ends = [float(np.log10(panel.line)) for panel in self.panels]
        for panel in self.panels:
            for pdf in panel.pdfs:
                running = np.cumsum(pdf.density)
                if running[-1] > 0:
                    first, last = np.searchsorted(running / running[-1], SHOWN)
                    edges = pdf.edges[[first, last + 1]] + np.log10(panel.scale)
                    ends += edges.tolist()
        margin = 0.03 * max(max(ends) - min(ends), 1.0)
        return min(ends) - margin, max(ends) + margin

    @property
    def labels_all(self) -> bool:
        """Whether every decade of the axis is labelled, else every second one."""
        return self.span[1] - self.span[0] <= MOST_LABELS

    @property
    def foot(self) -> list[str]:
        """The lines below: the quantity, and the numbers of values in bins out of view."""
        below = above = 0.0
        for panel in self.panels:
            for pdf in panel.pdfs:
                edges = pdf.edges + np.log10(panel.scale)
                counts = pdf.shares * pdf.n
                below += float(counts[edges[1:] <= self.span[0]].sum())
                above += float(counts[edges[:-1] >= self.span[1]].sum())
        sides = [(round(below), "smaller"), (round(above), "larger")]
        beyond = " and ".join(f"{n} {side}" for n, side in sides if n)
        title = [AXIS_TITLES[self.panels[0].quantity]]
        return [*title, f"Not in view: {beyond} values"] if beyond else title


def columns_of(
    summaries: Mapping[Method, MethodSummary], names: Sequence[str]
) -> list[PanelColumn]:
    """The panels of each quantity, a row for each method."""
    if unknown := [name for name in names if name not in COLUMNS]:
        raise StereocalError(f'The column "{unknown[0]}" is not known: {", ".join(COLUMNS)}.')
    columns = []
    for column, name in enumerate(names):
        marks, panels = standings(summaries, name), []
        for row, method in enumerate(in_order(summaries)):
            number = len(names) * row + column
            standing, axis = marks.get(method, ""), str(number + 1) if number else ""
            panels.append(Panel(method, name, summaries[method], standing, row, column, axis))
        columns.append(PanelColumn(panels))
    return columns


def drawn_bins(pdf: Pdf) -> slice:
    """The bins to draw, from one before the first value to one after the last."""
    filled = np.flatnonzero(pdf.density)
    if not len(filled):
        return slice(0, 0)
    return slice(max(0, int(filled[0]) - 1), min(len(pdf.density), int(filled[-1]) + 2))


def standings(summaries: Mapping[Method, MethodSummary], quantity: str) -> dict[Method, Standing]:
    """`best`, or `no clear winner` where 95 % intervals overlap that of the lowest; others are not
    in it, and none is where there are too few runs for intervals."""
    estimates = {method: summary.main(quantity) for method, summary in summaries.items()}
    lowest = estimates[best_methods(summaries)[quantity]]
    # NaN, where no bar could be measured, is not below anything.
    near = [method for method, estimate in estimates.items() if estimate.low <= lowest.high]
    return dict.fromkeys(near, "no clear winner" if len(near) > 1 else "best")


def note_on_intervals(summaries: Mapping[Method, MethodSummary]) -> str:
    """What stands in brackets, or why nothing does."""
    if all(summary.has_intervals for summary in summaries.values()):
        return "In brackets: 95 % intervals; no clear winner: they overlap."
    return f"Fewer than {FEWEST_RUNS} runs: no intervals yet, and no method is marked best."


def describe_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = COLUMNS
) -> str:
    """The figure in words, one sentence per column."""
    sentences = []
    for column in columns_of(summaries, columns):
        parts = [
            f"{METHOD_NAMES[panel.method]} {panel.words}"
            + (f" ({panel.standing})" if panel.standing else "")
            for panel in column.panels
        ]
        what, quantity = "3D error of bars, median and 95 %", column.panels[0].quantity
        if quantity != "reconstruction":
            what = f"Overlap of correct and wrong pairs ({FCP}), by {HEADINGS[quantity].lower()}"
        sentences.append(f"{what}: {'; '.join(parts)}.")
    return " ".join([*sentences, note_on_intervals(summaries)])


PANEL_HEIGHT, SPACING = 190, 0.065
LEFT_WIDTH = 75
LEGEND_LINE, LINE_HEIGHT, FOOT_HEIGHT = 24, 17, 98
QUICK = {"automargin": False, "ticklabeloverflow": "allow"}
HATCH = {"shape": "/", "fillmode": "replace", "size": 6, "solidity": 0.3, "fgcolor": WRONG_COLOUR}


def plot_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = COLUMNS
) -> go.Figure:
    """PDFs of residual, reprojection error and 3D error; one row per method.

    In each column the best panel is framed if it is apart from the others beyond the 95 %
    intervals; otherwise those whose intervals overlap its own are marked "no clear winner".

    Args:
        columns: the quantities to draw, of `COLUMNS`; on a narrow screen one at a time.
    """
    drawn = columns_of(summaries, columns)
    panels = [panel for column in drawn for panel in column.panels]
    rows = len(drawn[0].panels)
    above = LINE_HEIGHT * max(len(panel.title) for panel in panels) + 20
    # On a narrow screen, each entry of the legend is on a separate line.
    top = LEGEND_LINE * (4 if len(columns) == 1 else 2) + LINE_HEIGHT + above
    inside = rows * PANEL_HEIGHT + (rows - 1) * above
    of_container = {"xref": "container", "yref": "container", "y": 1.0, "yanchor": "top"}
    layout: dict[str, Any] = {
        **style.LAYOUT,
        "height": top + inside + FOOT_HEIGHT,
        "hovermode": "x",
        "dragmode": False,
        "margin": {**style.LAYOUT["margin"], "l": LEFT_WIDTH, "t": top, "b": FOOT_HEIGHT},
        "legend": {**style.LAYOUT["legend"], **of_container},
        "annotations": [_title(panel) for panel in panels],
        "shapes": [_frame(panel) for panel in panels if panel.standing == "best"],
    }
    traces = _key(columns, any(panel.standing == "best" for panel in panels))
    kinds = ["pairs"] * bool({*columns} - {"reconstruction"})
    kinds += ["bars"] * ("reconstruction" in columns)
    shares = f"Share of {' or '.join(kinds)} (%)"
    spacing = SPACING if len(columns) > 1 else 0.0
    width = (1 - spacing * (len(columns) - 1)) / len(columns)
    for column in drawn:
        for panel in column.panels:
            left, end = (
                panel.column * (width + spacing),
                1 - panel.row * (PANEL_HEIGHT + above) / inside,
            )
            across, up = [left, left + width], [max(end - PANEL_HEIGHT / inside, 0.0), end]
            layout |= _axes(column, panel, across, up, shares)
            traces += _traces(column, panel)
    # In one step: axis by axis, and trace by trace, Plotly takes 0.2 s.
    return go.Figure(data=traces, layout=layout)


def _axes(
    column: PanelColumn, panel: Panel, across: list[float], up: list[float], shares: str
) -> dict[str, dict[str, Any]]:
    """Both axes of a panel and their part of the figure; of the residual labelled as powers.

    Args:
        shares: title of the upright axis.
    """
    lowest, first = panel is column.panels[-1], panel.column == 0
    x = style.axis_of(
        "<br>".join(column.foot) if lowest else None,
        domain=across,
        anchor=f"y{panel.axis}",
        type="log",
        range=list(column.span),
        showticklabels=lowest,
        tickangle=0,
        **QUICK,
        dtick=1 if column.labels_all else 2,
        exponentformat="power" if panel.quantity == "residual" else "none",
        minor={"ticks": "outside", "ticklen": 2, "dtick": "D1"},
    )
    title = f"<b>{METHOD_NAMES[panel.method]}</b><br>{shares}" if first else None
    y_axis = {
        "domain": up,
        "anchor": f"x{panel.axis}",
        "range": [0, 1.22 * column.most],
        "nticks": 5,
        **QUICK,
    }
    return {f"xaxis{panel.axis}": x, f"yaxis{panel.axis}": style.axis_of(title, **y_axis)}


def _title(panel: Panel) -> dict[str, Any]:
    heading = [f"<b>{HEADINGS[panel.quantity]}</b>"] if panel.row == 0 else []
    above = {"x": 0, "xanchor": "left", "y": 1, "yanchor": "bottom", "yshift": 3, "align": "left"}
    return style.note("<br>".join([*heading, *panel.title]), panel.axis, {"size": 12}) | above


def _frame(panel: Panel) -> dict[str, Any]:
    refs = {"xref": f"x{panel.axis} domain", "yref": f"y{panel.axis} domain"}
    box = {"type": "rect", "x0": 0, "x1": 1, "y0": 0, "y1": 1, **refs}
    line = {"color": style.METHOD_COLOURS[panel.method], "width": 4}
    return {**box, "name": f"best {panel.quantity}", "line": line}


def _traces(column: PanelColumn, panel: Panel) -> list[dict[str, Any]]:
    """The PDFs of a panel; and the threshold, or the line at 1 %, with its value above them."""
    span = column.span
    relative = (np.log10(panel.line) - span[0]) / (span[1] - span[0])
    side = "center" if 0.15 < relative < 0.85 else "right" if relative < 0.5 else "left"
    name = "Recommended threshold" if panel.matching else "3D error of 1 %"
    line = scatter(
        np.array([[panel.line, 0], [panel.line, 1.06 * column.most]]),
        f"{name.lower()}: {panel.line_text}",
        text=["", panel.line_text],
        textposition=f"top {side}",
        textfont={"size": 12},
        cliponaxis=False,
        line=style.DASHED,
        name=name,
    )
    axes = {"xaxis": f"x{panel.axis}", "yaxis": f"y{panel.axis}", "showlegend": False}
    pdfs = [_pdf(panel, *curve) for curve in panel.curves]
    return [{**trace, **axes} for trace in (*pdfs, line)]


def _pdf(panel: Panel, kind: str, pdf: Pdf, colour: str) -> dict[str, Any]:
    """A PDF as a filled step line; wrong pairs are hatched and dotted."""
    drawn = drawn_bins(pdf)
    ends = panel.scale * 10 ** np.column_stack([pdf.edges[:-1], pdf.edges[1:]])[drawn]
    unit, what = UNITS[panel.quantity], f"{kind} pairs" if panel.matching else "3D error"
    return scatter(
        np.column_stack([np.sqrt(ends.prod(axis=1)), 100 * pdf.shares[drawn]]),
        f"{what}: %{{customdata[0]:.3~r}} to %{{customdata[1]:.3~r}}{unit}<br>%{{y:.2~r}} %",
        hoveron="points",
        customdata=ends,
        name=f"{METHOD_NAMES[panel.method]}, {what}",
        **_area(kind, colour, shape="hvh", width=2),
    )


def _area(kind: str, colour: str, **line: Any) -> dict[str, Any]:
    """How the area of a PDF is drawn."""
    if kind == "wrong":
        fill = {"fillcolor": WRONG_COLOUR, "fillpattern": HATCH}
        return {"fill": "tozeroy", "line": {"color": colour, "dash": "dot", **line}, **fill}
    outline = {"color": colour, "dash": "solid", **line}
    return {"fill": "tozeroy", "line": outline, "fillcolor": style.FILLS[kind]}


def _key(columns: Sequence[str], framed: bool) -> list[dict[str, Any]]:
    """The legend, made of traces without points, so that clicks do not hide single panels.

    Args:
        framed: whether a panel is.
    """
    keys: dict[str, dict[str, Any]] = {}
    if {*columns} - {"reconstruction"}:
        keys["Correct pairs"] = _area("correct", CORRECT_COLOUR)
        keys["Wrong pairs"] = _area("wrong", WRONG_COLOUR)
    lines = "Dashed: threshold"
    if "reconstruction" in columns:
        lines = "Dashed: 1 %" if len(columns) == 1 else "Dashed: threshold, or 1 %"
    keys[lines] = {"line": style.DASHED}
    frame = {"symbol": "square-open", "size": 12, "color": style.NEUTRAL, "line": {"width": 3}}
    if framed:
        keys["Framed: best (intervals apart)"] = {"marker": frame}
    return [scatter(style.NOWHERE, name=name, **key) for name, key in keys.items()]
