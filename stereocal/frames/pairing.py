"""Photographs of all cameras that belong together, and how the names of two cameras' pair them.

`pair_names` goes by known words only, such as left and right. `frames.proposal` pairs the
photographs of a recording: by name, by the time taken, or in order.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePosixPath

from stereocal.frames.conventions import NameReading, readings_by_words
from stereocal.rig.camera import CAMERAS
from stereocal.system.numbers import count

Moments = Mapping[int, Mapping[str, str]]
"""The photograph by frame and camera."""
MAXIMUM_DIGITS = 15
"""The most digits of a frame number, which a table then stores exactly."""


@dataclass(frozen=True)
class PhotographPair:
    """Two photographs of one moment."""

    frame: int
    primary: str
    secondary: str


def pairs_of(moments: Moments, first: str, second: str) -> tuple[PhotographPair, ...]:
    """The photographs of two cameras."""
    return tuple(
        PhotographPair(frame, files[first], files[second])
        for frame, files in moments.items()
        if first in files and second in files
    )


def moments_of(pairs: Iterable[PhotographPair]) -> Moments:
    """The photographs of two cameras as of a rig."""
    return {p.frame: {CAMERAS[0]: p.primary, CAMERAS[1]: p.secondary} for p in pairs}


@dataclass(frozen=True)
class Alone:
    """A photograph whose camera is known and whose partner is missing."""

    name: str
    camera: int
    """0 primary, 1 secondary."""
    twin: str = ""
    """The expected name of the missing photograph; empty if it is not known."""
    where: str = ""
    """Otherwise where it is missing."""

    def __str__(self) -> str:
        if self.where:
            return f"{short_names([self.name])[0]} has no partner: {self.where}"
        twin = f" {self.twin}" if self.twin else ""
        return f"{self.name} ({CAMERAS[self.camera]}) has no partner{twin}"


@dataclass(frozen=True)
class ByHand:
    """The photographs of cameras that were started by hand: a search finds which belong together,
    by the motion."""

    counts: Mapping[str, Mapping[str, int]]
    """The photographs of each camera, with their numbers in its own count."""
    heard: Mapping[str, float] = field(default_factory=dict)
    """Which of the first camera's photographs the 0 of another is, by the sound of both videos."""

    def moments(self, later: Mapping[str, int]) -> Moments:
        """The photographs that belong together, numbered as the first camera's; where no other
        camera ran, there are none.

        Args:
            later: of each camera, which of the first's photographs its 0 is.
        """
        by_frame: dict[int, dict[str, str]] = {}
        for camera, numbers in self.counts.items():
            for name, number in numbers.items():
                by_frame.setdefault(number + later[camera], {})[camera] = name
        return {frame: files for frame, files in sorted(by_frame.items()) if len(files) > 1}


@dataclass(frozen=True)
class Motion:
    """What the motion tells of cameras that were started by hand."""

    later: Mapping[str, int]
    """Which of the first camera's photographs the 0 of each is."""
    late: Mapping[str, float]
    """The part of a step by which the photographs of each are then later than the first's."""
    exchanged: frozenset[str]
    """Photographs in which the two targets have each other's names."""
    sentence: str
    """How it was found."""


@dataclass(frozen=True)
class Pairing:
    """Which photographs of all cameras belong together, and those without a partner."""

    moments: Moments
    """Those that belong together, in order of their frames."""
    alone: tuple[Alone, ...] = ()
    unknown: tuple[str, ...] = ()
    """Photographs whose names identify no camera, or the same camera and frame as another."""
    sentence: str = ""
    """How the photographs were paired, for the user to check; empty if names of moments tell."""
    ambiguous: bool = False
    """Whether they can as well be paired differently in the same way."""
    by_hand: ByHand | None = None
    """What is given of cameras that were started by hand: a search finds the true moments."""
    motion: Motion | None = None
    """The motion by which a search found them."""

    @property
    def pairs(self) -> tuple[PhotographPair, ...]:
        """The photographs of two cameras that belong together."""
        return pairs_of(self.moments, *CAMERAS)

    def names(self, cameras: Iterable[str]) -> dict[str, list[str]]:
        """The photographs of each camera that are searched, by frame."""
        if self.by_hand is not None:
            return {camera: [*numbers] for camera, numbers in self.by_hand.counts.items()}
        return {
            camera: [files[camera] for files in self.moments.values() if camera in files]
            for camera in cameras
        }

    def told_by(self, motion: Motion) -> "Pairing":
        """What a search found by the motion."""
        if self.by_hand is None:
            return self
        moments, sentence = self.by_hand.moments(motion.later), motion.sentence
        if len(self.by_hand.counts) == 2:
            sentence = f"{count(len(moments), 'pair')} by the motion. {sentence}"
        return Pairing(moments, (), self.unknown, sentence, False, self.by_hand, motion)

    @property
    def complete(self) -> bool:
        """Whether every photograph is in a pair, and in no other way."""
        return bool(self.moments) and not (self.alone or self.unknown or self.ambiguous)


