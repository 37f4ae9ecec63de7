"""Detect the two targets of the bar in one photograph; the result may be doubtful or rejected.

A target is a separate 2x2 checkerboard: one X-corner whose four edges end at the border of the
board. Candidates (`candidates`) are fitted (`fit`). Corners whose edges continue into another
square belong to a larger chessboard and are excluded. Of the remaining boards, the best pair of
similar ones is selected.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from stereocal.detection.candidates import FLIPS, LEVEL, SCORE, candidates
from stereocal.detection.checks import (
    RUNNER_UP_DOUBTFUL,
    Reason,
    doubts_of,
    explain_missing,
    rejection_of,
)
from stereocal.detection.corner_model import ALL
from stereocal.detection.fit import Corner, fit_corner
from stereocal.detection.intensity import Intensity, normalise_intensity
from stereocal.detection.target import Sighting, Spot, in_reading_order
from stereocal.system.array_types import FloatArray

State = Literal["found", "doubtful", "refused"]

SMALLEST_IMAGE = 16
FITS = 20
"""Number of the best candidates that are fitted at full size."""
RELATIVE_SCORE = 0.6
"""Once two boards are found, candidates with a smaller fraction of their score are ignored."""
ALTERNATIVE, MAXIMUM_ALTERNATIVES = 0.4, 12
"""If the best pair is doubtful, pairs with at least this fraction of its score are kept, from which
the other frames select. It is below `RUNNER_UP_DOUBTFUL`, so that they include the correct pair."""
NEAR = 1.5
"""Distance within which the corners of a larger chessboard lie, in units of two squares."""
REACH_PX = 12.0
"""Maximum distance of a click from a corner; 0.3 times the size of the board if that is more."""
SMALLEST_QUALITY = 0.45
SIZE_SPREAD, CONTRAST_SPREAD, BLACK_SPREAD = 0.4, 0.5, 0.25
"""Tolerances for the two boards of a bar: logarithm of the size ratio (one may be 1.5 times as far
as the other), logarithm of the contrast ratio (one may be in the shade), and difference of the
black levels over the sum of the contrasts."""


@dataclass(frozen=True, eq=False)
class Detection:
    """The result for one photograph."""

    image_size: tuple[int, int]
    """(width, height)."""
    targets: tuple[Corner, Corner] | None
    """From left to right, or from top to bottom if the bar is steeper than 45 degrees."""
    score: float
    """0 to 1."""
    reason: Reason | None
    """Reason of the rejection; None if there are targets."""
    doubts: tuple[str, ...]
    """Messages for the user."""
    sentence: str
    """Message for the user: the rejection, or all doubts; empty if there are none."""
    alternatives: "tuple[Detection, ...]" = ()
    """If more than two boards look like targets: the results for the possible pairs, each without
    regard to the others, best first. Empty if the best pair is clearly the best."""

    @property
    def state(self) -> State:
        """Found, doubtful (the user should check), or refused."""
        if self.targets is None:
            return "refused"
        return "doubtful" if self.doubts else "found"

    @property
    def sighting(self) -> Sighting:
        """The same, as of other targets; all doubts stand at the first."""
        others = tuple(one.sighting for one in self.alternatives)
        if self.targets is None:
            return Sighting((None, None), self.sentence, alternatives=others)
        first, second = (
            Spot(float(one.centre[0]), float(one.centre[1]), one.sigma_px, 0.5 * one.board_px)
            for one in self.targets
        )
        first = replace(first, doubts=(self.sentence,) if self.doubts else ())
        return Sighting((first, second), "", alternatives=others)


def detect_targets(image: npt.NDArray[Any]) -> Detection:
    """Detect the two targets of the bar.

    Args:
        image: (h, w): grey levels, as 8-bit, 16-bit or floating-point numbers.
    """
    intensity = normalise_intensity(image)
    size = (int(image.shape[1]), int(image.shape[0]))
    if min(size) < SMALLEST_IMAGE:
        return refusal(size, "too few candidates", f"It is only {size[0]}x{size[1]} px.")
    corners, chess = _corners(intensity)
    pairs = [
        (_pair_score(a, b), (a, b) if in_reading_order(a.centre, b.centre) else (b, a))
        for a, b in itertools.combinations(corners, 2)
    ]
    pairs.sort(key=lambda scored: -scored[0])
    if not pairs:
        return refusal(size, *explain_missing(intensity, corners, chess))
    score, pair = pairs[0]
    runner_up = pairs[1][0] / score if len(pairs) > 1 else 0.0
    alternatives: tuple[Detection, ...] = ()
    if runner_up > RUNNER_UP_DOUBTFUL:
        likely = [one for one in pairs[:MAXIMUM_ALTERNATIVES] if one[0] > ALTERNATIVE * score]
        alternatives = tuple(_without_others(size, intensity, *one) for one in likely)
    refused = rejection_of(pair, runner_up)
    if refused is not None:
        return replace(refusal(size, *refused), alternatives=alternatives)
    doubts = doubts_of(pair, intensity, score, runner_up)
    return Detection(size, pair, score, None, doubts, " ".join(doubts), alternatives)


def corner_near(image: npt.NDArray[Any], point: tuple[float, float]) -> Corner | None:
    """The X-corner nearest to a click (u, v) px, also one of a larger chessboard; None without one.

    Args:
        image: as for `detect_targets`.
    """
    intensity = normalise_intensity(image)
    height, width = image.shape
    if not (-0.5 <= point[0] <= width - 0.5 and -0.5 <= point[1] <= height - 0.5):
        return None
    around = 160
    left, top = max(0, int(point[0]) - around), max(0, int(point[1]) - around)
    part = np.ascontiguousarray(intensity.image[top : top + 2 * around, left : left + 2 * around])
    best, least = None, math.inf
    for row in candidates(part):
        row[:2] += left, top
        away = math.dist(row[:2], point)
        # Skip the fit if the corner is too far even for the largest board in this part.
        if away > 0.3 * 2 * around or away > least + 3.0:
            continue
        corner = _fitted(intensity, row)
        if corner is None or corner.quality < 0.5 * SMALLEST_QUALITY:
            continue
        away = math.dist(corner.centre, point)
        if away <= max(REACH_PX, 0.3 * corner.board_px) and away / corner.quality < least:
            best, least = corner, away / corner.quality
    return best


def refusal(size: tuple[int, int], reason: Reason, sentence: str) -> Detection:
    """The result for a photograph without targets."""
    return Detection(size, None, 0.0, reason, (), sentence)


def _without_others(
    size: tuple[int, int], intensity: Intensity, score: float, pair: tuple[Corner, Corner]
) -> Detection:
    """The result for a pair without regard to other boards; a rejection becomes a doubt."""
    refused = rejection_of(pair, 0.0)
    doubts = doubts_of(pair, intensity, score, 0.0)
    doubts = tuple(dict.fromkeys((*(refused or ())[1:], *doubts)))
    return Detection(size, pair, score, None, doubts, " ".join(doubts))


def _fitted(intensity: Intensity, row: FloatArray) -> Corner | None:
    """Fit a candidate at full size."""
    half = 5.0 * 2.0 ** row[LEVEL]
    start = np.ascontiguousarray(row[:ALL])
    return fit_corner(intensity.image, start, half, intensity.quantum, intensity.gain)


def _confirm_flips(corner: Corner, saddles: FloatArray) -> Corner:
    """Count only flips with a candidate nearby, since the next square has a corner too: others are
    coincidences, such as a fence or leaves behind the board."""
    if not corner.flips:
        return corner
    forward = np.repeat(corner.directions, 2, axis=0) * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    ends = corner.centre + corner.arms[:, None] * forward
    away = np.linalg.norm(saddles[:, None] - ends, axis=2)
    beside = int((away < 0.3 * corner.arms).any(axis=0).sum())
    return replace(corner, flips=min(corner.flips, beside))


def _corners(intensity: Intensity) -> tuple[list[Corner], int]:
    """The separate boards, and the number of corners of larger chessboards."""
    boards: list[Corner] = []
    tried: list[tuple[float, float, float]] = []
    rows = candidates(intensity.image)
    in_rows = rows[rows[:, FLIPS] >= 2, :2]
    fits, good = 0, 0.0
    for row in rows[rows[:, FLIPS] < 2]:
        u, v = float(row[0]), float(row[1])
        # A saddle point found at two levels is fitted again only if the first fit failed.
        again = any(math.dist(t[:2], (u, v)) < 2.0 and t[2] == row[LEVEL] for t in tried)
        if again or _covered(boards, (u, v)):
            continue
        if fits == FITS or row[SCORE] < RELATIVE_SCORE * good:
            break
        fits += 1
        tried.append((u, v, float(row[LEVEL])))
        corner = _fitted(intensity, row)
        if corner is None or corner.quality < SMALLEST_QUALITY:
            continue
        corner = _confirm_flips(corner, rows[:, :2])
        neighbours = np.hypot(*(in_rows - corner.centre).T) < NEAR * corner.board_px
        if corner.flips >= 2 or (corner.flips and neighbours.sum() >= 2):
            in_rows = np.vstack([in_rows, corner.centre])
        elif not _covered(boards, corner.centre):
            boards.append(corner)
            if len(boards) == 2:
                good = float(row[SCORE])
    # A board of 3x2 squares has two corners, each with one next square.
    flipped = [corner for corner in boards if corner.flips]
    double = [
        corner
        for corner in flipped
        if any(
            0.0 < math.dist(other.centre, corner.centre) < 0.75 * corner.board_px
            for other in flipped
        )
    ]
    single = [corner for corner in boards if corner not in double]
    return single, len(in_rows) + len(double)


def _covered(boards: list[Corner], point: Sequence[float] | FloatArray) -> bool:
    """Whether a point lies near the centre of a board that was found."""
    return any(math.dist(corner.centre, point) < 0.3 * corner.board_px for corner in boards)


def _pair_score(first: Corner, second: Corner) -> float:
    """0 to 1: the qualities of two corners times their similarity."""
    size = math.log(np.hypot(*first.lengths) / np.hypot(*second.lengths)) / SIZE_SPREAD
    contrast = math.log(first.contrast / second.contrast) / CONTRAST_SPREAD
    dark = (first.black - second.black) / (first.contrast + second.contrast) / BLACK_SPREAD
    similarity = math.exp(-0.5 * (size**2 + contrast**2 + dark**2))
    if math.dist(first.centre, second.centre) < 0.5 * (first.board_px + second.board_px):
        similarity *= 0.1  # adjacent boards are probably parts of one object
    return first.quality * second.quality * similarity
