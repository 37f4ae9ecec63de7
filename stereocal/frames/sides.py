"""Which camera each photograph is of, and the order in which each camera took its own."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from stereocal.frames.conventions import FOLDERS, NameReading
from stereocal.frames.pairing import natural, short_names
from stereocal.system.taken import Taken

MOST_UNKNOWN = 0.1
"""Share of the photographs whose names identify no camera, at most, to go by the others."""
COUNTER = 10_000
"""After this many photographs a camera's counter begins again."""
LEAST_GAP, MOST_UNEQUAL = 10, 1.5
"""Two runs of numbers are of two cameras if the gap between them is so many times the gaps within,
and their lengths are not more unequal."""


@dataclass(frozen=True)
class Sides:
    """The photographs of the two cameras, each in the order taken."""

    cameras: tuple[tuple[str, ...], tuple[str, ...]]
    unknown: tuple[str, ...]
    """Photographs of neither."""

    def exchanged(self) -> "Sides":
        """With the other camera as the primary."""
        return Sides(self.cameras[::-1], self.unknown)

    @property
    def equal(self) -> bool:
        """Whether both have as many."""
        return len(self.cameras[0]) == len(self.cameras[1])

    @property
    def sentence(self) -> str:
        """Which photographs are whose."""
        first, second = (
            f"{shown[0]} to {shown[-1]}" for shown in (short_names(names) for names in self.cameras)
        )
        return f"Primary: {first}; secondary: {second}."


def sides_of(taken: Mapping[str, Taken], readings: Sequence[NameReading]) -> Sides | None:
    """Divide photographs between two cameras: by words or folders, the camera that the files name,
    the beginnings of the names, the sizes of the images, or two runs of numbers; None if none of
    these does.

    Args:
        taken: what the files say, in the order given.
        readings: of the names.
    """
    whole = [one for one in readings if len(one.side_and_key) == len(taken)]
    most = [one for one in readings if len(one.side_and_key) >= (1 - MOST_UNKNOWN) * len(taken)]
    for reading in sorted((one for one in whole if one.rank <= FOLDERS), key=lambda one: one.rank):
        return _divided({name: side for name, (side, _) in reading.side_and_key.items()}, taken)
    if (by_body := _of_two({name: one.body for name, one in taken.items()})) is not None:
        return _divided(by_body, taken)
    for reading in sorted((*whole, *most), key=lambda one: (-len(one.side_and_key), one.rank)):
        return _divided({name: side for name, (side, _) in reading.side_and_key.items()}, taken)
    sizes = _of_two({name: str(one.size or "") for name, one in taken.items()})
    sides = sizes if sizes is not None else _two_runs([*taken])
    return None if sides is None else _divided(sides, taken)


def in_order_taken(names: Sequence[str], taken: Mapping[str, Taken]) -> list[str]:
    """The photographs of one camera in the order taken: by their own clock, else by number."""
    ordered = _after_rollover(sorted(names, key=natural))
    said = [taken[name] for name in ordered]
    if all(one.source in ("camera", "name") for one in said) and len({o.source for o in said}) == 1:
        return sorted(ordered, key=lambda name: taken[name].seconds or 0.0)
    return ordered


def _divided(side_of: Mapping[str, int], taken: Mapping[str, Taken]) -> Sides | None:
    first, second = (
        tuple(in_order_taken([name for name, side in side_of.items() if side == camera], taken))
        for camera in (0, 1)
    )
    unknown = tuple(name for name in taken if name not in side_of)
    return Sides((first, second), unknown) if first and second else None


def _of_two(values: Mapping[str, str]) -> dict[str, int] | None:
    """Each photograph's side by a value of it, if there are two, and all photographs have one."""
    kinds = list(dict.fromkeys(values.values()))
    if len(kinds) != 2 or not all(kinds):
        return None
    return {name: kinds.index(value) for name, value in values.items()}


def _numbers(names: Sequence[str]) -> list[int] | None:
    """The last number in each name, if all have one and the names are alike but for it."""
    matches = [re.fullmatch(r"(.*?)(\d{1,15})(\D*)", name) for name in names]
    if not all(matches) or len({(one[1], one[3]) for one in matches if one}) != 1:
        return None
    return [int(one[2]) for one in matches if one]


def _after_rollover(ordered: list[str]) -> list[str]:
    """Names in natural order, begun after the gap of a counter that began again."""
    numbers: Any = _numbers(ordered)
    if numbers is None or len(numbers) < 2 or not COUNTER / 2 < numbers[-1] < COUNTER:
        return ordered
    gaps = [after - before for before, after in pairwise(numbers)]
    start = gaps.index(max(gaps)) + 1
    return ordered[start:] + ordered[:start] if gaps[start - 1] > COUNTER / 2 else ordered


def _two_runs(names: Sequence[str]) -> dict[str, int] | None:
    """Two cameras of one make in one folder: IMG_1001 to IMG_1025, and IMG_4310 to IMG_4334."""
    ordered = sorted(names, key=natural)
    numbers: Any = _numbers(ordered)
    if numbers is None or len(numbers) < 4:
        return None
    gaps = sorted(
        ((after - before, k + 1) for k, (before, after) in enumerate(pairwise(numbers))),
        reverse=True,
    )
    (largest, split), (next_largest, _) = gaps[:2]
    lengths = sorted((split, len(ordered) - split))
    if largest < LEAST_GAP * next_largest or lengths[1] > MOST_UNEQUAL * lengths[0]:
        return None
    if numbers[-1] - numbers[0] > COUNTER - LEAST_GAP * next_largest and numbers[-1] < COUNTER:
        return None  # one camera, whose counter began again
    given = {name: k for k, name in enumerate(names)}
    first = ordered[:split] if given[ordered[0]] < given[ordered[split]] else ordered[split:]
    return {name: int(name not in first) for name in names}
