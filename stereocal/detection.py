"""The two targets of the bar in one photograph: found, doubtful, or refused with the reason.

A target is a 2x2 checkerboard that stands alone: one X-corner whose four edges end at the board's
border. Candidates (`candidates`) are fitted (`corner_fit`); corners with a next square belong to a
larger chessboard. Of what is left the best pair of boards that look alike is taken.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.candidates import FLIPS, LEVEL, SCORE, candidates
from stereocal.compiled import FloatArray
from stereocal.corner_fit import Corner, GreyImage, fit_corner
from stereocal.corner_model import ALL
from stereocal.errors import StereocalError

Reason = Literal[
    "too few candidates", "ambiguous", "saturated", "blurred", "cut by the border", "unreadable"
]
State = Literal["found", "doubtful", "refused"]

SMALLEST_IMAGE = 16
LIGHT = 255.0
"""Photographs are scaled so that their brightest parts have this grey level."""
FITS = 20
"""So many of the best candidates are fitted at full size."""
MUCH_LESS = 0.6
"""Once two are found, candidates with less than this part of their score are left."""
NEAR = 1.5
"""Corners of a larger chessboard lie within so many times twice their square."""
SMALLEST_QUALITY = 0.45
SURE_QUALITY = 0.7
SIZE_SPREAD, LIGHT_SPREAD, BLACK_SPREAD = 0.4, 0.5, 0.25
"""Of the logarithms of the size and of the contrast of the two boards of a bar: one may be half as
far again as the other, and more in the shade. The last is of the black squares' difference, per sum of the contrasts."""
RUNNER_UP_DOUBTFUL, RUNNER_UP_AMBIGUOUS = 0.6, 0.9
BLUR_DOUBTFUL, BLUR_REFUSED = 0.1, 0.16
"""Blur per size of the board: at 0.16 an edge is as wide as half a square."""
CUT_REFUSED = 0.5
"""A board of which less than this part of an arm is in the image."""
SIGMA_DOUBTFUL_PX = 0.3
SATURATED_SHARE = 0.3
SOFT = 0.12


@dataclass(frozen=True, eq=False)
class Detection:
    """What was found in one photograph."""

    image_size: tuple[int, int]
    """(width, height)."""
    targets: tuple[Corner, Corner] | None
    """From left to right, or from top to bottom where the bar is steeper than 45 degrees."""
    score: float
    """0 to 1."""
    reason: Reason | None
    """Why it was refused; None where there are targets."""
    doubts: tuple[str, ...]
    """One sentence for each."""
    sentence: str
    """What a person should know: the refusal, or the doubts; empty where all is well."""

    @property
    def state(self) -> State:
        """Found, doubtful (a person should look), or refused."""
        if self.targets is None:
            return "refused"
        return "doubtful" if self.doubts else "found"


@dataclass(frozen=True, eq=False)
class _Light:
    """A photograph as the fits take it."""

    image: GreyImage
    gain: float
    quantum: float
    """Step of the numbers in `image`; 0 for a photograph of floating-point numbers."""
    full: float
    """Grey level of the photograph that means saturated; infinite where that is not known."""
    saturated: float
    """Share of the pixels at that level."""


def detect_targets(image: npt.NDArray[Any]) -> Detection:
    """Find the two targets of the bar.

    Args:
        image: (h, w), grey, of 8- or 16-bit or floating-point numbers.

    Raises:
        StereocalError: not such an array.
    """
    light = _prepare(image)
    size = (int(image.shape[1]), int(image.shape[0]))
    if min(size) < SMALLEST_IMAGE:
        return refusal(size, "too few candidates", f"It is only {size[0]}x{size[1]} px.")
    corners, chess = _corners(light)
    pairs = sorted(
        ((_alike(*pair), pair) for pair in itertools.combinations(corners, 2)),
        key=lambda scored: -scored[0],
    )
    if not pairs:
        return refusal(size, *_why_none(light, corners, chess))
    score, pair = pairs[0]
    runner_up = pairs[1][0] / score if len(pairs) > 1 else 0.0
    refused = _why_refused(pair, runner_up)
    if refused is not None:
        return refusal(size, *refused)
    first, second = _in_order(*pair)
    doubts = _doubts((first, second), light, score, runner_up)
    return Detection(size, (first, second), score, None, doubts, " ".join(doubts))


