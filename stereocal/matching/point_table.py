"""Large tables of points, CSV or Parquet, read frame by frame and written piece by piece.

    table = PointTable(Path("primary.csv"), ("u", "v"))
    summary = table.check(camera_of_the_rig)
    for frame, rows in table.frames():
        ...

A table has a column `frame` and some columns of numbers; all further columns are carried along.
Rows without any of the numbers (empty or NaN: nothing was seen) are left out. Only a block of whole
frames is in memory at a time, where the rows come in the order of the frames; a table in another
order is read whole and sorted.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.matching.parquet import PARQUET, block_rows, parquet_chunks, parquet_names
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.limits import Limits

MOST_COLUMNS = 2_000
LONGEST_HEADER = 1_000_000
MISSING = ("", "nan", "na", "none", "null")


@dataclass(frozen=True)
class Contents:
    """What a table holds."""

    rows: int
    frames: IntArray
    """The frame numbers, each once, in order."""
    further: tuple[str, ...]
    """Names of the columns that are carried along."""
    left_out: int
    """Rows without numbers."""
    largest: tuple[float, ...]
    """The largest value of each column of numbers."""


class PointTable:
    """A table on disk.

    Args:
        path: `.parquet` and `.pq` are Parquet, all others CSV (comma, semicolon or tab).
        numbers: names of the columns that must hold finite numbers.
        label: what messages call the table; None is its path.

    Raises:
        StereocalError: no such file, or a column is missing.
    """

    def __init__(self, path: Path, numbers: Sequence[str], label: str | None = None) -> None:
        self.path = path
        self.label = label or str(path)
        self.numbers = tuple(numbers)
        self.is_parquet = path.suffix.lower() in PARQUET
        self.delimiter = ","
        try:
            Limits.from_environment().check_size(path.stat().st_size, self.label)
            names = parquet_names(path, self.label) if self.is_parquet else self._csv_names()
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            reason = getattr(error, "strerror", None) or error
            raise StereocalError(f"{self.label}: the file cannot be read ({reason}).") from error
        self.names = tuple(name.strip() for name in names)
        self._refuse_columns()
        self.further = tuple(n for n in self.names if n != "frame" and n not in self.numbers)
        self._left_out = 0
        self._in_order: bool | None = None

    def check(self, refuse: Callable[[pd.DataFrame], list[RowProblem]] | None = None) -> Contents:
        """Read the whole table once and refuse what cannot be used.

        Args:
            refuse: finds further problems in a block of whole frames.

        Raises:
            StereocalError: rows that cannot be used are named by their line; or no rows at all.
        """
        try:
            return self._checked(refuse)
        except _OutOfOrderError:
            self._in_order = False
            return self._checked(refuse)

    def _checked(self, refuse: Callable[[pd.DataFrame], list[RowProblem]] | None) -> Contents:
        limits = Limits.from_environment()
        frames: list[IntArray] = []
        rows = 0
        self._left_out = 0
        largest = np.full(len(self.numbers), -np.inf)
        for block in self._blocks():
            if refuse is not None and (problems := refuse(block)):
                raise RefusedRowsError(f"{self.label}: ", problems, "cannot be used")
            rows += len(block)
            limits.check_rows(rows, self.label)
            frames.append(np.unique(block["frame"].to_numpy()))
            largest = np.maximum(largest, block[list(self.numbers)].to_numpy().max(axis=0))
        if not rows:
            raise StereocalError(f"{self.label}: the table has no rows with points.")
        return Contents(
            rows, np.unique(np.concatenate(frames)), self.further, self._left_out, tuple(largest)
        )

    def frames(self) -> Iterator[tuple[int, pd.DataFrame]]:
        """Number and rows of each frame, in order. The index holds the lines of the file."""
        for block in self.blocks():
            numbers = block["frame"].to_numpy()
            starts = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
            for start, end in itertools.pairwise([*starts, len(block)]):
                yield int(numbers[start]), block.iloc[start:end]

    def blocks(self) -> Iterator[pd.DataFrame]:
        """The rows in the order of the frames, in blocks of whole frames.

        Raises:
            StereocalError: as `check`, which comes first where nobody has called it.
        """
        if self._in_order is None:
            self.check()
        yield from self._blocks()

    def _blocks(self) -> Iterator[pd.DataFrame]:
        if self._in_order is False:
            whole = pd.concat(list(self._chunks()))
            if len(whole):
                yield whole.sort_values("frame", kind="stable")
            return
        waiting: list[pd.DataFrame] = []
        last = -np.inf
        for chunk in self._chunks():
            numbers = chunk["frame"].to_numpy()
            if not len(chunk):
                continue
            if numbers[0] < last or (np.diff(numbers) < 0).any():
                raise _OutOfOrderError
            ended = np.searchsorted(numbers, numbers[-1])
            if numbers[-1] > last and waiting:
                yield pd.concat([*waiting, chunk.iloc[:ended]])
                waiting = []
            elif ended:
                yield chunk.iloc[:ended]
            waiting.append(chunk.iloc[ended:])
            last = numbers[-1]
        if waiting:
            yield pd.concat(waiting)
        self._in_order = True

    def _chunks(self) -> Iterator[pd.DataFrame]:
        for raw in parquet_chunks(self.path, self.label) if self.is_parquet else self._csv_chunks():
            yield self._converted(raw)

    def _csv_names(self) -> list[str]:
        with self.path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline(LONGEST_HEADER)
            if not first.strip():
                raise StereocalError(
                    f"{self.label}: the file is empty, or its first line is; it must name the "
                    f"columns frame, {', '.join(self.numbers)}."
                )
            self.delimiter = max(",;\t", key=first.count)
            names = next(csv.reader([first], delimiter=self.delimiter))
            # A quoted cell may go on in the next line.
            lines = iter(lambda: file.readline(LONGEST_HEADER), "")
            cells = next(csv.reader(lines, delimiter=self.delimiter), [])
            if len(cells) > len(names):  # pandas takes this width for the table's
                raise StereocalError(
                    f"{self.label}: 1 row cannot be used: line 2: {len(cells)} cells instead of "
                    f"{len(names)}."
                )
            return names

    def _refuse_columns(self) -> None:
        if len(self.names) > MOST_COLUMNS:
            raise StereocalError(
                f"{self.label}: {len(self.names)} columns are too many; at most {MOST_COLUMNS} are "
                "read."
            )
        missing = [name for name in ("frame", *self.numbers) if name not in self.names]
        if missing:
            raise StereocalError(
                f"{self.label}: the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} "
                f"{'are' if len(missing) > 1 else 'is'} missing; the first line must name the "
                f"columns frame, {', '.join(self.numbers)}, and names "
                f"{', '.join(self.names)[:200]}."
            )
        twice = [name for name in self.names if self.names.count(name) > 1]
        if twice:
            raise StereocalError(
                f"{self.label}: the column {twice[0]} stands in the first line twice."
            )

    def _csv_chunks(self) -> Iterator[pd.DataFrame]:
        try:
            with pd.read_csv(
                self.path,
                sep=self.delimiter,
                names=list(self.names),
                header=0,
                index_col=False,
                dtype=str,
                keep_default_na=False,
                skip_blank_lines=False,
                encoding="utf-8-sig",
                chunksize=block_rows(self.names),
                on_bad_lines="error",
            ) as reader:
                for chunk in reader:
                    chunk.index += 2  # line 1 names the columns
                    yield chunk
        except pd.errors.ParserError as error:
            raise rows_error(error, self.label) from error
        except (OSError, UnicodeDecodeError) as error:
            raise StereocalError(f"{self.label}: the file cannot be read ({error}).") from error

    def _converted(self, raw: pd.DataFrame) -> pd.DataFrame:
        """Numbers as numbers; rows without points left out.

        Raises:
            RefusedRowsError: names the lines of the others that cannot be used.
        """
        raw.columns = pd.Index(self.names)
        columns, missing = {}, {}
        for name in ("frame", *self.numbers):
            columns[name] = numbers_of(raw[name], decimal_comma=self.delimiter == ";")
            missing[name] = is_missing(raw[name])
        points = np.column_stack([columns[name] for name in self.numbers])
        unseen = np.logical_and.reduce([missing[name] for name in self.numbers])
        whole = columns["frame"] == np.round(columns["frame"])
        good = np.isfinite(points).all(axis=1) & whole & (np.abs(columns["frame"]) < 2**53)
        bad = np.flatnonzero(~good & ~unseen)
        if len(bad):
            lines = raw.index.to_numpy()
            texts = {name: raw[name].to_numpy() for name in columns}
            problems = [
                RowProblem(int(lines[row]), _reason(int(row), columns, missing, texts))
                for row in bad
            ]
            raise RefusedRowsError(f"{self.label}: ", problems, "cannot be used")
        kept = good & ~unseen
        # A blank line is no row.
        self._left_out += int((unseen & ~missing["frame"]).sum())
        table = pd.DataFrame(
            {"frame": columns["frame"][kept].astype(np.int64)}, index=raw.index[kept]
        )
        for i, name in enumerate(self.numbers):
            table[name] = points[kept, i]
        for name in self.further:
            table[name] = raw[name][kept]
        return table


def _reason(
    row: int,
    columns: Mapping[str, FloatArray],
    missing: Mapping[str, npt.NDArray[np.bool_]],
    texts: Mapping[str, npt.NDArray[Any]],
) -> str:
    """Why a row cannot be used."""
    for name, values in columns.items():
        value, text = values[row], str(texts[name][row]).strip()[:40]
        if missing[name][row]:
            return f"{name} is empty"
        if not np.isfinite(value):
            return f'{name} is "{text}", which is not a finite number'
        if name == "frame" and (value != round(value) or abs(value) >= 2**53):
            return f"frame is {text}, which is not a whole number"
    return "it cannot be read"


class _OutOfOrderError(Exception):
    """The rows are not in the order of the frames."""


def rows_error(error: ValueError, source: str) -> StereocalError:
    """What pandas says of a row that it cannot read, with the line."""
    found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
    where = f"line {found[2]}: {found[3]} cells instead of {found[1]}" if found else error
    return StereocalError(f"{source}: 1 row cannot be used: {where}.")


def numbers_of(column: pd.Series[Any], decimal_comma: bool) -> FloatArray:
    """A column as numbers; NaN for what is none."""
    if not pd.api.types.is_numeric_dtype(column):
        column = _texts(column)
        if decimal_comma:
            column = column.str.replace(",", ".", regex=False)
    return pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)


def _texts(column: pd.Series[Any]) -> pd.Series[Any]:
    """Words for what a Parquet file can have in place of numbers: dates, lists, bytes."""
    return column.map(str) if column.dtype == object else column.astype(str)


def is_missing(column: pd.Series[Any]) -> npt.NDArray[np.bool_]:
    """Where a column is empty, or says that it is (NaN, NA, none)."""
    if pd.api.types.is_numeric_dtype(column):
        return column.isna().to_numpy()
    words = _texts(column).str.strip().str.lower()
    return (column.isna() | words.isin(MISSING)).to_numpy()
