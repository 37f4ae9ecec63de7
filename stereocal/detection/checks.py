"""Checks of the detected targets: reasons for rejection, doubts, and their messages."""

import math
from typing import Literal

import cv2
import numpy as np

from stereocal.detection.edges import LONG_ARM
from stereocal.detection.fit import Corner
from stereocal.detection.intensity import GreyImage, Intensity
from stereocal.detection.target import worst

Reason = Literal["too few candidates", "ambiguous", "saturated", "blurred", "cut by the border"]

RUNNER_UP_DOUBTFUL, RUNNER_UP_AMBIGUOUS = 0.6, 0.9
BLUR_DOUBTFUL, BLUR_REFUSED = 0.1, 0.16
"""Blur over board size: at 0.16 an edge is as wide as half a square."""
CUT_REFUSED = 0.5
"""A board at the border is rejected if a smaller fraction of an edge is in the image."""
SIGMA_DOUBTFUL_PX = 0.3
SATURATED_SHARE = 0.3
BLURRED_STEEPNESS = 0.12
CERTAIN_QUALITY = 0.7
DISSIMILAR = 0.25
"""A pair is doubtful if its score is a smaller fraction of the product of the qualities."""
SATURATED = 0.995
"""The share of full scale from which white squares are saturated."""
FAINT = 0.1
"""The share of full scale below which a contrast is named as the reason of a poor location."""
SMALL_PX = 20.0
"""Targets of at least this size are located well."""


def _where(corner: Corner) -> str:
    return f"({corner.centre[0]:.0f}, {corner.centre[1]:.0f})"


def explain_missing(intensity: Intensity, corners: list[Corner], chess: int) -> tuple[Reason, str]:
    """The reason and the message for a photograph with fewer than two boards.

    Args:
        corners: the boards found.
        chess: number of corners of larger chessboards.
    """
    lowest, highest = float(intensity.image.min()), float(intensity.image.max())
    if lowest == highest:
        what = "white" if intensity.saturated else ("black" if highest == 0 else "of one grey")
        return ("saturated" if intensity.saturated else "too few candidates"), f"It is all {what}."
    if intensity.saturated > SATURATED_SHARE:
        share = 100 * intensity.saturated
        saturated = f"{share:.0f} % of the pixels are saturated; reduce the exposure."
        return "saturated", f"The photograph is overexposed: {saturated}"
    for corner in corners[:1]:
        if corner.blur > BLUR_DOUBTFUL * corner.board_px:
            return "blurred", _blurred(corner)
        one = f"Only one target was found: at {_where(corner)}; the other is hidden, out of view or"
        return "too few candidates", f"{one} too different."
    if chess:
        only = "There is a chessboard, but no separate board of 2x2 squares."
        return "too few candidates", only
    if min(intensity.image.shape) >= 64 and _steepness(intensity.image) < BLURRED_STEEPNESS:
        return "blurred", "The photograph is blurred, or shows nothing with edges."
    return "too few candidates", "No board of 2x2 squares was found."


def _steepness(image: GreyImage) -> float:
    """The largest steps over 4 px, relative to the range of intensity: 0.1 for a blur of 15 px."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.5)
    low, high = np.percentile(small, [0.5, 99.5])
    step = float(np.percentile(np.abs(np.diff(small, axis=1)), 99.5))
    return step / max(float(high - low), 1e-9)


def _blurred(corner: Corner) -> str:
    return (
        f"The target at {_where(corner)} is blurred: its edges are {2.5 * corner.blur:.0f} px "
        f"wide, the board {corner.board_px:.0f} px."
    )


def rejection_of(pair: tuple[Corner, Corner], runner_up: float) -> tuple[Reason, str] | None:
    """The reason and the message if the best pair is rejected; else None.

    Args:
        runner_up: score of the second-best pair over that of the best.
    """
    if runner_up > RUNNER_UP_AMBIGUOUS:
        return "ambiguous", (
            "More than two boards look like targets; cover those that do not belong to the bar."
        )
    for corner in pair:
        if corner.blur > BLUR_REFUSED * corner.board_px:
            return "blurred", _blurred(corner)
        if corner.cut and corner.arms.min() < CUT_REFUSED * corner.arms.max():
            return "cut by the border", f"The target at {_where(corner)} is cut by the border."
    return None


def _doubt_of(corner: Corner, intensity: Intensity) -> str:
    """What is worst about one target, in a sentence with what was measured; empty if nothing is."""
    the_target = f"The target at {_where(corner)}"
    if corner.flips:
        return f"{the_target} may belong to a larger chessboard."
    if corner.cut:
        return f"{the_target} is cut by the border."
    if corner.white >= SATURATED * intensity.full:
        return f"{the_target} is overexposed: its white squares are saturated."
    if corner.blur > BLUR_DOUBTFUL * corner.board_px:
        return _blurred(corner)
    if corner.quality < CERTAIN_QUALITY:
        return _unlike(corner)
    if corner.sigma_px > SIGMA_DOUBTFUL_PX:
        why = f"it is located to {corner.sigma_px:.2f} px only"
        if corner.contrast < FAINT * intensity.full:
            share = 100.0 * corner.contrast / intensity.full
            faint = f"{the_target} is faint: white and black differ by {share:.0f} % of full scale"
            return f"{faint}, and {why}."
        return f"{the_target} is uneven or noisy: {why}."
    return ""


def _unlike(corner: Corner) -> str:
    """Which of the factors of its quality is the least."""
    the_target, shortest = f"The target at {_where(corner)}", float(corner.arms.min())
    sharp = min(1.0, shortest / (LONG_ARM * corner.blur))
    even = math.sqrt(shortest / float(corner.arms.max()))
    small = f"{the_target} is small: {corner.board_px:.0f} px across, 20 px are the least."
    return worst(
        (
            corner.fit_quality,
            f"{the_target} seems to be bent, or partly in a shadow: its squares are uneven by "
            f"{100.0 * corner.misfit:.0f} % of their contrast.",
        ),
        (
            even,
            f"{the_target} seems to be partly hidden, or something behind it goes on: its edges "
            f"are {shortest:.0f} and {corner.arms.max():.0f} px long.",
        ),
        (sharp, small if corner.board_px < SMALL_PX else _blurred(corner)),
    )


def doubts_of(
    pair: tuple[Corner, Corner], intensity: Intensity, score: float, runner_up: float
) -> tuple[str, ...]:
    """Messages about properties of an accepted pair that the user should check."""
    doubts = list(dict.fromkeys(filter(None, (_doubt_of(one, intensity) for one in pair))))
    if runner_up > RUNNER_UP_DOUBTFUL:
        doubts.append("Another place looks nearly as much like a target.")
    if score < DISSIMILAR * pair[0].quality * pair[1].quality:
        doubts.append("The two targets look different.")
    return tuple(doubts)
