"""Why a photograph is refused, or doubtful: the reason for programs, a sentence for people."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from stereocal.detection.edges import GreyImage
from stereocal.detection.fit import Corner
from stereocal.detection.intensity import Light

Reason = Literal[
    "too few candidates", "ambiguous", "saturated", "blurred", "cut by the border", "unreadable"
]

RUNNER_UP_DOUBTFUL, RUNNER_UP_AMBIGUOUS = 0.6, 0.9
BLUR_DOUBTFUL, BLUR_REFUSED = 0.1, 0.16
"""Blur per size of the board: at 0.16 an edge is as wide as half a square."""
CUT_REFUSED = 0.5
"""A board of which less than this part of an arm is in the image."""
SIGMA_DOUBTFUL_PX = 0.3
SATURATED_SHARE = 0.3
SOFT = 0.12
SURE_QUALITY = 0.7
UNLIKE = 0.25


def _where(corner: Corner) -> str:
    return f"({corner.centre[0]:.0f}, {corner.centre[1]:.0f})"


def why_none(light: Light, corners: list[Corner], chess: int) -> tuple[Reason, str]:
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
    small = cv2.GaussianBlur(small, (0, 0), 1.5)
    low, high = np.percentile(small, [0.5, 99.5])
    step = float(np.percentile(np.abs(np.diff(small, axis=1)), 99.5))
    return step / max(float(high - low), 1e-9)


def _blurred(corner: Corner) -> str:
    return (
        f"The board at {_where(corner)} is blurred: its edges are {2.5 * corner.blur:.0f} px wide, "
        f"the board {corner.board_px:.0f} px."
    )


def why_refused(pair: tuple[Corner, Corner], runner_up: float) -> tuple[Reason, str] | None:
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


def doubts_of(
    pair: tuple[Corner, Corner], light: Light, score: float, runner_up: float
) -> tuple[str, ...]:
    """What a person should look at."""
    doubts = []
    for corner in pair:
        at = f"The board at {_where(corner)}"
        asked = {
            f"{at} does not look quite like a target.": corner.quality < SURE_QUALITY,
            f"{at} may belong to a larger chessboard.": corner.flips > 0,
            f"{at} is cut by the border.": corner.cut > 0,
            _blurred(corner): corner.blur > BLUR_DOUBTFUL * corner.board_px,
            f"{at} has saturated white squares.": corner.white >= 0.995 * light.full,
            f"{at} is known to {corner.sigma_px:.2f} px only.": corner.sigma_px > SIGMA_DOUBTFUL_PX,
        }
        doubts += [sentence for sentence, true in asked.items() if true]
    if runner_up > RUNNER_UP_DOUBTFUL:
        doubts.append("Another board looks nearly as much like a target.")
    if score < UNLIKE * pair[0].quality * pair[1].quality:
        doubts.append("The two boards look unlike each other.")
    return tuple(doubts)
