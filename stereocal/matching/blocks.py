"""Blocks of large tables, and their serialisation for checkpoints."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.rig.compiled import FloatArray


@dataclass(frozen=True, eq=False)
class TableBlock:
    """The result of one block."""

    rows: pd.DataFrame | str
    """Rows of the output table, as a table or as lines of CSV."""
    numbers: FloatArray
    """(n,): counts or errors."""
    others: pd.DataFrame | None = None
    """Rows of a second table, not stored in checkpoints."""

    def as_lines(self, columns: Sequence[str]) -> TableBlock:
        """The same with lines of CSV, which can be stored."""
        if isinstance(self.rows, str):
            return self
        rows = self.rows[list(columns)] if len(self.rows) else pd.DataFrame()
        text = rows.to_csv(index=False, header=False, lineterminator="\n") if len(rows) else ""
        return TableBlock(text, self.numbers)


def pack_block(block: TableBlock) -> bytes | None:
    """A block of CSV lines as bytes; None for a block of table rows."""
    if not isinstance(block.rows, str):
        return None
    numbers = io.BytesIO()
    np.save(numbers, block.numbers, allow_pickle=False)
    return b"%d\n" % numbers.tell() + numbers.getvalue() + block.rows.encode()


def unpack_block(content: bytes) -> TableBlock:
    """The block of `pack_block`.

    Raises:
        ValueError, OSError: the content is damaged.
    """
    head, _, rest = content.partition(b"\n")
    length = int(head)
    numbers = np.load(io.BytesIO(rest[:length]), allow_pickle=False)
    return TableBlock(rest[length:].decode(), numbers)
