"""The table of photograph pairs as the user has edited it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pair, pair_names


@dataclass(frozen=True)
class PairRow:
    """A pair in the table, and whether to use it."""

    pair: Pair
    use: bool = True


def check_rows(rows: Sequence[PairRow], names: Mapping[str, Any]) -> None:
    """Check a table of pairs."""
    frames: set[int] = set()
    taken: set[str] = set()
    for row in rows:
        pair = row.pair
        if pair.frame in frames:
            raise StereocalError(f"Frame {pair.frame} is in two rows: give each its own number.")
        frames.add(pair.frame)
        for name in (pair.primary, pair.secondary):
            if name not in names:
                raise StereocalError(f"Frame {pair.frame}: choose a photograph of either camera.")
            if name in taken:
                raise StereocalError(
                    f"Frame {pair.frame}: {name} belongs to another frame or camera already."
                )
            taken.add(name)


def with_new(kept: Sequence[PairRow], names: Sequence[str]) -> list[PairRow]:
    """The given rows, and the proposed pairs of all other photographs."""
    taken = {name for row in kept for name in (row.pair.primary, row.pair.secondary)}
    frames = {row.pair.frame for row in kept}
    rows = list(kept)
    for pair in pair_names(name for name in names if name not in taken).pairs:
        number = pair.frame if pair.frame not in frames else max(frames) + 1
        frames.add(number)
        rows.append(PairRow(Pair(number, pair.primary, pair.secondary)))
    return rows
