"""Which photograph of one camera belongs to which of the other, by their names.

A name is taken apart into its folder and its stem; in each, a word that tells the camera is blanked
out, and two names pair when the rest is the same. The reading that pairs most files is proposed.
Nothing is ever paired by its place in a list.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from stereocal.frames.naming import Reading, candidates, side_and_key, twin_of
from stereocal.rig.camera import CAMERAS

MOST_DIGITS = 15
"""A frame number must be a whole number that a table keeps exactly."""


@dataclass(frozen=True)
class Pair:
    """Two photographs of one moment."""

    frame: int
    primary: str
    secondary: str


@dataclass(frozen=True)
class Alone:
    """A photograph whose camera is known and whose twin is missing."""

    name: str
    camera: int
    """0 primary, 1 secondary."""
    twin: str
    """What the missing photograph would be called."""

    def __str__(self) -> str:
        return f"{self.name} ({CAMERAS[self.camera]}) has no {self.twin} beside it"


@dataclass(frozen=True)
class Pairing:
    """The proposed pairs, in order of their frames, and what was left over."""

    pairs: tuple[Pair, ...]
    alone: tuple[Alone, ...]
    unknown: tuple[str, ...]
    """Photographs whose names tell no camera, or of which several claim the same place."""
    sentence: str
    """How it was done, for the person who checks it."""
    ambiguous: bool
    """Whether the names can as well be read in another way."""


@dataclass(frozen=True)
class _Read:
    """What one reading makes of all names."""

    pairs: Mapping[str, tuple[str, str]]
    """What the two names have in common, to the two names."""
    alone: tuple[tuple[str, int], ...]
    rivals: tuple[str, ...]
    """Photographs of which several claim the same place."""
    unknown: tuple[str, ...]
    reading: Reading

    @property
    def merit(self) -> tuple[int, int, int]:
        """More pairs first, then the surer words, then more files whose camera is known."""
        rank = min(convention.rank for convention in self.reading if convention)
        return len(self.pairs), -rank, -len(self.unknown)

    @property
    def words(self) -> tuple[str, str]:
        """What tells the cameras, as people write it."""
        shown = [convention.words for convention in self.reading if convention]
        first, second = (" with ".join(dict.fromkeys(w[i] for w in shown)) for i in (0, 1))
        return first, second


def pair_names(names: Iterable[str]) -> Pairing:
    """Propose which photographs belong together.

    Args:
        names: names of files, with or without folders before them.

    Returns:
        The reading of the names that pairs most of them. It is `ambiguous` if another one pairs as
        many, but others. A frame's number is the number in the names, where that tells all pairs
        apart; else the frames are counted from 1 in the order of the names.
    """
    ordered = sorted(dict.fromkeys(names), key=natural)
    read = [_read(ordered, reading) for reading in candidates(ordered)]
    if not read:
        return Pairing((), (), tuple(ordered), _nothing(len(ordered)), ambiguous=False)
    best = max(read, key=lambda one: one.merit)
    others = [
        one
        for one in read
        if best.pairs
        and one.merit[:2] == best.merit[:2]
        and set(one.pairs.values()) != set(best.pairs.values())
    ]
    alone = tuple(Alone(name, side, twin_of(name, side, best.reading)) for name, side in best.alone)
    return Pairing(
        pairs=number_pairs(best.pairs),
        alone=alone,
        unknown=best.rivals + best.unknown,
        sentence=_sentence(best, alone, others),
        ambiguous=bool(others),
    )


def number_pairs(pairs: Mapping[str, tuple[str, str]]) -> tuple[Pair, ...]:
    """Give each pair its frame number.

    Args:
        pairs: what the two names have in common, to the two names.
    """
    keys = sorted(pairs, key=natural)
    digits = [re.findall("[0-9]+", key)[::-1] for key in keys]
    frames = list(range(1, len(keys) + 1))
    for place in range(min(map(len, digits), default=0)):
        texts = [groups[place] for groups in digits]
        numbers = [int(text) for text in texts if len(text) <= MOST_DIGITS]
        if len(set(numbers)) == len(keys):
            frames = numbers
            break
    made = [Pair(frame, *pairs[key]) for frame, key in zip(frames, keys, strict=True)]
    return tuple(sorted(made, key=lambda pair: pair.frame))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """The key that sorts img9 before img10."""
    parts = re.split("([0-9]+)", name.lower())
    # Very long digits are no numbers, and Python refuses to make some of more than 4300.
    return tuple(
        (0, int(part), part) if part.isdigit() and len(part) <= 4000 and i % 2 else (1, 0, part)
        for i, part in enumerate(parts)
        if part
    )


def _read(names: Sequence[str], reading: Reading) -> _Read:
    sides: dict[str, tuple[list[str], list[str]]] = {}
    unknown = []
    for name in names:
        found = side_and_key(name, reading)
        if found is None:
            unknown.append(name)
        else:
            side, key = found
            sides.setdefault(key, ([], []))[side].append(name)
    pairs, alone, rivals = {}, [], []
    for key, (first, second) in sides.items():
        if len(first) == len(second) == 1:
            pairs[key] = (first[0], second[0])
        elif max(len(first), len(second)) > 1:
            rivals += [*first, *second]
        else:
            alone += [(name, side) for side in (0, 1) for name in (first, second)[side]]
    return _Read(pairs, tuple(alone), tuple(rivals), tuple(unknown), reading)


def _sentence(best: _Read, alone: Sequence[Alone], others: Sequence[_Read]) -> str:
    first, second = best.words
    said = [
        f"{_count(len(best.pairs), 'pair')} by name: {first} is the primary camera, {second} the "
        "secondary."
    ]
    if alone:
        missing = "; ".join(map(str, alone[:3]))
        more = f"; and {len(alone) - 3} more" if len(alone) > 3 else ""
        said.append(f"{missing}{more}.")
    if best.rivals:
        said.append(f"Several files claim the same place: {_listed(best.rivals)}.")
    if best.unknown:
        said.append(f"These names tell no camera: {_listed(best.unknown)}.")
    for other in others[:1]:
        one, two = other.words
        said.append(
            f"The names can as well be read with {one} and {two} as the two cameras: check the "
            "pairs."
        )
    return " ".join(said)


def _nothing(given: int) -> str:
    if given < 2:
        what = "one photograph was" if given else "no photograph was"
        return f"No pair: {what} given; each frame needs one of either camera."
    return (
        f"None of the {given} photographs could be paired by name. Name the two of a frame alike "
        "but for the camera, as left07 and right07, or put them into folders primary and secondary "
        "under the same names."
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def _count(n: int, what: str) -> str:
    return f"{'no' if n == 0 else n} {what}{'' if n == 1 else 's'}".capitalize()
