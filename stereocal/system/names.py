"""What a name may be, wherever it comes from: a file, a table, a zip, a form.

A label is only shown: of a data set, a project, an upload. It is mended and cut. A name tells
cameras, targets, tracks or photographs apart. It stays as it is, or is refused: cut, two could
become one.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import PurePath
from unicodedata import category, normalize

from stereocal.errors import StereocalError

LONGEST, LONGEST_OF_CAMERA, LONGEST_PATH = 200, 64, 1000
KEPT_END = 20
"""Characters at the end of a label that is cut: the ending of a file's name tells its kind."""
SHOWN = 60
"""Characters of a rejected name that its error message shows."""
MOST_NOTES, SHOWN_NAMES = 3, 12
"""In a note on names of points."""
HIDDEN = ("Cc", "Cs", "Zl", "Zp")
"""Categories of characters that no page, table or message can show: controls, halves of
characters, which JSON allows but UTF-8 does not, ends of lines."""
CALLED = r"cam(?:era)?[ _-]*"
"""Before the name of a camera, in the name of a file: a pattern."""
LETTERS, OTHERS = "LMN", " -_."
"""Characters that names of cameras may have: letters, marks on letters, numbers; and others."""


def word_list(text: str) -> tuple[str, ...]:
    """The words of a text: how tables of names are written."""
    return tuple(text.split())


def can_be_shown(text: object) -> bool:
    """Whether `text` is a string without lone surrogates, which JSON allows but UTF-8 does not."""
    return isinstance(text, str) and text == text.encode("utf-8", "replace").decode()


