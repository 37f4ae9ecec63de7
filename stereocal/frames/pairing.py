"""Pair the photographs of the two cameras by their names.

The word that identifies the camera is blanked out in folder and stem; two names pair if the rest is
equal. The reading that pairs most files is proposed. Photographs are never paired by list position.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from stereocal.frames.naming import Reading, candidates, side_and_key, twin_of
from stereocal.rig.camera import CAMERAS

MAXIMUM_DIGITS = 15
"""Of a frame number, so that a table stores it exactly."""


@dataclass(frozen=True)
class Pair:
    """Two photographs of one moment."""

    frame: int
    primary: str
    secondary: str


@dataclass(frozen=True)
class Alone:
    """A photograph whose camera is known and whose partner is missing."""

    name: str
    camera: int
    """0 primary, 1 secondary."""
    twin: str
    """The expected name of the missing photograph."""

    def __str__(self) -> str:
        return f"{self.name} ({CAMERAS[self.camera]}) has no partner {self.twin}"


@dataclass(frozen=True)
class Pairing:
    """The proposed pairs, in order of their frames, and the unpaired photographs."""

    pairs: tuple[Pair, ...]
    alone: tuple[Alone, ...]
    unknown: tuple[str, ...]
    """Photographs whose names identify no camera, or the same camera and frame as another."""
    sentence: str
    """How the names were paired, for the user to check."""
    ambiguous: bool
    """Whether another reading of the names pairs as many, but differently."""


@dataclass(frozen=True)
class _Read:
    """All names under one reading."""

    pairs: Mapping[str, tuple[str, str]]
    """The two names of each pair, by their common part."""
    alone: tuple[tuple[str, int], ...]
    rivals: tuple[str, ...]
    """Photographs with the same camera and frame as another."""
    unknown: tuple[str, ...]
    reading: Reading

    @property
    def merit(self) -> tuple[int, int, int]:
        """Sort key: more pairs, then the clearer words, then more files with a known camera."""
        rank = min(convention.rank for convention in self.reading if convention)
        return len(self.pairs), -rank, -len(self.unknown)

    @property
    def words(self) -> tuple[str, str]:
        """The words that identify the cameras, for messages."""
        shown = [convention.words for convention in self.reading if convention]
        first, second = (" with ".join(dict.fromkeys(w[i] for w in shown)) for i in (0, 1))
        return first, second


def pair_names(names: Iterable[str]) -> Pairing:
    """Propose which photographs belong together.

    Args:
        names: file names, with or without folders.

    Returns:
        The reading that pairs most names. A frame's number is the number in the names if it is
        unique; otherwise frames are counted from 1 in the order of the names.
    """
    ordered = sorted(dict.fromkeys(names), key=natural)
    read = [_read(ordered, reading) for reading in candidates(ordered)]
    if not read:
        what = "one photograph" if ordered else "no photograph"
        why = f"No pair: there is {what}; each frame needs one from each camera."
        if len(ordered) > 1:
            why = (
                f"None of the {len(ordered)} photographs could be paired by name. Give both "
                "photographs of a frame the same name, apart from the camera, as left07 and "
                "right07, or the same name in folders primary and secondary."
            )
        return Pairing((), (), tuple(ordered), why, ambiguous=False)
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
        pairs: the two names of each pair, by their common part.
    """
    keys = sorted(pairs, key=natural)
    digits = [re.findall("[0-9]+", key)[::-1] for key in keys]
    frames = list(range(1, len(keys) + 1))
    for place in range(min(map(len, digits), default=0)):
        texts = [groups[place] for groups in digits]
        numbers = [int(text) for text in texts if len(text) <= MAXIMUM_DIGITS]
        if len(set(numbers)) == len(keys):
            frames = numbers
            break
    made = [Pair(frame, *pairs[key]) for frame, key in zip(frames, keys, strict=True)]
    return tuple(sorted(made, key=lambda pair: pair.frame))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """The key that sorts img9 before img10."""
    parts = re.split("([0-9]+)", name.lower())
    # Python converts at most 4300 digits to a number.
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
    count = len(best.pairs)
    sentences = [
        f'{count or "No"} pair{"s" * (count != 1)} by name: "{first}" marks the primary camera\'s '
        f'photographs, "{second}" the secondary\'s.'
    ]
    if alone:
        missing = "; ".join(map(str, alone[:3]))
        more = f"; and {len(alone) - 3} more" if len(alone) > 3 else ""
        sentences.append(f"{missing}{more}.")
    if best.rivals:
        sentences.append(f"Several files have the same camera and frame: {_listed(best.rivals)}.")
    if best.unknown:
        sentences.append(f"These names identify no camera: {_listed(best.unknown)}.")
    for other in others[:1]:
        one, two = other.words
        sentences.append(
            f"The names can also be read with {one} and {two} as the two cameras: check the pairs."
        )
    return " ".join(sentences)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
