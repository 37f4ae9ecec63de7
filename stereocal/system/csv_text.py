"""Tables as CSV whose text no spreadsheet runs as a formula.

A name such as `=cmd`, `+x` or `-left` is written with an apostrophe before it, which our readers
take away again; one that begins with apostrophes before such a sign gets one more. Numbers as -1,
and signs alone, stay as they are.
"""

import re
from typing import Any

import numpy as np
import pandas as pd

from stereocal.system.numbers import is_number

_RUN = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""How what is run begins, full-width signs too, which spreadsheets take for the usual ones."""
_SIGNS = re.compile(r"[=+\-@]+")


def csv_text(table: pd.DataFrame, **options: Any) -> str:
    """The table without its index; `options` are those of pandas."""
    safe = table.rename(columns=lambda name: quoted(str(name)))
    for k in [k for k, dtype in enumerate(safe.dtypes) if dtype.kind not in "biufcM"]:
        cells = safe.iloc[:, k].to_numpy(dtype=object).tolist()
        if any(isinstance(cell, str) and _RUN.match(cell) for cell in cells):
            quoted_cells = [quoted(cell) if isinstance(cell, str) else cell for cell in cells]
            safe.isetitem(k, np.array(quoted_cells, dtype=object))
    return str(safe.to_csv(index=False, lineterminator="\n", **options))


def quoted(text: str) -> str:
    """The text with an apostrophe before it if a spreadsheet would run it."""
    if not _RUN.match(text) or _SIGNS.fullmatch(text) or is_number(text.replace(",", ".")):
        return text
    return f"'{text}"


def unquoted(text: str) -> str:
    """The text of `quoted`."""
    return text[1:] if text[:1] == "'" and quoted(text[1:]) == text else text


def as_names(cells: "pd.Series[str]") -> "pd.Series[str]":
    """The names in a column of a table, without blanks and apostrophes of `quoted`."""
    return without_apostrophes(cells.str.strip())


def without_apostrophes(cells: "pd.Series[str]") -> "pd.Series[str]":
    """A column of a table as it was before it was written by `csv_text`."""
    return cells.map(unquoted, na_action="ignore") if cells.str.startswith("'").any() else cells
