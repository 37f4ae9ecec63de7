"""Pair the photographs of the two cameras by their names: left01, cam0/0001, IMG_7_R and similar.

The word that identifies the camera is blanked out in folder and stem; two names pair if the rest is
equal. The reading that pairs most files is proposed. Photographs are never paired by list position.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath

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
    single: tuple[tuple[str, int], ...]
    rivals: tuple[str, ...]
    """Photographs with the same camera and frame as another."""
    unknown: tuple[str, ...]
    words: tuple[str, str]
    """What identifies the cameras, for messages."""
    merit: tuple[int, int, int]
    """Sort key: more pairs, then the clearer words, then more files with a known camera."""
    reading: "Reading"

    @cached_property
    def alone(self) -> tuple[Alone, ...]:
        """Only of the best of many readings."""
        return tuple(Alone(name, i, _twin_of(name, i, self.reading)) for name, i in self.single)


def pair_names(names: Iterable[str]) -> Pairing:
    """Propose which photographs belong together.

    Args:
        names: file names, with or without folders.

    Returns:
        The reading that pairs most names. A frame's number is the number in the names if it is
        unique; otherwise frames are counted from 1 in the order of the names.
    """
    ordered = sorted(dict.fromkeys(names), key=natural)
    read = [_read(ordered, reading) for reading in _readings(ordered)]
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
    sentence, unknown = _sentence(best, others), best.rivals + best.unknown
    return Pairing(number_pairs(best.pairs), best.alone, unknown, sentence, bool(others))


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


def _read(names: Sequence[str], reading: "Reading") -> _Read:
    sides: dict[str, tuple[list[str], list[str]]] = {}
    unknown = []
    for name in names:
        found = _side_and_key(name, reading)
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
            alone.append(((first or second)[0], int(not first)))
    used = [convention for convention in reading if convention]
    one, other = (" with ".join(dict.fromkeys(own.words[i] for own in used)) for i in (0, 1))
    merit = len(pairs), -min(own.rank for own in used), -len(unknown)
    return _Read(pairs, tuple(alone), tuple(rivals), tuple(unknown), (one, other), merit, reading)


def _sentence(best: _Read, others: Sequence[_Read]) -> str:
    (first, second), alone = best.words, best.alone
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


@dataclass(frozen=True)
class _Convention:
    """Two words that identify the cameras; of conventions that pair as many, low rank wins."""

    words: tuple[str, str]
    patterns: tuple[re.Pattern[str], re.Pattern[str]]
    rank: int
    folders_only: bool = False


Reading = tuple[_Convention | None, _Convention | None]
"""The convention used in the folder and in the stem of a name; at least one is not None."""


def _word(one: str, other: str, rank: int) -> _Convention:
    """Whole words; they may be followed by a number, "cam" or "image"."""
    after = r"(?=[^a-z]|$|cam|ima?g)" if len(one) > 1 else r"(?![a-z])"
    first, second = (re.compile(rf"(?<![a-z]){word}{after}") for word in (one, other))
    return _Convention((one, other), (first, second), rank)


def _numbered(prefix: str, first: int, rank: int) -> _Convention:
    """A word and a camera's number: cam0 and cam1, camera_01 and camera_02."""
    one, other = (
        re.compile(rf"(?<![a-z]){prefix}[ _-]?0*{number}(?![0-9])") for number in (first, first + 1)
    )
    return _Convention((f"{prefix}{first}", f"{prefix}{first + 1}"), (one, other), rank)


def _folder(prefix: str, first: int) -> _Convention:
    """A numbered folder: image_0/ and image_1/, or 0/ and 1/."""
    one, other = (
        re.compile(rf"(?:(?<=/)|^){prefix}_?0*{number}(?=/|$)") for number in (first, first + 1)
    )
    shown = f"{prefix}_" if prefix else ""
    return _Convention((f"{shown}{first}/", f"{shown}{first + 1}/"), (one, other), 3, True)


CONVENTIONS = (
    _word("primary", "secondary", 0),
    _word("left", "right", 1),
    *(_numbered(prefix, first, 1) for prefix in ("cam", "camera") for first in (0, 1, 2)),
    _word("cama", "camb", 1),
    _word("l", "r", 2),
    *(_numbered(prefix, first, 2) for prefix in ("c", "view", "sensor") for first in (0, 1)),
    _word("a", "b", 3),
    *(_folder(prefix, first) for prefix in ("image", "img", "") for first in (0, 1, 2)),
)


def _readings(names: Sequence[str]) -> list[Reading]:
    """The combinations of folder and stem conventions of which both words occur."""
    folders, stems = (
        [
            convention
            for convention in CONVENTIONS
            if all(any(map(pattern.search, parts)) for pattern in convention.patterns)
        ]
        for parts in ({_split(name)[part] for name in names} for part in (0, 1))
    )
    stems = [convention for convention in stems if not convention.folders_only]
    return [(folder, stem) for folder in (None, *folders) for stem in (None, *stems)][1:]


def _side_and_key(name: str, reading: Reading) -> tuple[int, str] | None:
    """The camera (0 or 1) and the name without its word; None if the name identifies no camera."""
    found, blanked = [], []
    for part, convention in zip(_split(name), reading, strict=True):
        if convention is None:
            blanked.append(part)
            continue
        hits = [
            (hit.start(), side)
            for side, pattern in enumerate(convention.patterns)
            for hit in pattern.finditer(part)
        ]
        if not hits:
            return None
        # In a name with both words, as stereo_left_right_left7, the last one counts.
        at, side = max(hits)
        mixed = len({side for _, side in hits}) > 1
        begin, end = (part[:at], part[at:]) if mixed else ("", part)
        blanked.append(begin + convention.patterns[side].sub("*", end))
        found.append(side)
    return (found[0], "/".join(blanked)) if len(set(found)) == 1 else None


def _twin_of(name: str, side: int, reading: Reading) -> str:
    """The expected name of the other camera's photograph."""
    path = PurePosixPath(name.replace("\\", "/"))
    parts = [path.parent.as_posix(), path.stem]
    for i, convention in enumerate(reading):
        if convention is None:
            continue
        for hit in reversed(list(convention.patterns[side].finditer(parts[i].lower()))):
            written = parts[i][hit.start() : hit.end()]
            new = _exchanged(written, convention.words[1 - side])
            parts[i] = parts[i][: hit.start()] + new + parts[i][hit.end() :]
    folder = "" if parts[0] == "." else parts[0] + "/"
    return f"{folder}{parts[1]}{path.suffix}"


def _split(name: str) -> tuple[str, str]:
    """Folder and stem, in lower case."""
    path = PurePosixPath(name.replace("\\", "/").lower())
    return path.parent.as_posix().lstrip("."), path.stem


def _exchanged(written: str, word: str) -> str:
    """The other camera's word, with the case and leading zeros of `written`."""
    number = re.search(r"\d+", word)
    digits = re.search(r"\d+$", written)
    if number and digits:
        return written[: digits.start()] + number[0].zfill(len(digits[0]))
    if written.isupper():
        return word.upper()
    return word.capitalize() if written[0].isupper() else word
