"""A recording read without one mistake: rows of a table of mistakes, and their readings."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

from stereocal.rig.camera import camera_in_words
from stereocal.rig.recording import CameraPair, Recording

ESTIMATED_HANDICAP = 1.3
"""The handicap of readings that put a fitted value in the place of a stated one."""

Ways = Callable[[Recording, "Group"], Iterable["Way"]]
Of = Literal["one", "each", "each and all", "all", "two"]
"""Cameras that a row is tried with. `one`: each, but of two the second alone, because it is the
same in the first."""


@dataclass(frozen=True)
class Group:
    """Cameras that one mistake may concern, and two cameras that show it."""

    names: tuple[str, ...]
    pair: CameraPair
    """Two cameras that show it: the second is the one of `names`; any two of several."""


@dataclass(frozen=True)
class Way:
    """One way to read a recording."""

    corrected: Callable[[], Recording]
    """Raises a `StereocalError` where such data are impossible."""
    values: Mapping[str, str] = field(default_factory=dict)
    """For the words of the row."""
    is_likely: bool = False
    """Whether something else speaks for it, so that it is judged with what seems to fit better."""


@dataclass(frozen=True)
class Row:
    """A typical mistake."""

    claim: str
    """What may be wrong, with `words_of` the cameras and the values of a way in braces."""
    remedy: str
    """What to do about it, likewise."""
    of: Of
    ways: Ways
    """None where it makes no sense."""
    where: str = ""
    """Where it makes sense: an object, or a lens; empty if everywhere."""
    is_estimated: bool = False
    """Whether it puts a fitted value in the place of a stated one."""
    least_gain: float = 0.0
    """How many times less noise it must leave than what was given."""

    def is_tried_with(self, names: Sequence[str], cameras: Sequence[str]) -> bool:
        """Whether it may concern the named ones of all cameras."""
        if self.of == "two":
            return len(names) == 2
        if len(names) > 1:
            return self.of in ("all", "each and all")
        alone = self.of != "one" or len(cameras) > 2 or names[0] == cameras[1]
        return self.of != "all" and alone


@dataclass(frozen=True)
class Reading:
    """A recording without one mistake."""

    row: Row
    group: Group
    way: Way
    words: Mapping[str, str]

    @property
    def claim(self) -> str:
        """What may be wrong."""
        return self.row.claim.format_map(self.words)

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self.row.remedy.format_map(self.words)

    @property
    def handicap(self) -> float:
        """How many times less noise it must leave than others to be the better one."""
        estimated = self.row.is_estimated and not self.way.is_likely
        return ESTIMATED_HANDICAP if estimated else 1.0


def readings_of(
    recording: Recording, rows: Iterable[Row], groups: Iterable[Group], cameras: Sequence[str]
) -> Iterator[Reading]:
    """The readings by rows of a table.

    Args:
        groups: of cameras of the recording.
        cameras: all, of which the recording may have some.
    """
    for row, group in product(rows, [*groups]):
        if row.is_tried_with(group.names, cameras):
            words = words_of(group.names, cameras)
            for way in row.ways(recording, group):
                yield Reading(row, group, way, {**words, **way.values})


def words_of(names: Sequence[str], cameras: Sequence[str]) -> dict[str, str]:
    """The named ones of all cameras, as the rows call them.

    Two cameras cannot tell in which of them a relation of both is wrong.
    """
    one, two, several = camera_in_words(names[0]), len(cameras) == 2, len(names) > 1
    first, second = (f"{camera_in_words(name).removesuffix(' camera')}'s" for name in cameras[:2])
    of_two = {
        "which": "both cameras" if several else "one camera",
        "one_of": "one of the cameras",
        "others": "other",
        "two_files": "two camera files",
        "them": "the files",
        "by_writing": " Which camera it is, images of writing show.",
        "by_ground": " Which camera it is, a point near the ground shows.",
        "counted": "the two cameras",
        "own": second,
        "others_own": first,
    }
    of_more = {
        "which": "all cameras" if several else one,
        "one_of": one,
        "others": "others",
        "two_files": f"camera files of {names[0]} and {names[-1]}, or their points,",
        "them": "them",
        "by_writing": "",
        "by_ground": "",
        "counted": one,
        "own": "its",
        "others_own": "the others'",
    }
    whose = "cameras'" if several else f"{one.removeprefix('the ')}'s"
    return {"whose": whose, **(of_two if two else of_more)}
