"""How names tell the two cameras apart: left01, cam0/0001, IMG_7_R, IMG_1001 and DSC_0231.

The word that identifies the camera is blanked out in folder and stem; what is left is the key of
the frame. Words that are known (`readings_by_words`) tell which camera is the primary; where two
folders, two beginnings or two numbers of a name divide the photographs (`readings_by_divisions`),
the first given is.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import PurePosixPath

SideAndKey = tuple[int, str]
"""The camera (0 or 1), and the name without its word."""


@dataclass(frozen=True, eq=False)
class NameReading:
    """One way to read the names."""

    words: tuple[str, str]
    """What identifies the cameras, for messages."""
    rank: int
    """The lowest of readings that pair as many wins."""
    side_and_key: Mapping[str, SideAndKey]
    """The camera and the key of each name; a name that identifies no camera is missing."""
    twin: Callable[[str, int], str]
    """From a name and its camera to the expected name of the other camera's photograph."""

    def exchanged(self) -> "NameReading":
        """With the other camera as the primary."""
        first, second = self.words
        by_name = {name: (1 - side, key) for name, (side, key) in self.side_and_key.items()}
        return NameReading((second, first), self.rank, by_name, lambda n, i: self.twin(n, 1 - i))


FOLDERS, BEGINNINGS, NUMBERS = 4, 5, 6
"""Ranks of the divisions; those of the conventions are below."""


@dataclass(frozen=True)
class _Convention:
    """Two words that identify the cameras."""

    words: tuple[str, str]
    patterns: tuple[re.Pattern[str], re.Pattern[str]]
    rank: int
    folders_only: bool = False


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
    *(_numbered(prefix, first, 1) for prefix in ("cam", "camera", "gopro") for first in (0, 1, 2)),
    _word("cama", "camb", 1),
    _word("l", "r", 2),
    *(_numbered(prefix, first, 2) for prefix in ("c", "view", "sensor") for first in (0, 1)),
    _word("a", "b", 3),
    *(_folder(prefix, first) for prefix in ("image", "img", "") for first in (0, 1, 2)),
)
_Used = tuple[_Convention | None, _Convention | None]
"""The convention used in the folder and in the stem of a name; at least one is not None."""


def readings_by_words(names: Sequence[str]) -> list[NameReading]:
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
    both: list[_Used] = [(folder, stem) for folder in (None, *folders) for stem in (None, *stems)]
    return [_by_words(names, used) for used in both[1:]]


def _by_words(names: Sequence[str], used: _Used) -> NameReading:
    conventions = [convention for convention in used if convention]
    one, other = (
        " with ".join(dict.fromkeys(convention.words[i] for convention in conventions))
        for i in (0, 1)
    )
    read = {name: _side_and_key(name, used) for name in names}
    by_name = {name: known for name, known in read.items() if known is not None}
    return NameReading(
        (one, other),
        min(convention.rank for convention in conventions),
        by_name,
        partial(_twin_of, used),
    )


def _side_and_key(name: str, used: _Used) -> SideAndKey | None:
    """The camera and the name without its word; None if the name identifies no camera."""
    sides, blanked = [], []
    for part, convention in zip(_split(name), used, strict=True):
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
        start, side = max(hits)
        mixed = len({side for _, side in hits}) > 1
        begin, end = (part[:start], part[start:]) if mixed else ("", part)
        blanked.append(begin + convention.patterns[side].sub("*", end))
        sides.append(side)
    return (sides[0], _key("/".join(blanked))) if len(set(sides)) == 1 else None


def _twin_of(used: _Used, name: str, side: int) -> str:
    path = PurePosixPath(name.replace("\\", "/"))
    parts = [path.parent.as_posix(), path.stem]
    for i, convention in enumerate(used):
        if convention is None:
            continue
        for hit in reversed(list(convention.patterns[side].finditer(parts[i].lower()))):
            written = parts[i][hit.start() : hit.end()]
            new = _exchanged(written, convention.words[1 - side])
            parts[i] = parts[i][: hit.start()] + new + parts[i][hit.end() :]
    folder = "" if parts[0] == "." else parts[0] + "/"
    return f"{folder}{parts[1]}{path.suffix}"


