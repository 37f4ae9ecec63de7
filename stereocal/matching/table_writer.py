"""Write a table block by block, as CSV or Parquet depending on its name, atomically."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd

from stereocal.matching.parquet import PARQUET, parquet_library
from stereocal.system.atomic_files import write_in_parts

ROWS_AT_ONCE = 50_000


class TableWriter:
    """Collects rows and writes them in large blocks; created by `open_table`."""

    def __init__(self, path: Path, columns: list[str], is_parquet: bool) -> None:
        self._path = path
        self._columns = columns
        self._parquet: Any = parquet_library() if is_parquet else None
        self._file: Any = None
        self._waiting: list[pd.DataFrame] = []
        self._rows_waiting = 0

    def add(self, rows: pd.DataFrame) -> None:
        """Append rows with the columns of `open_table`."""
        if not len(rows):
            return
        self._waiting.append(rows)
        self._rows_waiting += len(rows)
        if self._rows_waiting >= ROWS_AT_ONCE:
            self._write()

    def close(self) -> None:
        """Write the remaining rows and close the file."""
        if self._waiting or self._file is None:
            self._write()
        self._file.close()

    def _write(self) -> None:
        if self._waiting:
            rows = pd.concat(self._waiting)[self._columns]
        else:
            rows = pd.DataFrame(columns=self._columns)
        self._waiting, self._rows_waiting = [], 0
        if self._parquet is not None:
            self._write_parquet(rows)
            return
        if self._file is None:
            self._file = self._path.open("w", encoding="utf-8", newline="")
            self._file.write(pd.DataFrame(columns=self._columns).to_csv(index=False))
        rows.to_csv(self._file, index=False, header=False, lineterminator="\n")

    def _write_parquet(self, rows: pd.DataFrame) -> None:
        import pyarrow as pa

        if self._file is None:
            table = pa.Table.from_pandas(rows, preserve_index=False)
            self._file = self._parquet.ParquetWriter(self._path, table.schema)
        else:
            table = pa.Table.from_pandas(rows, schema=self._file.schema, preserve_index=False)
        self._file.write_table(table)


@contextmanager
def open_table(path: Path, columns: list[str]) -> Iterator[TableWriter]:
    """A writer for a new table; the file appears complete at the end, or not at all."""
    with write_in_parts(path) as temporary:
        writer = TableWriter(temporary, columns, path.suffix.lower() in PARQUET)
        try:
            yield writer
        except BaseException:
            # Windows cannot remove an open temporary file.
            if writer._file is not None:
                writer._file.close()
            raise
        writer.close()
