"""What a person decided about the pairs of photographs: how to pair them, and each pair."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from stereocal.errors import StereocalError
from stereocal.frames.pairing import PhotographPair
from stereocal.frames.proposal import Choice, propose
from stereocal.rig.camera import CAMERAS
from stereocal.system.taken import Taken


@dataclass(frozen=True)
class PairRow:
    """A pair in the table, and whether to use it."""

    pair: PhotographPair
    use: bool = True


@dataclass(frozen=True)
class Decided:
    """How to pair, as the user decided it, and the pairs as edited since."""

    choice: Choice = field(default_factory=Choice)
    rows: list[PairRow] | None = None


def renamed(decided: Decided, names: Mapping[str, str]) -> Decided:
    """The decision on photographs that have other names now, by their old ones."""

    def new(name: str) -> str:
        return names.get(name, name)

    def row_of(row: PairRow) -> PairRow:
        pair = replace(row.pair, primary=new(row.pair.primary), secondary=new(row.pair.secondary))
        return replace(row, pair=pair)

    without = tuple(map(new, decided.choice.without))
    rows = None if decided.rows is None else [row_of(row) for row in decided.rows]
    return replace(decided, choice=replace(decided.choice, without=without), rows=rows)


def check_rows(rows: Sequence[PairRow], names: Collection[str]) -> None:
    """Raise a StereocalError unless every photograph is there, and in one frame only."""
    frames, taken = set[int](), set[str]()
    for pair in (row.pair for row in rows):
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


def check_decided(decided: Decided, names: Collection[str]) -> None:
    """Check a decision that was read from a file.

    Raises:
        ValueError: it is not one that a person can have made.
    """
    rows, choice = decided.rows or [], decided.choice
    check_rows(rows, names)
    later = dict.fromkeys(CAMERAS, 0) if choice.later is None else choice.later
    numbers = [*(row.pair.frame for row in rows), *choice.heard.values(), *later.values()]
    if any(abs(number) > 2**53 for number in numbers) or not {*CAMERAS} <= {*later}:
        raise ValueError(choice)


def with_new(kept: Sequence[PairRow], photographs: Mapping[str, Taken]) -> list[PairRow]:
    """The given rows, and the proposed pairs of all other photographs."""
    taken = {name for row in kept for name in (row.pair.primary, row.pair.secondary)}
    rows, frames = list(kept), {row.pair.frame for row in kept}
    new = {name: one for name, one in photographs.items() if name not in taken}
    for pair in propose(new).pairing.pairs:
        number = pair.frame if pair.frame not in frames else max(frames) + 1
        frames.add(number)
        rows.append(PairRow(replace(pair, frame=number)))
    return rows
