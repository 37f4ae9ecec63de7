"""Which camera does a file belong to? From its folder and name, else from the files it goes with.

What names do not tell is asked about: for each series of names that go on from one to the next, as
`IMG_1001` to `IMG_1025`, once.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from types import MappingProxyType

from stereocal.frames.pairing import natural, pair_names
from stereocal.frames.sides import sides_of
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.taken import Taken

_SEPARATE = r"(?<![a-z])(?:{})(?![a-z])"
ALONE: Mapping[CameraName, re.Pattern[str]] = {
    "primary": re.compile(_SEPARATE.format("primary|left|cam(?:era)?[ _-]?a|l")),
    "secondary": re.compile(_SEPARATE.format("secondary|right|cam(?:era)?[ _-]?b|r")),
}
"""Words that tell the camera of a file without one of the other camera beside it. Numbers do not:
`cam1` is the first of 1 and 2, and the second of 0 and 1."""
_NUMBERED = re.compile(r"(?<![a-z])(?:cam(?:era)?|gopro|view|sensor)[ _-]?0*([0-9]{1,3})(?![0-9])")
_SUFFIX = re.compile(r"[ _.-]0*([0-3])$")
ALIKE = 0.3
"""Two cameras took at least this part of all photographs each."""
SMALL = 0.2
"""A series with fewer files than this part of the largest is no camera's."""


@dataclass(frozen=True)
class Series:
    """Files of one camera, in natural order."""

    names: tuple[str, ...]

    def __str__(self) -> str:
        first, last = (PurePosixPath(self.names[k]).stem for k in (0, -1))
        if len(self.names) == 1:
            return PurePosixPath(self.names[0]).name
        return f"{first} to {last} ({len(self.names)})"


@dataclass(frozen=True)
class WhichCamera:
    """The camera of each file."""

    known: Mapping[str, CameraName]
    open: tuple[Series, ...]
    """Those whose camera is to be asked: two, of one camera each; or one, or many."""
    folders: Mapping[str, str] = field(default_factory=dict)
    """New names, in folders `primary` and `secondary`, of those whose own words do not tell."""


def which_camera(
    names: Iterable[str],
    known: Mapping[str, CameraName] | None = None,
    one_by_one: bool = False,
    taken: Mapping[str, Taken] = MappingProxyType({}),
) -> WhichCamera:
    """The camera of each file.

    Args:
        names: with folders, if there are any.
        known: further files whose cameras are known, which the same words may name.
        one_by_one: every file is a series of its own: a video, a camera file.
        taken: what photographs say of themselves, by name.
    """
    ordered, known = sorted(dict.fromkeys(names), key=natural), dict(known or {})
    side_of = _by_words(ordered, known)
    worded = {*side_of}
    rest = [name for name in ordered if name not in side_of]
    side_of |= _by_likeness(rest, {**known, **side_of})
    rest = [name for name in rest if name not in side_of]
    series = tuple(Series((name,)) for name in rest) if one_by_one else _series(rest, taken)[0]
    if (side := _other_side(series, {**known, **side_of})) is not None:
        side_of |= dict.fromkeys(series[0].names, side)
        series = ()
    folders = {name: f"{side}/{name}" for name, side in side_of.items() if name not in worded}
    return WhichCamera(side_of, series, folders)


def _by_words(names: Sequence[str], known: Mapping[str, CameraName]) -> dict[str, CameraName]:
    """From the words of both cameras (left and right), a last number, or a word alone."""
    every = [*names, *known]
    side_of: dict[str, CameraName] = {}
    pairing = pair_names(every)
    for pair in pairing.pairs:
        side_of |= {pair.primary: "primary", pair.secondary: "secondary"}
    side_of |= {alone.name: CAMERAS[alone.camera] for alone in pairing.alone}
    # What is known decides: a reading that contradicts it is none.
    if any(side_of.get(name, side) != side for name, side in known.items()):
        side_of = {}
    if len(side_of) < len(every):
        side_of |= {name: side for name, side in pair_by_last_number(every).items() if not side_of}
        side_of |= _by_words_alone([name for name in every if name not in side_of])
    return {name: side_of[name] for name in names if name in side_of}