def corner_near(
    image: npt.NDArray[Any], point: tuple[float, float], reach: float = 12.0
) -> Corner | None:
    """The X-corner nearest to a point that a person gave.

    Args:
        image: as for `detect_targets`.
        point: (u, v), px.
        reach: the corner may be so far away, px, or 0.3 times the size of its board if that is
            more.

    Returns None where there is none. A corner of a larger chessboard will do too.
    """
    light = _prepare(image)
    height, width = image.shape
    if not (-0.5 <= point[0] <= width - 0.5 and -0.5 <= point[1] <= height - 0.5):
        return None
    around = 160
    left, top = max(0, int(point[0]) - around), max(0, int(point[1]) - around)
    part = np.ascontiguousarray(light.image[top : top + 2 * around, left : left + 2 * around])
    best: Corner | None = None
    least = math.inf
    for row in candidates(part):
        row[:2] += left, top
        away = math.dist(row[:2], point)
        # A cheap look first: nothing beyond the reach of a board as large as the part looked at.
        if away > max(reach, 0.3 * 2 * around) or away > least + 3.0:
            continue
        corner = _fitted(light, row)
        if corner is None or corner.quality < 0.5 * SMALLEST_QUALITY:
            continue
        away = math.dist(corner.centre, point)
        if away <= max(reach, 0.3 * corner.board_px) and away / corner.quality < least:
            best, least = corner, away / corner.quality
    return best


def refusal(size: tuple[int, int], reason: Reason, sentence: str) -> Detection:
    """A photograph without targets."""
    return Detection(size, None, 0.0, reason, (), sentence)


