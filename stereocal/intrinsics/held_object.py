"""What is held in front of both cameras, from a few photographs of each, for the user to accept.

    held = held_object([photographs_of_the_primary, photographs_of_the_secondary])

Evidence for an object is that both cameras see it, and see it at different places: what lies about
in the scene does not move.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from stereocal.detection.ball_colours import Colours
from stereocal.detection.balls import find_balls, proposed_colours, reduced
from stereocal.detection.detect import detect_targets
from stereocal.detection.fit import Corner
from stereocal.detection.intensity import eight_bits
from stereocal.detection.target import BAR, Balls, Tags, Target
from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardView, find_board
from stereocal.intrinsics.markers import markers_in
from stereocal.intrinsics.proposed_board import (
    ProposedBoard,
    charuco_of,
    chessboard_in,
    smallest_dictionary,
)
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.photograph import GreyImage, PhotographFile, read_colours, read_photograph
from stereocal.system.sampling import evenly_spread

LOOKED_AT = 5
"""Photographs of each camera, spread over all."""
ELSEWHERE = 0.02
"""Least distance of two places over the diagonal of the image."""
LEAST_PART = 0.6
"""Share of the photographs of each camera in which the object must be, each time elsewhere."""
STRAY_TAGS = 2
"""Patterns that are taken for a tag now and then; of a board with small markers, two may be read in
most photographs and a dozen in some."""
SQUARE_M = 0.01
"""Any side of a square: where a board is in a photograph does not depend on it."""
T = TypeVar("T")
Held = Target | ProposedBoard
Seen = tuple[Mapping[str, FloatArray], ...]
"""For each camera, by photograph: points (n, 2) px on the object."""


class Patterns(NamedTuple):
    """What is printed on the objects in one photograph."""

    board: tuple[ProposedBoard, FloatArray] | None
    bar: tuple[Corner, Corner] | None
    tags: dict[tuple[str, int], FloatArray]
    """By dictionary and number."""


Once = Callable[[str, Callable[[], Patterns]], Patterns]
"""Returns what is kept of the named photograph, or makes it."""


class _Look(NamedTuple):
    """What one photograph shows, of each kind of object."""

    name: str
    file: PhotographFile
    diagonal: float
    patterns: Patterns
    small: Colours
    scale: float
    """Pixels of the photograph for one of `small`."""


@dataclass(frozen=True, eq=False)
class HeldObject:
    """What is held, and where it is in the photographs that were looked at."""

    what: Held
    seen: Seen
    looked_at: tuple[int, ...]
    """Photographs of each camera."""

    @property
    def kind(self) -> Literal["bar2x2", "balls", "board", "tags"]:
        """The word with which the text of a target begins."""
        match self.what:
            case ProposedBoard():
                return "board"
            case Balls():
                return "balls"
            case Tags():
                return "tags"
        return "bar2x2"

    @property
    def words(self) -> str:
        """What is held, for the user: "a board of 9x6 inner corners"."""
        match self.what:
            case ProposedBoard(dictionary=None):
                return f"a chessboard with {self.what} inner corners"
            case ProposedBoard():
                return f"a ChArUco board with {self.what} inner corners"
            case Balls():
                return "a bar with two coloured balls"
            case Tags(dictionary=dictionary, ids=(a, b)):
                return f"a bar with the tags {a} and {b} of {dictionary}"
            case _:
                return "a bar with two 2x2 targets"

    @property
    def sentence(self) -> str:
        """What is proposed, and why."""
        first, second = (
            f"{len(places)} of {of}" for places, of in zip(self.seen, self.looked_at, strict=True)
        )
        return (
            f"This looks like {self.words}: {first} photographs of the primary that were looked at "
            f"show it, and {second} of the secondary, each at another place."
        )


def held_object(
    cameras: Sequence[Mapping[str, PhotographFile]], once: Once = lambda _, make: make()
) -> HeldObject | None:
    """The object that moves before both cameras.

    Args:
        cameras: the photographs of the primary and of the secondary, in the order of their frames.
        once: the patterns of a named photograph, as kept or else made: an earlier call with others
            may have looked at it.

    Returns:
        None if nothing is found in most photographs of both, or several objects are.
    """
    looks = [[*_looks(photographs, once)] for photographs in cameras]
    proposals = [*_boards(looks), *_bar(looks), *_tags(looks)] or [*_balls(looks)]
    if len(proposals) != 1:
        return None
    held, seen = proposals[0]
    return HeldObject(held, seen, tuple(map(len, looks)))


def spread(every: Sequence[T]) -> list[T]:
    """`LOOKED_AT` of them, from the first to the last."""
    return [every[k] for k in evenly_spread(len(every), LOOKED_AT)]


def _looks(photographs: Mapping[str, PhotographFile], once: Once) -> Iterator[_Look]:
    for name in spread([*photographs]):
        file = photographs[name]
        try:
            grey, small = read_photograph(file, name), reduced(read_colours(file, name))
        except StereocalError:  # reported by the search
            continue
        patterns = once(name, partial(_patterns, grey))
        scale = grey.shape[0] / small.shape[0]
        yield _Look(name, file, float(np.hypot(*grey.shape)), patterns, small, scale)


def _patterns(grey: GreyImage) -> Patterns:
    plain = eight_bits(grey)
    markers = markers_in(plain)
    tags = {
        (dictionary, int(number)): four.mean(axis=0, keepdims=True)
        for dictionary, numbered in markers.items()
        for number, four in zip(*numbered, strict=True)
    }
    return Patterns(charuco_of(markers) or chessboard_in(plain), detect_targets(grey).targets, tags)


def _places(seen: Mapping[str, FloatArray], looks: Sequence[_Look]) -> int:
    """At how many places of a camera's image the object was."""
    places: list[FloatArray] = []
    for look in looks:
        if look.name in seen:
            centre = seen[look.name].mean(axis=0)
            away = [np.linalg.norm(centre - other) for other in places]
            if min(away, default=np.inf) > ELSEWHERE * look.diagonal:
                places.append(centre)
    return len(places)


