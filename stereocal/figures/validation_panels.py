"""The panels of the validation figure: which method stands where, its title, and its words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from stereocal.figures.style import METHOD_NAMES
from stereocal.verdict.in_words import digits, interval, percent

COLUMNS = ("residual", "reprojection", "reconstruction")
HEADINGS = {
    "residual": "|Residual|",
    "reprojection": "Reprojection error",
    "reconstruction": "3D error",
}
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
    def pdfs(self) -> tuple[Pdf, ...]:
        """The PDFs that it shows."""
        found = self.matching
        return (found.correct, found.wrong) if found else (self.summary.reconstruction.pdf,)

    @property
    def scale(self) -> float:
        """Units of the axis per unit of the quantity: 3D errors are fractions, drawn in %."""
        return 1.0 if self.matching else 100.0

    @property
    def line(self) -> float:
        """Position of the vertical line, in the unit of the axis."""
        return self.matching.threshold if self.matching else self.scale * ACCEPTABLE

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


def panels_of(summaries: Mapping[Method, MethodSummary], columns: Sequence[str]) -> list[Panel]:
    """All panels, row by row."""
    for quantity in columns:
        if quantity not in COLUMNS:
            raise StereocalError(f'The column "{quantity}" is not known: {", ".join(COLUMNS)}.')
    by_column = {quantity: standings(summaries, quantity) for quantity in columns}
    found: list[Panel] = []
    for row, method in enumerate(method for method in ALL_METHODS if method in summaries):
        for column, quantity in enumerate(columns):
            axis = str(len(found) + 1) if found else ""
            standing = by_column[quantity].get(method, "")
            found.append(Panel(method, quantity, summaries[method], standing, row, column, axis))
    return found


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
            for panel in panels_of(summaries, [quantity])
        ]
        what = (
            "3D error of bars, median and 95 %"
            if quantity == "reconstruction"
            else f"How often a wrong pair looks right (FCP), by {HEADINGS[quantity].lower()}"
        )
        sentences.append(f"{what}: {'; '.join(parts)}.")
    return f"{' '.join(sentences)} In brackets: 95 % intervals."