def _prepare(image: npt.NDArray[Any]) -> _Light:
    """Brightness as 32-bit floats, scaled so that the brightest parts are at 255."""
    if image.ndim != 2 or not image.size:
        raise StereocalError(
            f"A photograph must be a grey image (height, width), not an array {image.shape}."
        )
    if image.dtype.kind not in "uif":
        raise StereocalError(f"A photograph must hold numbers, not {image.dtype}.")
    few = image[:: max(1, image.shape[0] // 256), :: max(1, image.shape[1] // 256)]
    bright = float(np.percentile(few, 99.9))
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise StereocalError("The photograph has pixels that are not finite numbers.")
    gain = LIGHT / bright if bright > 0 else 1.0
    if image.dtype == np.uint8:
        gain = max(1.0, gain) if bright < 0.5 * LIGHT else 1.0
    scaled = np.ascontiguousarray(image, dtype=np.float32)
    if gain != 1.0:
        scaled = scaled * np.float32(gain)
    full = math.inf
    if image.dtype.kind in "ui":
        highest = int(image.max())
        full = float(next((2**b - 1 for b in (8, 10, 12, 14, 16) if highest < 2**b), highest))
    quantum = gain if image.dtype.kind in "ui" else 0.0
    return _Light(scaled, gain, quantum, full, float(np.mean(few >= full)))


def _fitted(light: _Light, row: FloatArray) -> Corner | None:
    """A candidate, fitted at full size."""
    half = 5.0 * 2.0 ** row[LEVEL]
    start = np.ascontiguousarray(row[:ALL])
    return fit_corner(light.image, start, half, light.quantum, light.gain)


def _corners(light: _Light) -> tuple[list[Corner], int]:
    """Boards that stand alone, and how many corners of larger chessboards there were."""
    found: list[Corner] = []
    tried: list[tuple[float, float, float]] = []
    rows = candidates(light.image)
    in_rows = rows[rows[:, FLIPS] >= 2, :2]
    fits, good = 0, 0.0
    for row in rows[rows[:, FLIPS] < 2]:
        u, v = float(row[0]), float(row[1])
        near = [
            corner for corner in found if math.dist(corner.centre, (u, v)) < 0.3 * corner.board_px
        ]
        # The same saddle at two levels is fitted twice only if the first fit failed.
        again = any(math.dist(t[:2], (u, v)) < 2.0 and t[2] == row[LEVEL] for t in tried)
        if near or again:
            continue
        if fits == FITS or row[SCORE] < MUCH_LESS * good:
            break
        fits += 1
        tried.append((u, v, float(row[LEVEL])))
        corner = _fitted(light, row)
        if corner is None or corner.quality < SMALLEST_QUALITY:
            continue
        neighbours = np.hypot(*(in_rows - corner.centre).T) < NEAR * corner.board_px
        if corner.flips >= 2 or (corner.flips and neighbours.sum() >= 2):
            in_rows = np.vstack([in_rows, corner.centre])
        elif not any(math.dist(c.centre, corner.centre) < 0.3 * c.board_px for c in found):
            found.append(corner)
            if len(found) == 2:
                good = float(row[SCORE])
    # A board of 3x2 squares has two corners, each with one next square.
    single = [
        corner
        for corner in found
        if not corner.flips
        or not any(
            other is not corner
            and other.flips
            and math.dist(other.centre, corner.centre) < 0.75 * corner.board_px
            for other in found
        )
    ]
    return single, len(in_rows) + len(found) - len(single)


def _alike(first: Corner, second: Corner) -> float:
    """0 to 1: how well two corners are the two targets of one bar."""
    size = math.log(np.hypot(*first.lengths) / np.hypot(*second.lengths)) / SIZE_SPREAD
    light = math.log(first.contrast / second.contrast) / LIGHT_SPREAD
    dark = (first.black - second.black) / (first.contrast + second.contrast) / BLACK_SPREAD
    like = math.exp(-0.5 * (size**2 + light**2 + dark**2))
    if math.dist(first.centre, second.centre) < 0.5 * (first.board_px + second.board_px):
        like *= 0.1  # boards side by side: parts of one thing
    return first.quality * second.quality * like


def _in_order(first: Corner, second: Corner) -> tuple[Corner, Corner]:
    du, dv = second.centre - first.centre
    along = du if abs(du) >= abs(dv) else dv
    return (first, second) if along >= 0 else (second, first)


def _where(corner: Corner) -> str:
    return f"({corner.centre[0]:.0f}, {corner.centre[1]:.0f})"


def _why_none(light: _Light, corners: list[Corner], chess: int) -> tuple[Reason, str]:
    """The reason of a photograph with fewer than two candidates."""
    lowest, highest = float(light.image.min()), float(light.image.max())
    if light.saturated > SATURATED_SHARE and highest > lowest:
        return "saturated", (
            f"{100 * light.saturated:.0f} % of the pixels are saturated; take it with less light."
        )
    if lowest == highest:
        what = "white" if light.saturated else ("black" if highest == 0 else "of one grey")
        return ("saturated" if light.saturated else "too few candidates"), f"It is all {what}."
    if len(corners) == 1:
        found = corners[0]
        if found.blur > BLUR_DOUBTFUL * found.board_px:
            return "blurred", _blurred(found)
        return "too few candidates", (
            f"Only one target was found, at {_where(found)}; the other is hidden, out of view or "
            "too unlike it."
        )
    if chess:
        return "too few candidates", (
            "There is a chessboard, but no board of 2x2 squares that stands alone."
        )
    if min(light.image.shape) >= 64 and _softness(light.image) < SOFT:
        return "blurred", "The photograph is blurred, or shows nothing with edges."
    return "too few candidates", "No board of 2x2 squares was found."


def _softness(image: GreyImage) -> float:
    """The steepest steps over 4 px, per range of the brightness: 0.1 for a blur of 15 px."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    low, high = np.percentile(small, [0.5, 99.5])
    step = float(np.percentile(np.abs(np.diff(small, axis=1)), 99.5))
    return step / max(float(high - low), 1e-9)


def _blurred(corner: Corner) -> str:
    return (
        f"The board at {_where(corner)} is blurred: its edges are {2.5 * corner.blur:.0f} px wide, "
        f"the board {corner.board_px:.0f} px."
    )


def _why_refused(pair: tuple[Corner, Corner], runner_up: float) -> tuple[Reason, str] | None:
    """The reason to refuse the best pair."""
    if runner_up > RUNNER_UP_AMBIGUOUS:
        return "ambiguous", (
            "More than two boards look like targets; cover those that do not belong to the bar."
        )
    for corner in pair:
        if corner.blur > BLUR_REFUSED * corner.board_px:
            return "blurred", _blurred(corner)
        if corner.cut and corner.arms.min() < CUT_REFUSED * corner.arms.max():
            return "cut by the border", f"The board at {_where(corner)} is cut by the border."
    return None


def _doubts(
    pair: tuple[Corner, Corner], light: _Light, score: float, runner_up: float
) -> tuple[str, ...]:
    """What a person should look at."""
    doubts = []
    for corner in pair:
        at = f"The board at {_where(corner)}"
        asked: list[tuple[bool, Callable[[], str]]] = [
            (
                corner.quality < SURE_QUALITY,
                lambda at=at: f"{at} does not look quite like a target.",
            ),
            (corner.flips > 0, lambda at=at: f"{at} may belong to a larger chessboard."),
            (corner.cut > 0, lambda at=at: f"{at} is cut by the border."),
            (corner.blur > BLUR_DOUBTFUL * corner.board_px, lambda c=corner: _blurred(c)),
            (
                corner.white >= 0.995 * light.full,
                lambda at=at: f"{at} has saturated white squares.",
            ),
            (
                corner.sigma_px > SIGMA_DOUBTFUL_PX,
                lambda at=at, c=corner: f"{at} is known to {c.sigma_px:.2f} px only.",
            ),
        ]
        doubts += [say() for true, say in asked if true]
    if runner_up > RUNNER_UP_DOUBTFUL:
        doubts.append("Another board looks nearly as much like a target.")
    if score < 0.25 * pair[0].quality * pair[1].quality:
        doubts.append("The two boards look unlike each other.")
    return tuple(doubts)