def _moves(seen: Seen, looks: Sequence[Sequence[_Look]]) -> bool:
    """Whether an object is in most photographs of each camera, each time elsewhere."""
    return all(
        _places(places, of_camera) >= max(2.0, LEAST_PART * len(of_camera))
        for places, of_camera in zip(seen, looks, strict=True)
    )


def _boards(looks: Sequence[Sequence[_Look]]) -> Iterator[tuple[Held, Seen]]:
    """Boards whose size is seen at several places of an image, searched for in all others: only a
    board of known size is found where its outer squares are narrow or something hides them."""
    known = [
        {look.name: look.patterns.board for look in of_camera if look.patterns.board}
        for of_camera in looks
    ]
    every = [board for of_camera in known for board, _ in of_camera.values()]
    for size in {board.size for board in every}:
        alike = [board for board in every if board.size == size]
        # The side of a marker is measured anew in each photograph, and rows end with the last
        # marker that was read.
        board = replace(
            max(alike, key=lambda board: board.rows),
            marker=round(float(np.median([board.marker for board in alike])), 2),
        )
        first = [
            {name: place for name, (board, place) in of_camera.items() if board.size == size}
            for of_camera in known
        ]
        if any(_places(places, of) > 1 for places, of in zip(first, looks, strict=True)):
            seen = tuple(
                places
                | dict(_found(board, [look for look in of_camera if look.name not in places]))
                for places, of_camera in zip(first, looks, strict=True)
            )
            if _moves(seen, looks):
                yield board, seen


def _found(board: ProposedBoard, looks: Sequence[_Look]) -> Iterator[tuple[str, FloatArray]]:
    side = (SQUARE_M, board.dictionary, board.marker * SQUARE_M or None)
    pattern = BoardPattern(board.columns, board.rows, *side)
    for look in looks:
        view = find_board(read_photograph(look.file), pattern, look.name)
        if isinstance(view, BoardView):
            yield look.name, view.corners


def _bar(looks: Sequence[Sequence[_Look]]) -> Iterator[tuple[Held, Seen]]:
    seen = tuple(
        {
            look.name: np.array([corner.centre for corner in look.patterns.bar])
            for look in of_camera
            if look.patterns.bar
        }
        for of_camera in looks
    )
    if _moves(seen, looks):
        yield BAR, seen


def _tags(looks: Sequence[Sequence[_Look]]) -> Iterator[tuple[Held, Seen]]:
    """Two tags of one dictionary that move; with more of them it is a board."""
    by_dictionary: dict[str, dict[int, Seen]] = {}
    others: Counter[str] = Counter()
    for tag in sorted(
        {tag for of_camera in looks for look in of_camera for tag in look.patterns.tags}
    ):
        seen = tuple(
            {look.name: tags[tag] for look in of if tag in (tags := look.patterns.tags)}
            for of in looks
        )
        if _moves(seen, looks):
            by_dictionary.setdefault(tag[0], {})[tag[1]] = seen
        elif not any(
            len(places) > _places(places, of) for places, of in zip(seen, looks, strict=True)
        ):
            others[tag[0]] += 1  # and it does not stand still
    for dictionary, moving in by_dictionary.items():
        if len(moving) == 2 and others[dictionary] <= STRAY_TAGS:
            (a, first), (b, second) = moving.items()
            both = tuple(
                {name: np.vstack([one[name], other[name]]) for name in one if name in other}
                for one, other in zip(first, second, strict=True)
            )
            yield Tags(smallest_dictionary(dictionary, b + 1), (a, b)), both


def _balls(looks: Sequence[Sequence[_Look]]) -> Iterator[tuple[Held, Seen]]:
    balls = proposed_colours([[look.small for look in of_camera] for of_camera in looks])
    if balls is None:
        return
    seen: list[dict[str, FloatArray]] = [{}, {}]
    for places, of_camera in zip(seen, looks, strict=True):
        for look in of_camera:
            spots = [spot for spot in find_balls(look.small, balls).spots if spot]
            if len(spots) == 2:
                centres = np.array([spot.centre for spot in spots])
                places[look.name] = look.scale * (centres + 0.5) - 0.5
    if _moves(tuple(seen), looks):
        yield balls, tuple(seen)