def pair_by_last_number(names: Sequence[str]) -> dict[str, CameraName]:
    """`07_0` and `07_1`: a last number that is one of two in all names, which are alike before it;
    empty if this is not so."""
    read = {name: _SUFFIX.search(PurePosixPath(name).stem) for name in names}
    hits = {name: hit for name, hit in read.items() if hit}
    numbers = sorted({int(hit[1]) for hit in hits.values()})
    if len(hits) < len(names) or len(numbers) != 2 or numbers[1] - numbers[0] != 1:
        return {}
    sides: dict[CameraName, set[str]] = {"primary": set(), "secondary": set()}
    side_of = {n: CAMERAS[numbers.index(int(hit[1]))] for n, hit in hits.items()}
    for name, hit in hits.items():
        sides[side_of[name]].add(f"{PurePosixPath(name).parent}/{hit.string[: hit.start()]}")
    both = sides["primary"] & sides["secondary"]
    return side_of if 2 * len(both) >= max(map(len, sides.values())) else {}


def _by_words_alone(names: Sequence[str]) -> dict[str, CameraName]:
    """From a word in each name. Where the names of one camera go on in two ways, as in `right
    wing/IMG_1` and `right wing/DSC_1`, the word means something else."""
    side_of = {name: side for name in names if (side := _by_word_alone(name)) is not None}
    clear = set[CameraName]()
    for side in CAMERAS:
        sizes = [
            len(lot)
            for lot in _lots(n for n, its_side in side_of.items() if its_side == side).values()
        ]
        if sum(size > 1 and size >= SMALL * max(sizes) for size in sizes) < 2:
            clear.add(side)
    return {name: side for name, side in side_of.items() if side in clear}


def _by_word_alone(name: str) -> CameraName | None:
    """From a word in the stem, else in the folders from the last one."""
    path = PurePosixPath(name.replace("\\", "/").lower())
    for part in (path.stem, *reversed(path.parent.parts)):
        hits = [side for side, words in ALONE.items() if words.search(part)]
        if hits:
            return hits[0] if len(hits) == 1 else None
    return None


def _by_likeness(names: Sequence[str], known: Mapping[str, CameraName]) -> dict[str, CameraName]:
    """Files called like those of one camera, and not like the other's: `DSC.json` like
    `secondary/DSC_0231.jpg` beside `primary/IMG_1001.jpg`."""
    first, second = _first_words(known)
    if not first or not second:
        return {}
    words_of: dict[CameraName, set[str]] = {"primary": first - second, "secondary": second - first}
    return {n: side for n in names for side, words in words_of.items() if _first_word(n) in words}


def _other_side(series: Sequence[Series], known: Mapping[str, CameraName]) -> CameraName | None:
    """The camera of the only series: that which has no files yet, if the other's are called
    otherwise."""
    words = _first_words(known)
    given = [side for side, first_words in zip(CAMERAS, words, strict=True) if first_words]
    if len(series) != 1 or len(given) != 1 or len({*known.values()}) != 1:
        return None
    series_words = {_first_word(name) for name in series[0].names}
    taken = words[CAMERAS.index(given[0])]
    other = CAMERAS[1 - CAMERAS.index(given[0])]
    return other if series_words - {""} and not series_words & taken else None


def _first_words(known: Mapping[str, CameraName]) -> tuple[set[str], set[str]]:
    first, second = ({_first_word(n) for n, side in known.items() if side == s} for s in CAMERAS)
    return first - {""}, second - {""}


def _first_word(name: str) -> str:
    """The letters that a name begins with; a single letter says nothing."""
    hit = re.match(r"[^\W\d_]{2,}", PurePosixPath(name).stem.lower())
    return hit[0] if hit else ""


