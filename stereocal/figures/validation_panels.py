"""The panels of the validation figure: which method stands where, its title, and its words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import (
    ACCEPTABLE,
    Discrimination,
    Estimate,
    MethodSummary,
    Pdf,
    best_methods,
)
from stereocal.figures.style import CORRECT_COLOUR, METHOD_COLOURS, METHOD_NAMES, WRONG_COLOUR
from stereocal.verdict.in_words import digits, interval, percent

COLUMNS = ("residual", "reprojection", "reconstruction")
HEADINGS = {
    "residual": "|Residual|",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}
AXIS_TITLES = {
    "residual": "|Residual| (no unit)",
    "reprojection": "Reprojection error (px)",
    "reconstruction": "3D error |D − D<sup>R</sup>| / D (%)",
}
SHOWN = (0.01, 0.999)
"""Quantiles of every PDF of a column that its axis must include."""
MOST_LABELS = 7
"""Decades of an axis that are all labelled; of more, every second one."""
UNITS = {"residual": "", "reprojection": " px", "reconstruction": " %"}
Standing = Literal["best", "level", ""]


@dataclass(frozen=True, eq=False)
class Panel:
    """One method and one quantity, and their position in the grid."""

    method: Method
    quantity: str
    summary: MethodSummary
    standing: Standing
    """`best` if apart from all others beyond the intervals; `level` if it is the lowest, or its
    interval overlaps that of the lowest."""
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
    def curves(self) -> tuple[tuple[str, Pdf, str], ...]:
        """What each PDF is of, the PDF, and its colour."""
        if found := self.matching:
            correct = ("correct", found.correct, CORRECT_COLOUR)
            return correct, ("wrong", found.wrong, WRONG_COLOUR)
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
    def title(self) -> list[str]:
        """The lines above the panel: its figure, what was counted, and values not in the PDF."""
        found, lengths = self.matching, self.summary.reconstruction
        mark = f" · <b>{self.standing}</b>" if self.standing else ""
        if found:
            figure = f"FCP <b>{percent(found.fcp.value)} %</b> ({interval(found.fcp)}){mark}"
            counted = f"n = {found.correct.n} correct, {found.wrong.n} wrong"
        elif np.isfinite(lengths.median.value):
            median = f"median <b>{percent(lengths.median.value)} %</b> ({interval(lengths.median)})"
            figure = median + mark
            counted = f"95 % within {percent(lengths.p95)} %, n = {lengths.pdf.n}"
        else:
            figure, counted = "no bar could be measured", f"n = {lengths.pdf.n}"
        return [figure, counted, *([", ".join(self.notes)] if self.notes else [])]

    @property
    def notes(self) -> list[str]:
        """The numbers of values that cannot be in the PDF."""
        missing = sum(pdf.nans for pdf in self.pdfs)
        zeros = sum(pdf.zeros for pdf in self.pdfs)
        return [f"{missing} without value"] * bool(missing) + [f"{zeros} of zero"] * bool(zeros)

    @property
    def words(self) -> str:
        """The panel in words."""
        found, lengths = self.matching, self.summary.reconstruction
        notes = "".join(f", {note}" for note in self.notes)
        if found:
            return (
                f"{percent(found.fcp.value)} % ({interval(found.fcp)}) with the threshold at "
                f"{digits(found.threshold, 2)}{UNITS[self.quantity]}, n = {found.correct.n} "
                f"correct and {found.wrong.n} wrong pairs{notes}"
            )
        if not np.isfinite(lengths.median.value):
            return f"none{notes}"
        return (
            f"{percent(lengths.median.value)} % ({interval(lengths.median)}) and "
            f"{percent(lengths.p95)} %, n = {lengths.pdf.n}{notes}"
        )


@dataclass(frozen=True, eq=False)
class Column:
    """The panels of one quantity, and the axes that they share."""

    panels: list[Panel]

    @cached_property
    def most(self) -> float:
        """The largest density."""
        return max(float(pdf.density.max(initial=0)) for p in self.panels for pdf in p.pdfs) or 1.0

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
                counts = pdf.density * np.diff(pdf.edges) * pdf.n
                below += float(counts[edges[1:] <= self.span[0]].sum())
                above += float(counts[edges[:-1] >= self.span[1]].sum())
        sides = [(round(below), "smaller"), (round(above), "larger")]
        beyond = " and ".join(f"{n} {side}" for n, side in sides if n)
        title = [AXIS_TITLES[self.panels[0].quantity]]
        return [*title, f"Not in view: {beyond} values"] if beyond else title


def columns_of(summaries: Mapping[Method, MethodSummary], names: Sequence[str]) -> list[Column]:
    """The panels of each quantity, a row for each method."""
    if unknown := [name for name in names if name not in COLUMNS]:
        raise StereocalError(f'The column "{unknown[0]}" is not known: {", ".join(COLUMNS)}.')
    found = []
    for column, name in enumerate(names):
        marks, panels = standings(summaries, name), []
        for row, method in enumerate(method for method in ALL_METHODS if method in summaries):
            number = len(names) * row + column
            standing, axis = marks.get(method, ""), str(number + 1) if number else ""
            panels.append(Panel(method, name, summaries[method], standing, row, column, axis))
        found.append(Column(panels))
    return found


def drawn_bins(pdf: Pdf) -> slice:
    """The bins to draw, from one before the first value to one after the last."""
    filled = np.flatnonzero(pdf.density)
    if not len(filled):
        return slice(0, 0)
    return slice(max(0, int(filled[0]) - 1), min(len(pdf.density), int(filled[-1]) + 2))


def standings(summaries: Mapping[Method, MethodSummary], quantity: str) -> dict[Method, Standing]:
    """`best`, or `level` where 95 % intervals overlap that of the lowest; others are not in it."""
    estimates = {method: _estimate(own, quantity) for method, own in summaries.items()}
    lowest = estimates[best_methods(summaries)[quantity]]
    # NaN, where no bar could be measured, is not below anything.
    level = [method for method, own in estimates.items() if own.low <= lowest.high]
    return dict.fromkeys(level, "level" if len(level) > 1 else "best")


def _estimate(summary: MethodSummary, quantity: str) -> Estimate:
    if quantity == "reconstruction":
        return summary.reconstruction.median
    return summary.residual.fcp if quantity == "residual" else summary.reprojection.fcp


def describe_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = COLUMNS
) -> str:
    """The figure in words, one sentence per column."""
    sentences = []
    for quantity in columns:
        parts = [
            f"{METHOD_NAMES[panel.method]} {panel.words}"
            + (f" ({panel.standing})" if panel.standing else "")
            for panel in columns_of(summaries, [quantity])[0].panels
        ]
        what = (
            "3D error of bars, median and 95 %"
            if quantity == "reconstruction"
            else f"How often a wrong pair looks right (FCP), by {HEADINGS[quantity].lower()}"
        )
        sentences.append(f"{what}: {'; '.join(parts)}.")
    return f"{' '.join(sentences)} In brackets: 95 % intervals."
