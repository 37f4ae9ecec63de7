"""Read text tables as spreadsheets and programs of any country write them; errors name the lines.

All tables from users are read here. The caller describes the numeric columns by `Column`; how the
table is written is found in its first lines (`dialect`).
"""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.system.dialect import Dialect, dialect_of, encoding_of, head_of, one_line_end
from stereocal.system.limits import Limits
from stereocal.system.numbers import plural

MAXIMUM_COLUMNS = 2_000
MAXIMUM_CELLS = 100_000_000
"""In a table that is read into memory as a whole."""
LARGEST_WHOLE = 2**53 - 1
"""Above it, 64-bit floats are not all of the whole numbers: 2^53 + 1 would be read as 2^53."""
LARGEST_INTEGER = 2**63 - 1
"""Of frames that are times in nanoseconds."""
EMPTY = frozenset(("",))
MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "none", "null"))
_THOUSANDS = re.compile(r"[-+]?\d{1,3}([.,' ]\d{3})+([.,]\d*)?")
Values = dict[str, npt.NDArray[Any]]
"""Columns as floats; whole numbers beyond `LARGEST_WHOLE` as integers."""
Reasons = dict[int, str]
"""Why rows are invalid, by row index from 0."""


@dataclass(frozen=True)
class Column:
    """A column of numbers."""

    name: str
    may_be_empty: bool = False
    """An empty cell is read as NaN, without an error."""
    is_whole: bool = False
    most: int = LARGEST_WHOLE
    """Of a whole number. With `LARGEST_INTEGER` the column is one of integers if it needs to be."""
    is_positive: bool = False
    is_pixel: bool = False
    """A coordinate in an image."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a table whose first line names the columns."""

    raw: pd.DataFrame
    """All cells as text, with the lines as index."""
    values: Values
    reasons: Reasons
    """To which the caller adds its own."""
    too_long: list[RowProblem]
    """Rows with more cells than columns, which are not in `raw`."""

    @property
    def problems(self) -> list[RowProblem]:
        """All invalid rows, in the order of the lines."""
        lines = self.raw.index
        invalid = [RowProblem(int(lines[row]), reason) for row, reason in self.reasons.items()]
        return sorted([*self.too_long, *invalid], key=lambda problem: problem.line)

    def check(self, source: str) -> None:
        """Raise a `RefusedRowsError` if rows are invalid."""
        if self.problems:
            raise RefusedRowsError(f"{source}: ", self.problems, "cannot be used")


def read_rows(
    content: bytes,
    source: str,
    required: Sequence[str],
    columns: Sequence[Column],
    texts: Sequence[str] = (),
    empty: frozenset[str] = MISSING,
) -> Rows:
    """The rows of a table by the names in its first line; columns of other names are ignored.

    Args:
        required: names that must be there.
        columns: of numbers.
        texts: further names that must not occur twice.
        empty: words, in lower case, that mark an empty cell.
    """
    lines = max(content.count(b"\n"), content.count(b"\r"))
    Limits.from_environment().check_pairs(lines - 1, source)
    text = text_of(content, source)
    names, dialect = names_of(text, source)
    check_names(names, required, (*required, *(column.name for column in columns), *texts), source)
    raw, too_long = rows_below(text, dialect, 1, len(names), source)
    if not len(raw) and not too_long:
        raise StereocalError(f"{source}: the table has a header and no rows.")
    raw.columns = pd.Index(names)
    pixels = [column.name for column in columns if column.is_pixel and column.name in names]
    values, reasons = numbers_in(raw, columns, dialect.decimal_comma, empty)
    refuse_thousands(raw, pixels, [values[name] for name in pixels], pixels, source)
    return Rows(raw, values, reasons, too_long)


def names_of(text: str, source: str) -> tuple[list[str], Dialect]:
    """The names of the columns in lower case, and the dialect."""
    lines = head_of(text)
    dialect = dialect_of(lines)
    (cells,) = dialect.cells(lines[dialect.above], source)
    return [cell.strip().lower() for cell in cells], dialect


def text_of(content: bytes, source: str) -> str:
    Limits.from_environment().check_size(len(content), source)
    try:
        text = one_line_end(content.decode(encoding_of(content)))
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).") from error
    if "\0" in text:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).")
    if not text.strip():
        raise StereocalError(f"{source}: the file is empty.")
    return text


def refuse_missing(what: str, table: pd.DataFrame, columns: Sequence[str]) -> None:
    """Raise an error if a table in memory has not all columns."""
    missing = [name for name in columns if name not in table]
    if missing:
        raise StereocalError(f"{what} has no column {missing[0]}.")


