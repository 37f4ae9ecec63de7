"""The two targets of the bar in one photograph: found, doubtful, or refused with the reason.

A target is a 2x2 checkerboard that stands alone: one X-corner whose four edges end at the board's
border. Candidates (`candidates`) are fitted (`corner_fit`); corners with a next square belong to a
larger chessboard. Of what is left the best pair of boards that look alike is taken.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereocal.detection.candidates import FLIPS, LEVEL, SCORE, candidates
from stereocal.detection.corner_model import ALL
from stereocal.detection.fit import Corner, fit_corner
from stereocal.detection.intensity import Light, prepare
from stereocal.detection.refusals import (
    RUNNER_UP_DOUBTFUL,
    Reason,
    doubts_of,
    why_none,
    why_refused,
)
from stereocal.rig.compiled import FloatArray

State = Literal["found", "doubtful", "refused"]

SMALLEST_IMAGE = 16
FITS = 20
"""So many of the best candidates are fitted at full size."""
MUCH_LESS = 0.6
"""Once two are found, candidates with less than this part of their score are left."""
ALTERNATIVE, MOST_ALTERNATIVES = 0.4, 12
"""Where the best pair is in doubt, the other frames choose among pairs of boards with more than
this part of its score: less than `RUNNER_UP_DOUBTFUL`, that the right pair be one of them."""
NEAR = 1.5
"""Corners of a larger chessboard lie within so many times twice their square."""
SMALLEST_QUALITY = 0.45
SIZE_SPREAD, LIGHT_SPREAD, BLACK_SPREAD = 0.4, 0.5, 0.25
"""Of the logarithms of the size and of the contrast of the two boards of a bar: one may be half as
far again as the other, and more in the shade. The last is of the difference of the black squares,
per sum of the contrasts."""


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
    alternatives: tuple[Detection, ...] = ()
    """Where more than two boards look like targets: each pair of boards that may be the targets, as
    if there were no other, the best first. Empty where the best pair stands out."""

    @property
    def state(self) -> State:
        """Found, doubtful (a person should look), or refused."""
        if self.targets is None:
            return "refused"
        return "doubtful" if self.doubts else "found"


def detect_targets(image: npt.NDArray[Any]) -> Detection:
    """Find the two targets of the bar.

    Args:
        image: (h, w), grey, of 8- or 16-bit or floating-point numbers.

    Raises:
        StereocalError: not such an array.
    """
    light = prepare(image)
    size = (int(image.shape[1]), int(image.shape[0]))
    if min(size) < SMALLEST_IMAGE:
        return refusal(size, "too few candidates", f"It is only {size[0]}x{size[1]} px.")
    corners, chess = _corners(light)
    pairs = sorted(
        ((_alike(*pair), pair) for pair in itertools.combinations(corners, 2)),
        key=lambda scored: -scored[0],
    )
    if not pairs:
        return refusal(size, *why_none(light, corners, chess))
    score, pair = pairs[0]
    runner_up = pairs[1][0] / score if len(pairs) > 1 else 0.0
    alternatives: tuple[Detection, ...] = ()
    if runner_up > RUNNER_UP_DOUBTFUL:
        likely = [one for one in pairs[:MOST_ALTERNATIVES] if one[0] > ALTERNATIVE * score]
        alternatives = tuple(_as_if_alone(size, light, *one) for one in likely)
    refused = why_refused(pair, runner_up)
    if refused is not None:
        return replace(refusal(size, *refused), alternatives=alternatives)
    found = _in_order(*pair)
    doubts = doubts_of(found, light, score, runner_up)
    return Detection(size, found, score, None, doubts, " ".join(doubts), alternatives)


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
    light = prepare(image)
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


def _as_if_alone(
    size: tuple[int, int], light: Light, score: float, pair: tuple[Corner, Corner]
) -> Detection:
    """A pair of boards, without a look at the others; one to be refused is doubtful at least."""
    found = _in_order(*pair)
    refused = why_refused(found, 0.0)
    doubts = dict.fromkeys(
        [*([refused[1]] if refused else []), *doubts_of(found, light, score, 0.0)]
    )
    return Detection(size, found, score, None, tuple(doubts), " ".join(doubts))


def _fitted(light: Light, row: FloatArray) -> Corner | None:
    """A candidate, fitted at full size."""
    half = 5.0 * 2.0 ** row[LEVEL]
    start = np.ascontiguousarray(row[:ALL])
    return fit_corner(light.image, start, half, light.quantum, light.gain)


def _without_chance_flips(corner: Corner, saddles: FloatArray) -> Corner:
    """The next square of a chessboard has a corner too: what turns without one is chance, such as
    a fence or leaves behind the board."""
    if not corner.flips:
        return corner
    forward = np.repeat(corner.directions, 2, axis=0) * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    ends = corner.centre + corner.arms[:, None] * forward
    away = np.linalg.norm(saddles[:, None] - ends, axis=2)
    beside = int((away < 0.3 * corner.arms).any(axis=0).sum())
    return replace(corner, flips=min(corner.flips, beside))


def _corners(light: Light) -> tuple[list[Corner], int]:
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
        corner = _without_chance_flips(corner, rows[:, :2])
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
