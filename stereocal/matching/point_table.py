"""Large tables of points, CSV or Parquet, read frame by frame and written block by block.

    table = PointTable(Path("primary.csv"), ("u", "v"))
    summary = table.check(camera_of_the_rig)
    for frame, rows in table.frames():
        ...

A table has a column `frame` (or, without it, `camera_frame`) and columns of numbers, perhaps
`SIGMAS`; all further columns are passed through. Rows without any of the numbers (empty or NaN) are
left out. If the rows are in the order of the frames, only a block of whole frames is in memory at a
time; otherwise the table is read whole and sorted. Parquet needs the optional package pyarrow.
"""

import csv
import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import DAMAGED, RefusedRowsError, RowProblem, StereocalError
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.atomic_files import write_in_parts
from stereocal.system.csv_text import csv_text, unquoted, without_apostrophes
from stereocal.system.dialect import (
    HEAD_CHARACTERS,
    Dialect,
    dialect_of,
    encoding_of,
    head_of,
    refuse_binary,
)
from stereocal.system.limits import Limits
from stereocal.system.tables import (
    LARGEST_INTEGER,
    MISSING,
    Column,
    check_names,
    chunks_of_file,
    is_missing,
    numbers_in,
    refuse_thousands,
)

PARQUET = (".parquet", ".pq")
BLOCK_ROWS = 100_000
BLOCK_CELLS = 5_000_000
"""Limit that reduces the rows of a block with many columns."""
WRITTEN_ROWS = 50_000
"""Rows that are written at once."""
POINT = ("u", "v")
OWN_FRAME, SIGMA = "camera_frame", "sigma_px"
PAIR_SIGMAS = ("sigma_primary_px", "sigma_secondary_px")
SIGMAS = (SIGMA, *PAIR_SIGMAS)
"""Columns for the standard deviation of a point's coordinates, of one camera and of pairs."""


@dataclass(frozen=True)
class Contents:
    """Summary of a table."""

    rows: int
    frames: IntArray
    """The distinct frame numbers, in order."""
    left_out: int
    """Rows without numbers."""
    largest: tuple[float, ...]
    """The largest value of each column of numbers."""
    distinct: pd.DataFrame
    """The different rows of the columns asked for."""