def label_of(text: str) -> str:
    """What is only shown, as it can be shown: not too long, on one line, valid UTF-8."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST - KEPT_END - 3]}...{text[-KEPT_END:]}"
    if text.isprintable():
        return text
    return "".join(" " if category(sign) in HIDDEN else sign for sign in text)


def check_name(what: str, name: str) -> str:
    """The name, if it can be one: of 1 to `LONGEST` characters that can be shown, without blanks at
    its ends.

    Args:
        what: it is of, as `A target`.
    """
    hidden = not name.isprintable() and any(category(sign) in HIDDEN for sign in name)
    if hidden or not 0 < len(name.strip()) == len(name) <= LONGEST:
        raise StereocalError(
            f"{what} cannot be called {name[:SHOWN]!r}{'...' * (len(name) > SHOWN)}: rename it, "
            f"with 1 to {LONGEST} characters that can be shown, and no blanks at its ends."
        )
    return name


_BETWEEN = re.compile(r"(?<=[^\W\d_])[\s_-]+|[\s_-]+(?=[^\W\d_])")


@dataclass(frozen=True)
class JoinedNames:
    """Names of points in several tables: capitals, and blanks, `_` and `-` beside a letter do not
    tell them apart, but where one table has both."""

    alike: Mapping[str, str] = field(default_factory=dict)
    """Other spellings, each with the name as it came first."""
    apart: tuple[tuple[str, ...], ...] = ()
    """Names of one table that differ in no more."""
    alone: tuple[str, ...] = ()
    """Names that only one of the tables has."""

    @classmethod
    def of(cls, tables: Sequence[Iterable[str]]) -> "JoinedNames":
        names = [dict.fromkeys(filter(None, table)) for table in tables]
        every = dict.fromkeys(name for table in names for name in table)
        spelled: dict[str, list[str]] = {}
        for name in every:
            plain = _BETWEEN.sub("", normalize("NFKC", name).strip()).casefold()
            spelled.setdefault(plain, []).append(name)
        apart, alike = list[tuple[str, ...]](), dict[str, str]()
        for spellings in spelled.values():
            if any(sum(name in table for name in spellings) > 1 for table in names):
                apart.append(tuple(spellings))
            else:
                alike |= dict.fromkeys(spellings[1:], spellings[0])
        seen = Counter(alike.get(name, name) for table in names for name in table)
        alone = tuple(name for name in every if seen[name] == 1) if len(names) > 1 else ()
        return cls(alike, tuple(apart), alone)

    def in_words(self, tables: Mapping[str, Iterable[str]]) -> str:
        """A note on names that stay apart, and on those that only one table has.

        Args:
            tables: the names in each, by what the table is called.
        """
        notes = [
            f"The names {' and '.join(names)} are of different points: one table has both."
            for names in self.apart[:MOST_NOTES]
        ]
        for table, names in tables.items():
            if alone := [name for name in dict.fromkeys(names) if name in self.alone]:
                more = f" and {len(alone) - SHOWN_NAMES} more" * (len(alone) > SHOWN_NAMES)
                notes.append(
                    f"Only {table} has the {'name' if len(alone) == 1 else 'names'} "
                    f"{', '.join(alone[:SHOWN_NAMES])}{more}."
                )
        return " ".join(notes)


def check_path(path: str, source: str) -> str:
    """The name of a file, perhaps with folders, if a disk could have it so."""
    if len(path) > LONGEST_PATH:
        raise StereocalError(
            f"a file is called {path[:SHOWN]!r}...: {len(path):,} characters are too many; rename "
            f"it, with at most {LONGEST_PATH:,}.",
            source,
        )
    return path


def check_camera_names(names: Iterable[str]) -> None:
    """Refuse names that cannot be part of the name of a file, and pairs whose files would be one.

    Raises:
        StereocalError: names the camera.
    """
    names = [*names]
    for name in names:
        known = all(sign in OTHERS or category(sign)[0] in LETTERS for sign in name)
        fits = 0 < len(name.strip(" ")) == len(name) <= LONGEST_OF_CAMERA
        if not (known and fits) or name[0] == ".":
            raise StereocalError(
                f"A camera cannot be called {name[:LONGEST_OF_CAMERA]!r}, since files are named "
                f"after it: rename it, with 1 to {LONGEST_OF_CAMERA} letters, digits, spaces, -, "
                "_ or . (no dot at the beginning)."
            )
    pairs: dict[str, tuple[str, str]] = {}
    for pair in combinations(names, 2):
        other = pairs.setdefault("-".join(pair).casefold(), pair)
        if other != pair:
            raise StereocalError(
                f"The files of the cameras {' and '.join(other)} and those of {' and '.join(pair)} "
                "would have one name: rename a camera."
            )


def named_after(files: Sequence[str], cameras: Sequence[str]) -> dict[str, str]:
    """Whose each of several files is, by the camera in its name: `points_left.csv`, `cam2.csv`.

    Raises:
        StereocalError: a file names no camera or several, or two name the same.
    """
    whose: dict[str, str] = {}
    for file in files:
        stem = PurePath(file).stem
        # "trial_2_cam_1" is of camera 1.
        named = _named_in(stem, cameras, CALLED) or _named_in(stem, cameras)
        if len(named) != 1:
            which = "which camera it is of"
            if named:
                which = f"whether it is of camera {' or '.join(named)}"
            raise StereocalError(
                f"{file}: its name does not tell {which}. Name the files after the cameras, as "
                f"points_{cameras[0]}.csv, or give them one by one."
            )
        if named[0] in whose.values():
            raise StereocalError(
                f"{file}: another file is of camera {named[0]} too. Give them one by one."
            )
        whose[file] = named[0]
    return whose


def _named_in(stem: str, cameras: Sequence[str], before: str = "") -> list[str]:
    """The cameras whose name is a word of a file's name; DeepLabCut goes on behind it.

    Args:
        before: pattern of what stands before it, or it begins with.
    """

    def is_in(camera: str) -> bool:
        prefix = "" if re.match(before, camera, re.IGNORECASE) else before
        word = rf"(?<![^\W_]){prefix}{re.escape(camera)}(?=DLC|[\W_]|$)"
        return re.search(word, stem, re.IGNORECASE) is not None

    named = [*filter(is_in, cameras)]
    return [c for c in named if not any(c != o and c.lower() in o.lower() for o in named)]