def check_names(
    names: Sequence[str], required: Sequence[str], known: Sequence[str], source: str
) -> None:
    """Check the names of columns in the first line.

    Args:
        known: columns that must not occur twice.
    """
    if len(names) > MAXIMUM_COLUMNS:
        raise StereocalError(
            f"{source}: {len(names)} columns are too many; at most {MAXIMUM_COLUMNS} are read."
        )
    missing = [name for name in required if name not in names]
    if missing:
        raise StereocalError(
            f"{source}: the {plural(len(missing), 'column')} {', '.join(missing)} "
            f"{'are' if len(missing) > 1 else 'is'} missing; the first line must name the columns "
            f"{', '.join(required)}, and names {', '.join(names)[:200]}."
        )
    twice = [name for name in known if names.count(name) > 1]
    if twice:
        raise StereocalError(f"{source}: the first line names the column {twice[0]} twice.")


def rows_below(
    text: str, dialect: Dialect, header: int, width: int, source: str, most: int | None = None
) -> tuple[pd.DataFrame, list[RowProblem]]:
    """The rows below the header, all cells as text, with their lines as index.

    Args:
        header: number of its lines.
        width: number of named columns; rows with more cells are returned as problems.
        most: largest number of rows to read.
    """
    lines = dialect.above + header
    widest = max(width, max(map(dialect.count, io.StringIO(text)), default=0))
    if widest > MAXIMUM_COLUMNS or widest * text.count("\n") > MAXIMUM_CELLS:
        raise StereocalError(
            f"{source}: {widest} columns of {text.count(chr(10))} rows are too many for one table."
        )
    options = {"skiprows": lines, "nrows": most, "skip_blank_lines": False}
    (raw,) = _read(io.StringIO(text), dialect, range(widest), source, options)
    if not len(raw):
        raise StereocalError(f"{source}: the table has a header and no rows.")
    within = _line_ends(raw) if '"' in text else 0
    raw.index = pd.Index(np.arange(len(raw)) + lines + 1 + within)
    raw = raw.fillna("")
    blank = raw[0].str.strip() == ""
    blank[blank] = (raw[blank].apply(lambda column: column.str.strip()) == "").all(axis=1)
    further = raw.iloc[:, width:]
    longer = (further.apply(lambda column: column.str.strip()) != "").to_numpy()
    lines_of = raw.index.to_numpy()
    problems = [
        RowProblem(int(lines_of[row]), f"{width + 1 + last} cells instead of {width}")
        for row in np.flatnonzero(longer.any(axis=1))
        for last in np.flatnonzero(longer[row])[-1:]
    ]
    return raw[~blank.to_numpy() & ~longer.any(axis=1)].iloc[:, :width], problems


def refuse_thousands(
    raw: pd.DataFrame,
    columns: Sequence[Any],
    values: Sequence[npt.NDArray[np.float64]],
    titles: Sequence[str],
    source: str,
) -> None:
    """Refuse pixels that are whole numbers up to 999 beside numbers below 100 with exactly three
    decimals: 1.385 beside 812 is 1385 with a sign between thousands. Of sub-pixel data some have
    100 px and decimals, or another number of them.

    Args:
        columns: of pixels, in `raw`; their numbers, and their names for the message.
    """
    pixels = np.abs(np.array(values)[np.isfinite(values)])
    is_whole = pixels == np.round(pixels)
    parted, whole = pixels[~is_whole], pixels[is_whole].max(initial=0.0)
    if not len(parted) or not 1 <= parted.min() <= parted.max() < 100 or not 100 <= whole <= 999:
        return
    cells = pd.concat([_texts(raw[name]).str.strip() for name in columns], keys=titles)
    cells = cells[np.concatenate([np.isfinite(numbers) for numbers in values])]
    signed = cells[cells.str.contains("[.,]", regex=True)]
    if cells.str.fullmatch(r"[-+]?(\d{1,3}|[1-9]\d?[.,]\d{3})").all():
        cell, (title, line) = signed.iloc[0], signed.index[0]
        raise StereocalError(
            f'{source}: line {line}: {title} is "{cell}", and others are whole numbers up to '
            f"{whole:.0f}. If it is {re.sub('[.,]', '', cell)} with a sign between thousands, "
            f"write all numbers without that sign; if it is {cell.replace(',', '.')} px, write all "
            "with the same number of decimals."
        )


def chunks_of_file(
    path: Path, names: Sequence[str], dialect: Dialect, rows: int, source: str
) -> Iterator[pd.DataFrame]:
    """The rows of a file below its first line in blocks of `rows`, as text."""
    options = {
        "header": 0,
        "skiprows": dialect.above,
        "index_col": False,
        "encoding": dialect.encoding,
        "chunksize": rows,
        "skip_blank_lines": False,
        "on_bad_lines": "error",
    }
    for chunk in _read(path, dialect, names, source, options):
        chunk.index += dialect.above + 2  # the line above names the columns
        yield chunk


