"""Read Parquet tables of points in blocks; needs the optional package pyarrow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from stereocal.errors import DAMAGED, StereocalError
from stereocal.system.limits import Limits

PARQUET = (".parquet", ".pq")
BLOCK_ROWS = 100_000
BLOCK_CELLS = 5_000_000
"""Limit that reduces the rows of a block with many columns."""


def block_rows(names: Sequence[str]) -> int:
    """Rows per block of a table with these columns."""
    return min(BLOCK_ROWS, max(1, BLOCK_CELLS // max(len(names), 1)))


def parquet_names(path: Path, label: str) -> list[str]:
    """The names of the columns."""
    file = _parquet_file(path, label)
    Limits.from_environment().check_rows(file.metadata.num_rows, label)
    return [str(name) for name in file.schema_arrow.names]


def parquet_chunks(path: Path, label: str) -> Iterator[pd.DataFrame]:
    """The rows in blocks, with an index from 1."""
    start = 1
    file = _parquet_file(path, label)
    batches = file.iter_batches(batch_size=block_rows(file.schema_arrow.names))
    while True:
        try:
            batch = next(batches, None)
            if batch is None:
                return
            batch.validate(full=True)  # finds, for example, invalid UTF-8
            chunk = batch.to_pandas().reset_index(drop=True)
        except (*DAMAGED, NotImplementedError) as error:
            raise StereocalError(f"{label}: the Parquet file is damaged ({error}).") from error
        chunk.index += start
        start += len(chunk)
        yield chunk


def parquet_library() -> Any:
    """`pyarrow.parquet`."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise StereocalError(
            "Parquet files need the package pyarrow, which is not installed: use CSV."
        ) from error
    return pyarrow.parquet


def _parquet_file(path: Path, label: str) -> Any:
    parquet = parquet_library()
    try:
        return parquet.ParquetFile(path)
    except (*DAMAGED, NotImplementedError) as error:  # pyarrow's own errors are ValueErrors
        raise StereocalError(f"{label}: this is not a Parquet file ({error}).") from error
