"""Identify the camera from a photograph's name: left01, cam0/0001, IMG_7_R and similar."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import PurePosixPath


@dataclass(frozen=True)
class Convention:
    """Two words that identify the cameras; of conventions that pair as many, low rank wins."""

    words: tuple[str, str]
    patterns: tuple[re.Pattern[str], re.Pattern[str]]
    rank: int
    folders_only: bool = False


Reading = tuple[Convention | None, Convention | None]
"""The convention used in the folder and in the stem of a name; at least one is not None."""


def _word(one: str, other: str, rank: int) -> Convention:
    """Whole words; they may be followed by a number, "cam" or "image"."""
    after = r"(?=[^a-z]|$|cam|ima?g)" if len(one) > 1 else r"(?![a-z])"
    first, second = (re.compile(rf"(?<![a-z]){word}{after}") for word in (one, other))
    return Convention((one, other), (first, second), rank)


def _numbered(prefix: str, first: int, rank: int) -> Convention:
    """A word and a camera's number: cam0 and cam1, camera_01 and camera_02."""
    one, other = (
        re.compile(rf"(?<![a-z]){prefix}[ _-]?0*{number}(?![0-9])") for number in (first, first + 1)
    )
    return Convention((f"{prefix}{first}", f"{prefix}{first + 1}"), (one, other), rank)


def _folder(prefix: str, first: int) -> Convention:
    """A numbered folder: image_0/ and image_1/, or 0/ and 1/."""
    one, other = (
        re.compile(rf"(?:(?<=/)|^){prefix}_?0*{number}(?=/|$)") for number in (first, first + 1)
    )
    shown = f"{prefix}_" if prefix else ""
    return Convention((f"{shown}{first}/", f"{shown}{first + 1}/"), (one, other), 3, True)


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


def candidates(names: Sequence[str]) -> list[Reading]:
    """The combinations of folder and stem conventions of which both words occur."""
    split = [_split(name) for name in names]
    folders, stems = {folder for folder, _ in split}, {stem for _, stem in split}

    def useful(parts: set[str], is_folder: bool) -> list[Convention | None]:
        found = [
            convention
            for convention in CONVENTIONS
            if (is_folder or not convention.folders_only)
            and all(any(map(pattern.search, parts)) for pattern in convention.patterns)
        ]
        return [None, *found]

    return [
        (folder, stem)
        for folder, stem in product(useful(folders, True), useful(stems, False))
        if folder or stem
    ]


def side_and_key(name: str, reading: Reading) -> tuple[int, str] | None:
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


def twin_of(name: str, side: int, reading: Reading) -> str:
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