def _exchanged(written: str, word: str) -> str:
    """The other camera's word, with the case and leading zeros of `written`."""
    number = re.search(r"\d+", word)
    digits = re.search(r"\d+$", written)
    if number and digits:
        return written[: digits.start()] + number[0].zfill(len(digits[0]))
    if written.isupper():
        return word.upper()
    return word.capitalize() if written[0].isupper() else word


def readings_by_divisions(names: Sequence[str]) -> list[NameReading]:
    """Readings by two folders of any names, two beginnings of names, or two numbers in them."""
    paths = {name: PurePosixPath(name.replace("\\", "/")) for name in names}
    depth = max((len(path.parts) for path in paths.values()), default=1) - 1
    levels = [
        {n: p.parts[level] if level < len(p.parts) - 1 else "" for n, p in paths.items()}
        for level in range(depth)
    ]
    readings = []
    for level, folders in enumerate(levels):
        rest = _joined(
            [*levels[:level], *levels[level + 1 :], {n: p.stem for n, p in paths.items()}]
        )
        readings += _divided(folders, rest, FOLDERS, "{}/", partial(_in_folder, level))
    digits = {name: re.findall("[0-9]+", path.stem) for name, path in paths.items()}
    forms = {name: re.sub("[0-9]+", "#", path.stem) for name, path in paths.items()}

    def divide(words: Mapping[str, str], rest: Mapping[str, str], rank: int) -> list[NameReading]:
        # Folders that divide them alike are left out of the key.
        others = [one for one in levels if len({(words[n], one[n]) for n in names}) > 2]
        return _divided(words, _joined([*others, rest]), rank, "{}", lambda *_: "")

    readings += divide(forms, {n: "_".join(numbers) for n, numbers in digits.items()}, BEGINNINGS)
    if len({form.lower() for form in forms.values()}) == 1:
        for place in range(min(map(len, digits.values()), default=0)):
            rest = {
                n: "_".join([*numbers[:place], "*", *numbers[place + 1 :]])
                for n, numbers in digits.items()
            }
            readings += divide(
                {name: numbers[place] for name, numbers in digits.items()}, rest, NUMBERS
            )
    return readings


def _joined(parts: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """The parts of each name's path as one word."""
    return {name: "/".join(part[name] for part in parts) for name in parts[0]}


def _divided(
    words: Mapping[str, str],
    keys: Mapping[str, str],
    rank: int,
    shown: str,
    twin: Callable[[str, str], str],
) -> list[NameReading]:
    """The reading by words, by name, if there are two of them."""
    spelling = {word.lower(): word for word in words.values()}
    if len(spelling) != 2:
        return []
    order = sorted(spelling, key=int) if rank == NUMBERS else list(spelling)
    by_name = {name: (order.index(word.lower()), _key(keys[name])) for name, word in words.items()}

    def other(name: str, side: int) -> str:
        return twin(name, spelling[order[1 - side]])

    one, two = (shown.format(spelling[word]).strip("#") or "no folder" for word in order)
    return [NameReading((one, two), rank, by_name, other)]


def _in_folder(level: int, name: str, folder: str) -> str:
    parts = [*PurePosixPath(name.replace("\\", "/")).parts]
    inserted = [folder] if folder else []
    return "/".join(parts[:level] + inserted + parts[level + (len(parts) - 1 > level) :])


def _key(text: str) -> str:
    """The same for names that differ in capitals, spaces or leading zeros only."""
    return re.sub(r"(?<![0-9])0+(?=[0-9])", "", re.sub(r"[ _-]+", "_", text.lower()))


def _split(name: str) -> tuple[str, str]:
    """Folder and stem, in lower case."""
    path = PurePosixPath(name.replace("\\", "/").lower())
    return path.parent.as_posix().lstrip("."), path.stem