def series_of(names: Sequence[str]) -> tuple[Series, ...]:
    """The series of names that are told apart by no more than their names; all are in one."""
    series, odd = _series(names, {})
    return (*series, *(Series((name,)) for name in odd))


def _series(
    names: Sequence[str], taken: Mapping[str, Taken]
) -> tuple[tuple[Series, ...], tuple[str, ...]]:
    """The series of names, and names that are of none.

    Names that differ in their last number only are one series, unless `sides_of` divides them: by
    the camera that took them, or by numbers that jump once.
    """
    lots = [sorted(lot) for lot in _lots(names).values()]
    most = max(map(len, lots), default=0)
    kept = [tuple(name for _, name in lot) for lot in lots if len(lot) >= SMALL * most]
    if len(kept) == 1:
        said = {name: taken.get(name, Taken()) for name in kept[0]}
        sides = sides_of(said, ())
        if sides is not None and min(map(len, sides.cameras)) >= ALIKE * len(kept[0]):
            kept = [*sides.cameras]
    odd = {*names} - {name for lot in kept for name in lot}
    return tuple(map(Series, kept)), tuple(name for name in names if name in odd)


def _lots(names: Iterable[str]) -> dict[str, list[tuple[int, str]]]:
    """Names that differ in their last number only, with that number."""
    lots: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        path = PurePosixPath(name)
        hits = [*re.finditer("[0-9]+", path.stem)]
        hit = hits[-1] if hits else None
        blanked = (
            path.stem if hit is None else f"{path.stem[: hit.start()]}#{path.stem[hit.end() :]}"
        )
        number = 0 if hit is None else int(hit[0][-15:])
        lots.setdefault(f"{path.parent}/{blanked}".lower(), []).append((number, name))
    return lots


def numbered_cameras(names: Iterable[str]) -> dict[str, list[str]]:
    """The files of three cameras and more, `cam01` to `cam04`, that folders or names number.

    Empty if a name has no number, there are fewer cameras, or the number counts the files.
    """
    by_number: dict[int, dict[str, str]] = {}
    for name in names:
        path = PurePosixPath(name.replace("\\", "/").lower())
        hits = (_NUMBERED.search(part) for part in (path.stem, *reversed(path.parent.parts)))
        hit = next((hit for hit in hits if hit), None)
        if hit is None:
            return {}
        by_number.setdefault(int(hit[1]), {})[name] = hit[0]
    counts = [len(of_camera) for of_camera in by_number.values()]
    if len(by_number) < 3 or min(counts) < max(2, SMALL * max(counts)):
        return {}
    return {
        next(iter(by_number[number].values())): [*by_number[number]] for number in sorted(by_number)
    }


def which_of(names: Iterable[str], cameras: Sequence[str]) -> dict[str, str]:
    """The camera of each file among any number of named cameras, by a folder or a part of its name.

    Files whose names tell none or several are not in it.
    """
    camera_of = {}
    for name in names:
        path = PurePosixPath(name.replace("\\", "/").lower())
        for part in (*reversed(path.parent.parts), path.stem):
            hits = [camera for camera in cameras if names_camera(part, camera)]
            if len(hits) == 1:
                camera_of[name] = hits[0]
                break
    return camera_of


def plain_name(camera: str) -> str:
    """Without what stands before a number: `camera_1`, `cam01` and `1` are the same."""
    return re.sub(r"(?:cam(?:era)?)?[\s_.-]*0*(?=.)", "", camera.lower(), count=1)


def names_camera(part: str, camera: str) -> bool:
    """Whether a folder or stem is or contains a camera's name; `cam1` names camera `1`."""
    name, plain = camera.lower(), plain_name(camera)
    if part == name or plain_name(part) == name:
        return True
    word = rf"cam(?:era)?[\s_.-]*0*{plain}" if plain.isdigit() else re.escape(name)
    return re.search(rf"(?<![a-z0-9]){word}(?![a-z0-9])", part) is not None or (
        not plain.isdigit() and re.match(rf"{re.escape(name)}(?![a-z])", part) is not None
    )
