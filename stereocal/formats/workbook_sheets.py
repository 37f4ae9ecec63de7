"""The sheets of an Excel workbook (.xlsx) as CSV, each with the cells that are no data.

A process of its own reads it, which starts in half the time since little is imported here.
"""

import csv
import io
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from itertools import zip_longest
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.tables import MAXIMUM_CELLS, MAXIMUM_COLUMNS

DATES = (datetime, date, time, timedelta)
FORMULA = "f"
AS_NUMBERS = "format the column as numbers, and write them again"
CALCULATE = "formula without a stored value: calculate and save the file in a spreadsheet program"
ROW_OF_DATA = 2
"""Numbers in a row from which on it is no title."""


@dataclass(frozen=True)
class Sheet:
    """A sheet as CSV, a line for each of its rows."""

    title: str
    text: bytes
    problem: str
    """Its first cell that cannot be used, and what to do; empty if there is none."""


def sheets_in(path: Path, source: str) -> list[Sheet]:
    """The sheets of a workbook, in order."""
    import openpyxl

    try:
        with path.open("rb") as file, path.open("rb") as again:
            options = {"read_only": True, "keep_links": False}
            shown = openpyxl.load_workbook(file, data_only=True, **options)
            stated = openpyxl.load_workbook(again, **options)
            pairs = zip(shown.worksheets, stated.worksheets, strict=True)
            return [_sheet(values, cells, source) for values, cells in pairs]
    except (*DAMAGED, KeyError, TypeError, AttributeError, SyntaxError) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this Excel file is damaged ({error}).") from error


def _sheet(values: Any, cells: Any, source: str) -> Sheet:
    """A sheet, of the workbook with the stored values and of that with the formulas."""
    for sheet in (values, cells):
        sheet.reset_dimensions()
    lines, count, formula = list[list[str]](), 0, ""
    has_numbers, dates, is_below = set[int](), dict[int, str](), False
    rows = zip_longest(values.iter_rows(), cells.iter_rows(), fillvalue=())
    for row, of_formulas in rows:
        count += len(row) or 1
        if len(row) > MAXIMUM_COLUMNS or count > MAXIMUM_CELLS:
            raise StereocalError(f"{source}: the sheet {values.title} has too many cells.")
        found = [cell.value for cell in row]
        numbers = {k for k, value in enumerate(found) if type(value) in (int, float)}
        is_below |= len(numbers) >= ROW_OF_DATA
        has_numbers |= numbers if is_below else set()
        for k, value in enumerate(found):
            if is_below and isinstance(value, DATES):
                dates.setdefault(k, f"{row[k].coordinate} is the date {value}: {AS_NUMBERS}")
            elif value is None and k < len(of_formulas) and of_formulas[k].data_type == FORMULA:
                formula = formula or f"{of_formulas[k].coordinate} is a {CALCULATE}"
        lines.append([_text(value) for value in found])
    width = max(map(len, lines), default=0)
    text = io.StringIO()
    for line in lines:
        padded = [*line, *(width - len(line)) * [""]] if any(line) else []
        csv.writer(text, lineterminator="\n").writerow(padded)
    problem = next((words for k, words in dates.items() if k in has_numbers), formula)
    return Sheet(str(values.title), text.getvalue().encode(), problem)


def _text(value: object) -> str:
    """A cell on one line."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return "" if value is None else " ".join(str(value).split())
