"""Where the point of a track is in another frame: by its velocity, then by what the image shows.

Normalised correlation finds the pixel, near the place that the velocity predicts; the tracker of
Lucas and Kanade then its fraction.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.matching.clicks import Click
from stereocal.rig.compiled import FloatArray

HALF = 10
"""Of the square about the point that is looked for, px."""
REACH_PX, REACH_OF_STEP = 16, 0.5
"""How far from the predicted place it is looked for: at least, and of the step predicted."""
REACH_UNKNOWN = 0.04
"""The same of the image's width, where the velocity is not known."""
ALIKE = 0.75
"""Correlation below which the image shows something else."""
FINEST_PX = 1.5
"""Most px by which the fraction may differ from the pixel found."""
Image = npt.NDArray[np.uint8]


class Proposed(NamedTuple):
    """A place proposed for the next point of a track."""

    u: float
    v: float
    alike: float
    """Correlation with the image about the point before; 0 where nothing is alike, and the place is
    where the velocity predicts it."""

    @property
    def is_seen(self) -> bool:
        return self.alike >= ALIKE


def nearest_clicks(along: Sequence[Click], frame: int) -> list[Click]:
    """The click nearest in time to a frame, of those of a track in one camera, and the next one
    on its side; those before go first."""
    before = [each for each in along if each.frame < frame][::-1]
    after = [each for each in along if each.frame > frame]
    sides = sorted((s for s in (before, after) if s), key=lambda s: abs(s[0].frame - frame))
    return sides[0][:2] if sides else []


def velocity(nearest: Sequence[Click]) -> FloatArray | None:
    """(2,): px per frame, by two clicks; None by one."""
    if len(nearest) < 2:
        return None
    one, two = nearest
    return np.array([one.u - two.u, one.v - two.v]) / (one.frame - two.frame)


def follow(before: Image, now: Image, nearest: Sequence[Click], frame: int) -> Proposed:
    """Where the point is in a frame.

    Args:
        before: grey image in which `nearest[0]` was clicked; now: that of the frame.
        nearest: one or two clicks, as of `nearest_clicks`.
    """
    last, speed = nearest[0], velocity(nearest)
    step = np.zeros(2) if speed is None else speed * (frame - last.frame)
    at = np.array([last.u, last.v])
    reach = max(REACH_PX, REACH_OF_STEP * float(np.linalg.norm(step)))
    if speed is None:
        reach = max(reach, REACH_UNKNOWN * now.shape[1])
    guess = at + step
    whole = np.round(at).astype(int)
    blind = Proposed(float(guess[0]), float(guess[1]), 0.0)
    sought, there = _square(before, whole, HALF), np.round(guess).astype(int)
    area = _square(now, there, HALF + round(reach))
    if sought is None or area is None or sought.std() < 1.0:
        return blind
    scores = cv2.matchTemplate(area, sought, cv2.TM_CCOEFF_NORMED)
    _, alike, _, best = cv2.minMaxLoc(scores)
    if not alike >= ALIKE:
        return blind
    found = at + (there - round(reach) + np.array(best) - whole)
    fine = _finer(before, now, at, found)
    u, v = (found if fine is None else fine).tolist()
    return Proposed(u, v, float(alike))


def corner_at(image: Image, point: tuple[float, float]) -> tuple[float, float]:
    """The corner near a click, where edges meet."""
    middle = np.round(point).astype(int)
    part = _square(image, middle, 3 * HALF)
    if part is None:
        raise StereocalError("The click is outside the picture.")
    start = (np.array(point) - middle + 3 * HALF).astype(np.float32).reshape(1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.001)
    shift = cv2.cornerSubPix(part, start.copy(), (HALF // 2,) * 2, (-1, -1), stop) - start
    if not 0 < np.abs(shift).max() <= HALF / 2:
        raise StereocalError("There is no corner at the click: click nearer to one, or with shift.")
    return float(point[0] + shift[0, 0, 0]), float(point[1] + shift[0, 0, 1])


def _square(image: Image, middle: npt.NDArray[np.int64], half: int) -> Image | None:
    """The square about a pixel, continued at the edges; None if its middle is outside the image."""
    height, width = image.shape
    if not (0 <= middle[0] < width and 0 <= middle[1] < height):
        return None
    (u, v), (right, below) = middle - half, middle + half + 1
    part = image[max(v, 0) : below, max(u, 0) : right]
    edges = max(-v, 0), max(below - height, 0), max(-u, 0), max(right - width, 0)
    return np.asarray(cv2.copyMakeBorder(part, *edges, cv2.BORDER_REPLICATE), np.uint8)


def _finer(before: Image, now: Image, at: FloatArray, found: FloatArray) -> FloatArray | None:
    """The place to a fraction of a pixel; None where there is none nearby."""
    middles = [np.round(each).astype(int) for each in (at, found)]
    half = 3 * HALF
    one, two = (_square(i, m, half) for i, m in zip((before, now), middles, strict=True))
    if one is None or two is None:
        return None
    start, guess = (
        (place - middle + half).astype(np.float32).reshape(1, 1, 2)
        for place, middle in zip((at, found), middles, strict=True)
    )
    place, there, _ = cv2.calcOpticalFlowPyrLK(
        one, two, start, guess.copy(), winSize=(2 * HALF + 1,) * 2, maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    shift = np.asarray(place - guess, np.float64).reshape(2)
    return found + shift if there.item() and np.linalg.norm(shift) <= FINEST_PX else None