def numbers_in(
    raw: pd.DataFrame, columns: Sequence[Column], decimal_comma: bool, empty: frozenset[str]
) -> tuple[Values, Reasons]:
    """Columns as numbers (NaN for missing cells and columns), and why rows are invalid.

    Args:
        empty: words, in lower case, that mark an empty cell.
    """
    values: Values = {}
    reasons: Reasons = {}
    for column in columns:
        if column.name not in raw:
            values[column.name] = np.full(len(raw), np.nan)
            continue
        numbers = values[column.name] = numbers_of(raw[column.name], decimal_comma)
        bad = ~np.isfinite(numbers)
        if column.is_whole:
            with np.errstate(invalid="ignore"):
                bad |= numbers != np.round(numbers)
                large = np.abs(numbers) > LARGEST_WHOLE
            if large.any() and column.most > LARGEST_WHOLE:
                values[column.name], large = _integers(raw[column.name], numbers, large)
            bad |= large
        if column.is_positive:
            bad |= numbers <= 0
        if column.may_be_empty and bad.any():
            bad &= ~is_missing(raw[column.name], empty)
        rows = [row for row in np.flatnonzero(bad).tolist() if row not in reasons]
        for row, cell in zip(rows, raw[column.name].iloc[rows].tolist(), strict=True):
            reasons[row] = _reason(column, str(cell).strip(), float(numbers[row]), empty)
    return values, reasons


def _integers(
    cells: "pd.Series[Any]", numbers: npt.NDArray[np.float64], large: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """The whole numbers of a column, and which of the large ones are no integers of 64 bits."""
    values = np.where(np.isfinite(numbers) & ~large, numbers, 0).astype(np.int64)
    beyond = large.copy()
    for row in np.flatnonzero(large).tolist():
        text = str(cells.iloc[row]).strip()
        if re.fullmatch(r"[-+]?[0-9]{1,19}", text) and abs(int(text)) <= LARGEST_INTEGER:
            values[row], beyond[row] = int(text), False
    return values, beyond


def numbers_of(column: "pd.Series[Any]", decimal_comma: bool) -> npt.NDArray[np.float64]:
    """A column as numbers; NaN for other cells."""
    if not pd.api.types.is_numeric_dtype(column):
        column = _texts(column)
        if decimal_comma:
            column = column.str.replace(",", ".", regex=False)
    return pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)


def is_missing(column: "pd.Series[Any]", empty: frozenset[str] = MISSING) -> npt.NDArray[np.bool_]:
    """Where a column is empty or marked as empty (NaN, NA, none)."""
    if pd.api.types.is_numeric_dtype(column):
        return column.isna().to_numpy()
    words = _texts(column).str.strip().str.lower()
    return (column.isna() | words.isin(empty)).to_numpy()


def _read(
    file: Path | io.StringIO,
    dialect: Dialect,
    names: Sequence[Any],
    source: str,
    options: Mapping[str, Any],
) -> Iterator[pd.DataFrame]:
    every: dict[str, Any] = {"header": None, **options}
    separator = r"\s+" if dialect.delimiter == " " else dialect.delimiter
    try:
        table: Any = pd.read_csv(
            file, sep=separator, names=list(names), dtype=str, keep_default_na=False, **every
        )
        if isinstance(table, pd.DataFrame):
            yield table
            return
        with table as chunks:
            yield from chunks
    except pd.errors.ParserError as error:
        match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        where = f"line {match[2]}: {match[3]} cells instead of {match[1]}" if match else error
        raise StereocalError(f"{source}: 1 row cannot be used: {where}.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise StereocalError(f"{source}: the file cannot be read ({error}).") from error


def _line_ends(raw: pd.DataFrame) -> npt.NDArray[np.int64]:
    """The number of line ends in quoted cells of the rows before each row."""
    within = sum(raw[name].str.count("\n").fillna(0).to_numpy(dtype=np.int64) for name in raw)
    return np.asarray(np.cumsum(within) - within, dtype=np.int64)


def _reason(column: Column, cell: str, value: float, empty: frozenset[str]) -> str:
    text = cell[:40]
    if cell.lower() in empty:
        return f"{column.name} is empty"
    if np.isinf(value) or cell.lower().lstrip("+-") == "nan":
        return f"{column.name} is {text}, which is not a finite number"
    if np.isnan(value):
        how = ": write it without a sign between thousands" if _THOUSANDS.fullmatch(cell) else ""
        return f'{column.name} is "{text}", which is not a number{how}'
    if column.is_whole and abs(value) > LARGEST_WHOLE:
        bits = column.most.bit_length()
        return f"{column.name} is {text}; whole numbers are read up to 2^{bits} - 1"
    if column.is_whole:
        return f"{column.name} is {text}, which is not a whole number"
    return f"{column.name} is {value:g}; it must be above 0"


def _texts(column: "pd.Series[Any]") -> "pd.Series[Any]":
    """The column as text, also for Parquet's dates, lists and bytes."""
    return column.map(str) if column.dtype == object else column.astype(str)
