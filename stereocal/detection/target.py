"""What was photographed, as one text: `bar2x2`, `balls:red,yellow`, `board:9x6:0.03`; and the
targets that a photograph shows, where each has its own name: balls and tags."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
from PIL import ImageColor

from stereocal.errors import StereocalError, naming
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray

BRIGHT = "bright"
"""Instead of a colour: spots that are brighter than all else, such as LEDs."""
EXAMPLES = "bar2x2, balls:red,yellow, balls:#c0392b,#f1c40f, balls:bright or tags:4X4_50:3,7"
BOARDS = "board:9x6:0.03, board:0.03 or charuco:9x6:0.03:4X4_50:0.022"
"""Inner corners and the side of a square in metres; without the size, it is found. A ChArUco board
has its dictionary and the side of its markers too."""


@dataclass(frozen=True)
class Bar2x2:
    """Two 2x2 checkerboards, which look alike."""

    named: ClassVar = False


@dataclass(frozen=True)
class Balls:
    """Two balls or lamps."""

    colours: tuple[str, str]
    """A's and B's: `#rrggbb` or `bright`. Balls of one colour are named by the other frames."""

    @property
    def named(self) -> bool:
        """Whether a photograph alone shows which is A."""
        return self.colours[0] != self.colours[1]


@dataclass(frozen=True)
class Tags:
    """Two ArUco or AprilTag markers."""

    dictionary: str
    """The dictionary as OpenCV names it, without `DICT_`."""
    ids: tuple[int, int]
    """Numbers of A and B."""
    named: ClassVar = True


@dataclass(frozen=True)
class Board:
    """A board with known squares."""

    square_m: float
    size: str = ""
    """In inner corners, such as `9x6`; empty if it is to be found."""
    dictionary: str | None = None
    marker_m: float | None = None

    def pattern(self, size: str = "") -> BoardPattern:
        """The pattern, of this size if the target does not say it."""
        return BoardPattern.parse(self.size or size, self.square_m, self.dictionary, self.marker_m)


@dataclass(frozen=True)
class Spot:
    """The centre of a target in raw pixels."""

    u: float
    v: float
    sigma_px: float
    """Standard error of one coordinate."""
    radius_px: float
    """Radius of a ball; half the side of a tag."""
    doubts: tuple[str, ...] = ()
    """What the user should check, as messages."""
    score: float = 1.0
    """How much it looks like the target, 0 to 1."""

    @property
    def centre(self) -> tuple[float, float]:
        """(u, v)."""
        return self.u, self.v


@dataclass(frozen=True)
class Sighting:
    """The result for one photograph."""

    spots: tuple[Spot | None, Spot | None]
    """Targets A and B."""
    missing: str
    """Why a target is missing; empty if both are there."""
    unreadable: bool = False
    """The photograph could not be read."""
    candidates: tuple[tuple[Spot, ...], ...] = ()
    """All that may be the target, best first: for A and B, or once for balls of one colour."""
    alternatives: "tuple[Sighting, ...]" = ()
    """The possible pairs of more than two boards, as `detect.Detection` has them."""

    @property
    def doubts(self) -> list[str]:
        """About both targets."""
        return [doubt for spot in self.spots if spot for doubt in spot.doubts]

    def turned(self, exchanged: bool) -> "Sighting":
        """With the other names of both targets, if they are exchanged."""
        return replace(self, spots=self.spots[::-1]) if exchanged else self


Target = Bar2x2 | Balls | Tags
BAR = Bar2x2()


def worst(*factors: tuple[float, str]) -> str:
    """The message of the least of the factors, 0 to 1, of how much something looks like a
    target."""
    return min(factors, key=lambda factor: factor[0])[1]


def in_reading_order(
    first: Sequence[float] | FloatArray, second: Sequence[float] | FloatArray
) -> bool:
    """Whether two centres are ordered from left to right, or from top to bottom if the bar is
    steeper than 45 degrees."""
    du, dv = second[0] - first[0], second[1] - first[1]
    return bool((du if abs(du) >= abs(dv) else dv) >= 0)


def parse_target(text: str) -> Target:
    """The target that a text describes."""
    kind, _, rest = text.strip().partition(":")
    if kind not in KINDS:
        raise StereocalError(f'"{text}" is not a kind of target: write {EXAMPLES}; or {BOARDS}.')
    try:
        return KINDS[kind](rest)
    except StereocalError as error:
        raise StereocalError(f'"{text}": {error}') from error


def _bar(rest: str) -> Bar2x2:
    if rest:
        raise StereocalError("bar2x2 takes nothing after it.")
    return BAR


def _balls(rest: str) -> Balls:
    names = [name.strip() for name in rest.split(",")]
    if names == [BRIGHT]:
        return Balls((BRIGHT, BRIGHT))
    if len(names) != 2:
        raise StereocalError("write the colours of A and B, such as balls:red,yellow.")
    if BRIGHT in names:
        raise StereocalError("write balls:bright for two lamps, or the colours of both balls.")
    first, second = map(_colour, names)
    return Balls((first, second))


def _colour(name: str) -> str:
    try:
        red, green, blue = ImageColor.getrgb(name)[:3]
    except ValueError:
        raise StereocalError(
            f'"{name}" is not a colour: write its name, such as red, or #c0392b.'
        ) from None
    return f"#{red:02x}{green:02x}{blue:02x}"


def _tags(rest: str) -> Tags:
    match = re.fullmatch(r"(?:DICT_)?(\w+):\s*(\d{1,9})\s*,\s*(\d{1,9})\s*", rest)
    if match is None:
        raise StereocalError("write the dictionary and the numbers of A and B: tags:4X4_50:3,7.")
    dictionary, a, b = match[1], int(match[2]), int(match[3])
    number = getattr(cv2.aruco, f"DICT_{dictionary}", None)
    if number is None:
        raise StereocalError(
            f"OpenCV has no dictionary {dictionary}; it has 4X4_50 to 7X7_1000, ARUCO_ORIGINAL, "
            "APRILTAG_36h11 and others."
        )
    many = len(cv2.aruco.getPredefinedDictionary(number).bytesList)
    if a == b or max(a, b) >= many:
        raise StereocalError(f"A and B must be two different numbers from 0 to {many - 1}.")
    return Tags(dictionary, (a, b))


def parse_board(text: str) -> Board | None:
    """The board that a text describes, such as those of `BOARDS`; None if it is none."""
    size, dictionary, side = "", None, None
    match text.strip().split(":"):
        case ["board", square]:
            pass
        case ["board", size, square]:
            pass
        case ["charuco", size, square, name, marker]:
            dictionary = name if name.startswith("DICT_") else f"DICT_{name}"
            side = _metres(marker)
        case ["board" | "charuco", *_]:
            raise StereocalError(f'"{text}" is no board: write {BOARDS}.')
        case _:
            return None
    with naming(f'"{text}"'):
        board = Board(_metres(square), size, dictionary, side)
        board.pattern("9x6")  # raises an error for what no board is
    return board


def _metres(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise StereocalError(f'"{text}" is not a length in metres, such as 0.03.') from None


KINDS: Mapping[str, Callable[[str], Target]] = {"bar2x2": _bar, "balls": _balls, "tags": _tags}
