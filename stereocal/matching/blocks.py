"""Large tables block by block on an executor: in order, a few ahead, and finished ones kept."""

from __future__ import annotations

import io
import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pandas as pd

from stereocal.rig.compiled import FloatArray
from stereocal.system.tasks import Pieces

B = TypeVar("B")


@dataclass(frozen=True, eq=False)
class TableBlock:
    """What was computed of a block."""

    rows: pd.DataFrame | str
    """Rows of the table that is written, or its lines of CSV."""
    numbers: FloatArray
    """(n,): what was counted."""
    others: pd.DataFrame | None = None
    """Rows of a second table; they are not kept."""

    def as_lines(self, columns: Sequence[str]) -> TableBlock:
        """The same with lines of CSV, which can be kept."""
        if isinstance(self.rows, str):
            return self
        rows = self.rows[list(columns)] if len(self.rows) else pd.DataFrame()
        text = rows.to_csv(index=False, header=False, lineterminator="\n") if len(rows) else ""
        return TableBlock(text, self.numbers)


def in_order(
    blocks: Iterator[B],
    key: Callable[[B], str],
    compute: Callable[[B], TableBlock],
    executor: Executor | None,
    pieces: Pieces[TableBlock] | None,
    ahead: int,
) -> Generator[tuple[B, TableBlock], None, None]:
    """Each block with what was computed of it, in order; on the executor, where there is one.

    Args:
        ahead: so many blocks are in memory at once; one without an executor.

    When it is closed, what has not begun is dropped: iterate inside `contextlib.closing`.
    """
    ahead = 1 if executor is None else ahead
    waiting: deque[tuple[B, Future[TableBlock], bool]] = deque()
    try:
        for block in itertools.chain(blocks, itertools.repeat(None, ahead)):
            if block is not None:
                kept = pieces.get(key(block)) if pieces is not None else None
                task = _ready(kept) if kept is not None else _submitted(executor, compute, block)
                waiting.append((block, task, kept is None))
            if waiting and (block is None or len(waiting) >= ahead):
                oldest, task, is_new = waiting.popleft()
                found = task.result()
                if pieces is not None and is_new:
                    pieces.keep(key(oldest), found)
                yield oldest, found
    finally:
        for _, task, _ in waiting:
            task.cancel()


def _submitted(
    executor: Executor | None, compute: Callable[[B], TableBlock], block: B
) -> Future[TableBlock]:
    return _ready(compute(block)) if executor is None else executor.submit(compute, block)


def _ready(found: TableBlock) -> Future[TableBlock]:
    future: Future[TableBlock] = Future()
    future.set_result(found)
    return future


def pack_block(block: TableBlock) -> bytes | None:
    """A block of lines as bytes; None for one of rows."""
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
