"""Blocks of large tables, and their serialisation for checkpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from stereocal.rig.compiled import FloatArray
from stereocal.system.records import pack, unpack


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
    return pack((block.rows, block.numbers)) if isinstance(block.rows, str) else None


def unpack_block(content: bytes) -> TableBlock:
    """The block of `pack_block`; ValueError if the content is damaged."""
    return TableBlock(*unpack(content, tuple[str, FloatArray]))