class PointTable:
    """A table on disk, or one that was read.

    Args:
        source: `.parquet` and `.pq` are Parquet, all others CSV (comma, semicolon or tab).
        numbers: names of the columns that must hold finite numbers.
        label: name of the table in messages; None: its path.
        may_lack: whether some of these numbers may be missing in a row.
    """

    def __init__(
        self,
        source: Path | pd.DataFrame,
        numbers: Sequence[str] = POINT,
        label: str | None = None,
        may_lack: bool = False,
    ) -> None:
        self.source, self.may_lack = source, may_lack
        self.numbers = tuple(numbers)
        self.label = label or ("the table" if isinstance(source, pd.DataFrame) else str(source))
        self.dialect = Dialect()
        try:
            names = self._names()
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            reason = getattr(error, "strerror", None) or error
            raise StereocalError(f"{self.label}: the file cannot be read ({reason}).") from error
        self.names = tuple(name.strip() for name in names)
        if "frame" not in self.names:  # numbered by the camera's own count
            self.names = tuple("frame" if n == OWN_FRAME else n for n in self.names)
        check_names(self.names, ("frame", *self.numbers), self.names, self.label)
        self.sigmas = tuple(n for n in self.names if n in SIGMAS)
        known = ("frame", *self.numbers, *self.sigmas)
        self.further = tuple(n for n in self.names if n not in known)
        self._left_out = 0
        self._in_order: bool | None = None

    def check(
        self,
        refuse: Callable[[pd.DataFrame], list[RowProblem]] | None = None,
        columns: Sequence[str] = (),
    ) -> Contents:
        """Read and check the whole table.

        Args:
            refuse: returns further problems in a block of whole frames.
            columns: whose different rows are wanted.
        """
        limits = Limits.from_environment()
        frames: list[IntArray] = []
        distinct: list[pd.DataFrame] = []
        rows = self._left_out = 0
        largest = np.full(len(self.numbers), -np.inf)
        try:
            for block in self._blocks():
                if refuse is not None and (problems := refuse(block)):
                    raise RefusedRowsError(f"{self.label}: ", problems, "cannot be used")
                rows += len(block)
                limits.check_rows(rows, self.label)
                frames.append(np.unique(block["frame"].to_numpy()))
                distinct.append(block[list(columns)].drop_duplicates())
                largest = np.fmax(largest, block[list(self.numbers)].max().to_numpy())
        except _OutOfOrderError:
            self._in_order = False
            return self.check(refuse, columns)
        if not rows:
            raise StereocalError(f"{self.label}: the table has no rows with points.")
        return Contents(
            rows,
            np.unique(np.concatenate(frames)),
            self._left_out,
            tuple(largest),
            pd.concat(distinct).drop_duplicates(),
        )

    def frames(self) -> Iterator[tuple[int, pd.DataFrame]]:
        """Number and rows of each frame, in order. The index is the line in the file."""
        for block in self.blocks():
            numbers = block["frame"].to_numpy()
            starts = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
            for start, end in itertools.pairwise([*starts, len(block)]):
                yield int(numbers[start]), block.iloc[start:end]

    def blocks(self) -> Iterator[pd.DataFrame]:
        """The rows in the order of the frames, in blocks of whole frames."""
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
        rows = min(BLOCK_ROWS, max(1, BLOCK_CELLS // max(len(self.names), 1)))
        chunks: Iterator[pd.DataFrame]
        if isinstance(self.source, pd.DataFrame):
            table = self.source
            chunks = (table.iloc[begin : begin + rows] for begin in range(0, len(table), rows))
        elif is_parquet(self.source):
            chunks = self._parquet_chunks(self.source, rows)
        else:
            chunks = chunks_of_file(self.source, self.names, self.dialect, rows, self.label)
        yield from map(self._converted, chunks)

    def _parquet_chunks(self, path: Path, rows: int) -> Iterator[pd.DataFrame]:
        """The rows in blocks, with an index from 1."""
        start, file = 1, self._parquet_file(path)
        try:
            for batch in file.iter_batches(batch_size=rows):
                batch.validate(full=True)  # finds, for example, invalid UTF-8
                chunk = batch.to_pandas()
                chunk.index = pd.RangeIndex(start, start + len(chunk))
                start += len(chunk)
                yield chunk
        except (*DAMAGED, NotImplementedError) as error:
            raise StereocalError(f"{self.label}: the Parquet file is damaged ({error}).") from error

    def _parquet_file(self, path: Path) -> Any:
        parquet = _parquet_library()
        try:
            return parquet.ParquetFile(path)
        except (*DAMAGED, NotImplementedError) as error:  # pyarrow's own errors are ValueErrors
            raise StereocalError(f"{self.label}: this is not a Parquet file ({error}).") from error

    def _names(self) -> list[str]:
        if isinstance(self.source, pd.DataFrame):
            return [str(name) for name in self.source.columns]
        limits = Limits.from_environment()
        limits.check_size(self.source.stat().st_size, self.label)
        if not is_parquet(self.source):
            return self._csv_names(self.source)
        file = self._parquet_file(self.source)
        limits.check_rows(file.metadata.num_rows, self.label)
        return [str(name) for name in file.schema_arrow.names]

    def _csv_names(self, path: Path) -> list[str]:
        with path.open("rb") as binary:
            head = binary.read(HEAD_CHARACTERS)
        refuse_binary(head, self.label)
        encoding = encoding_of(head)
        with path.open(encoding=encoding, newline="") as file:
            lines = head_of(file.read(HEAD_CHARACTERS))
        if not "".join(lines).strip():
            raise StereocalError(
                f"{self.label}: the file is empty; the first line must name the columns frame, "
                f"{', '.join(self.numbers)}."
            )
        self.dialect = replace(dialect_of(lines), encoding=encoding)
        # A quoted cell may continue on the next line.
        rows = self.dialect.cells("".join(lines[self.dialect.above :]), self.label)
        names, cells = [*map(unquoted, rows[0])], rows[1] if len(rows) > 1 else []
        if len(cells) > len(names):  # pandas would use this width for the table
            raise StereocalError(
                f"{self.label}: 1 row cannot be used: line {self.dialect.above + 2}: {len(cells)} "
                f"cells instead of {len(names)}."
            )
        return names

    def _converted(self, raw: pd.DataFrame) -> pd.DataFrame:
        """Convert the numbers and drop rows without points.

        Raises:
            RefusedRowsError: invalid rows, named by their lines.
        """
        raw.columns = pd.Index(self.names)
        columns = [Column("frame", is_whole=True, most=LARGEST_INTEGER)]
        columns += [Column(name, may_be_empty=self.may_lack) for name in self.numbers]
        columns += [Column(name, may_be_empty=True, is_positive=True) for name in self.sigmas]
        unseen = np.logical_and.reduce([is_missing(raw[name]) for name in self.numbers])
        # Blank lines do not count.
        self._left_out += int((unseen & ~is_missing(raw["frame"])).sum())
        raw = raw[~unseen]
        values, reasons = numbers_in(raw, columns, self.dialect.decimal_comma, MISSING)
        if reasons:
            lines = raw.index.to_numpy()
            problems = [RowProblem(int(lines[row]), reasons[row]) for row in sorted(reasons)]
            raise RefusedRowsError(f"{self.label}: ", problems, "cannot be used")
        numbers = {name: values[name] for name in (*self.numbers, *self.sigmas)}
        further = {name: raw[name] for name in self.further}
        if isinstance(self.source, Path) and not is_parquet(self.source):
            pixels = [values[name] for name in self.numbers]
            refuse_thousands(raw, self.numbers, pixels, self.numbers, self.label)
            further = {name: without_apostrophes(cells) for name, cells in further.items()}
        frames = values["frame"].astype(np.int64)
        return pd.DataFrame({"frame": frames, **numbers, **further}, index=raw.index)


def pixels_of(table: pd.DataFrame, columns: Sequence[str] = POINT) -> FloatArray:
    """(n, 2) raw pixels of a table of points, or (n, k) other columns of numbers.

    Column by column: a table of the columns takes ten times as long to make, for each frame.
    """
    return np.array([table[name].to_numpy(dtype=np.float64) for name in columns]).T


class _OutOfOrderError(Exception):
    """The rows are not in the order of the frames."""


def is_parquet(path: Path) -> bool:
    """Whether a file is Parquet, by its name."""
    return path.suffix.lower() in PARQUET


class TableWriter:
    """Collects rows and writes them in large blocks; created by `open_table`."""

    def __init__(
        self,
        path: Path | None,
        columns: list[str] | None,
        as_parquet: bool,
        passed_on: list[pd.DataFrame] | None,
    ) -> None:
        self._path, self._columns, self._passed_on = path, columns, passed_on
        self._parquet: Any = _parquet_library() if as_parquet else None
        self.file: Any = None
        self._waiting: list[pd.DataFrame] = []
        self._rows = 0

    def add(self, rows: pd.DataFrame) -> None:
        """Append rows; the first ones, perhaps none, begin the table."""
        if len(rows) or (self.file is None and not self._waiting):
            self._waiting.append(rows)
            self._rows += len(rows)
        if self._rows >= WRITTEN_ROWS:
            self.write()

    def write(self) -> None:
        if not self._waiting:
            return
        rows = together(self._waiting)
        rows = rows if self._columns is None else rows.reindex(columns=self._columns)
        begins, self._waiting, self._rows = self.file is None, [], 0
        if self._passed_on is not None:
            self._passed_on.append(rows)
        if self._path is None:
            return
        if self._parquet is None:
            self.file = self._path.open("w", encoding="utf-8", newline="") if begins else self.file
            self.file.write(csv_text(rows, header=begins))
            return
        import pyarrow as pa

        schema = None if begins else self.file.schema
        table = pa.Table.from_pandas(rows, schema=schema, preserve_index=False)
        self.file = self._parquet.ParquetWriter(self._path, table.schema) if begins else self.file
        self.file.write_table(table)


def together(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Tables with the same columns as one."""
    return pd.concat([table for table in tables if len(table)] or tables[:1])


@contextmanager
def open_table(
    path: Path | None, columns: list[str] | None = None, passed_on: list[pd.DataFrame] | None = None
) -> Iterator[TableWriter]:
    """A writer for a new table, CSV or Parquet by its name; the file appears complete at the end,
    or not at all.

    Args:
        path: None: nothing is written, only passed on.
        columns: of the table; None: those of the first rows.
        passed_on: gets the rows that are written.
    """
    with nullcontext() if path is None else write_in_parts(path) as temporary:
        as_parquet = path is not None and is_parquet(path)
        writer = TableWriter(temporary, columns, as_parquet, passed_on)
        try:
            yield writer
            writer.write()
        finally:
            if writer.file is not None:  # Windows cannot remove an open temporary file
                writer.file.close()


def _parquet_library() -> Any:
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise StereocalError(
            "Parquet files need the package pyarrow, which is not installed: use CSV."
        ) from error
    return pyarrow.parquet