@dataclass(frozen=True)
class _Read:
    """All names under one reading."""

    pairs: Mapping[str, tuple[str, str]]
    """The two names of each pair, by their common part."""
    single: tuple[tuple[str, int], ...]
    rivals: tuple[str, ...]
    """Photographs with the same camera and frame as another."""
    unknown: tuple[str, ...]
    reading: NameReading

    @property
    def merit(self) -> tuple[int, int, int]:
        """Sort key: more pairs, then the clearer words, then more files with a known camera."""
        return len(self.pairs), -self.reading.rank, -len(self.unknown)

    @cached_property
    def alone(self) -> tuple[Alone, ...]:
        """Only of the best of many readings."""
        return tuple(Alone(name, i, self.reading.twin(name, i)) for name, i in self.single)


def pair_names(names: Iterable[str]) -> Pairing:
    """Propose which photographs belong together, by words that identify the camera.

    Args:
        names: file names, with or without folders.

    Returns:
        The reading that pairs most names. A frame's number is the number in the names if it is
        unique; otherwise frames are counted from 1 in the order of the names.
    """
    ordered = sorted(dict.fromkeys(names), key=natural)
    return best_reading(ordered, readings_by_words(ordered))


def best_reading(names: Sequence[str], readings: Iterable[NameReading]) -> Pairing:
    """The pairs of the reading that pairs most names, as `pair_names`.

    Args:
        names: in natural order.
    """
    read = [_read(names, reading) for reading in readings]
    if not read:
        what = "one photograph" if names else "no photograph"
        why = f"No pair: there is {what}; each frame needs one from each camera."
        if len(names) > 1:
            why = (
                f"None of the {len(names)} photographs could be paired by name. Give both "
                "photographs of a frame the same name, apart from the camera, as left07 and "
                "right07, or the same name in folders primary and secondary."
            )
        return Pairing({}, (), tuple(names), why)
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


def number_pairs(pairs: Mapping[str, tuple[str, str]]) -> Moments:
    """The two names of each pair, by their common part, as a moment of that number."""
    return {
        frame: dict(zip(CAMERAS, pairs[key], strict=True)) for key, frame in numbered(pairs).items()
    }


def numbered(names: Iterable[str]) -> dict[str, int]:
    """Frame numbers, ascending: the last number in all names that differs from one to the other;
    if there is none, they are counted from 1 in natural order."""
    keys = sorted(names, key=natural)
    digits = [re.findall("[0-9]+", key)[::-1] for key in keys]
    frames = list(range(1, len(keys) + 1))
    for place in range(min(map(len, digits), default=0)):
        texts = [groups[place] for groups in digits]
        numbers = [int(text) for text in texts if len(text) <= MAXIMUM_DIGITS]
        if len(set(numbers)) == len(keys):
            frames = numbers
            break
    return dict(sorted(zip(keys, frames, strict=True), key=lambda item: item[1]))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """The key that sorts img9 before img10."""
    parts = re.split("([0-9]+)", name.lower())
    # Python converts at most 4300 digits to a number.
    return tuple(
        (0, int(part), part) if part.isdigit() and len(part) <= 4000 and i % 2 else (1, 0, part)
        for i, part in enumerate(parts)
        if part
    )


def short_names(names: Sequence[str]) -> list[str]:
    """Without folder and ending, if they are still told apart."""
    stems = [PurePosixPath(name.replace("\\", "/")).stem for name in names]
    return stems if len({*stems}) == len(names) else [*names]


def first_names(names: Sequence[str]) -> str:
    """The first three names, and how many more."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def missing(alone: Sequence[Alone]) -> list[str]:
    """The sentence that names the first three photographs without a partner, if any."""
    if not alone:
        return []
    more = f"; and {len(alone) - 3} more" if len(alone) > 3 else ""
    return [f"{'; '.join(map(str, alone[:3]))}{more}."]


def _read(names: Sequence[str], reading: NameReading) -> _Read:
    sides: dict[str, tuple[list[str], list[str]]] = {}
    unknown = []
    for name in names:
        side_and_key = reading.side_and_key.get(name)
        if side_and_key is None:
            unknown.append(name)
        else:
            side, key = side_and_key
            sides.setdefault(key, ([], []))[side].append(name)
    pairs, alone, rivals = {}, [], []
    for key, (first, second) in sides.items():
        if len(first) == len(second) == 1:
            pairs[key] = (first[0], second[0])
        elif max(len(first), len(second)) > 1:
            rivals += [*first, *second]
        else:
            alone.append(((first or second)[0], int(not first)))
    return _Read(pairs, tuple(alone), tuple(rivals), tuple(unknown), reading)


def _sentence(best: _Read, others: Sequence[_Read]) -> str:
    first, second = best.reading.words
    marks = f': "{first}" marks the primary camera\'s photographs, "{second}" the secondary\'s'
    plain = best.reading.words == CAMERAS  # the project's own folders too
    sentences = [
        f"{count(len(best.pairs), 'pair')} by name{'' if plain else marks}.",
        *missing(best.alone),
    ]
    if best.rivals:
        names = first_names(best.rivals)
        sentences.append(f"Several files have the same camera and frame: {names}.")
    if best.unknown:
        sentences.append(f"These names identify no camera: {first_names(best.unknown)}.")
    for other in others[:1]:
        one, two = other.reading.words
        sentences.append(
            f"The names can also be read with {one} and {two} as the two cameras: check the pairs."
        )
    return " ".join(sentences)
