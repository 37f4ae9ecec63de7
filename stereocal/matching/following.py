"""Where the point of a track is in another frame: its velocity says where to look, and normalised
correlation where the image shows it.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.matching.clicks import Click
from stereocal.system.array_types import FloatArray

HALF = 12
"""Of the square about the point that is looked for, px."""
REACH_PX, REACH_OF_STEP, REACH_UNKNOWN = 16, 0.5, 0.04
"""How far from the predicted place it is looked for: at least, in px; of the predicted step; and of
the image's width, where the velocity is not known."""
ALIKE = 0.75
"""Correlation below which the image shows something else."""
FARTHEST = 10
"""Frames from the nearest click beyond which a track has ended."""
Image = npt.NDArray[np.uint8]
Place = tuple[float, float]


def nearest_clicks(along: Sequence[Click], frame: int) -> list[Click]:
    """The click nearest in time to a frame, of those of a track in one camera, and the next one on
    its side; those before go first."""
    others = sorted((e for e in along if e.frame != frame), key=lambda e: abs(e.frame - frame))
    side = [click for click in others if (click.frame < frame) == (others[0].frame < frame)]
    return side[:2] if side and abs(side[0].frame - frame) <= FARTHEST else []


def velocity(nearest: Sequence[Click]) -> FloatArray | None:
    """(2,): px per frame, by two clicks; None by one."""
    if len(nearest) < 2:
        return None
    one, two = nearest
    return np.array([one.u - two.u, one.v - two.v]) / (one.frame - two.frame)


def follow(before: Image, now: Image, nearest: Sequence[Click], frame: int) -> Place | None:
    """Where the point is in a frame; None if the image does not show it near the predicted place.

    Args:
        before: grey image in which `nearest[0]` was clicked; now: that of the frame.
        nearest: one or two clicks, as of `nearest_clicks`.
    """
    last, speed = nearest[0], velocity(nearest)
    step = np.zeros(2) if speed is None else speed * (frame - last.frame)
    reach = max(REACH_PX, round(REACH_OF_STEP * float(np.linalg.norm(step))))
    if speed is None:
        reach = max(reach, round(REACH_UNKNOWN * now.shape[1]))
    predicted = np.array([last.u, last.v]) + step
    sought, area = _square(before, (last.u, last.v), HALF), _square(now, predicted, HALF + reach)
    if sought is None or area is None or sought.std() < 1.0:
        return None
    scores = cv2.matchTemplate(area, sought, cv2.TM_CCOEFF_NORMED)
    _, alike, _, (x, y) = cv2.minMaxLoc(scores)
    inside = 0 < x < 2 * reach and 0 < y < 2 * reach
    if not (alike >= ALIKE and inside):
        return None
    along = np.array([scores[y, x - 1 : x + 2], scores[y - 1 : y + 2, x]], np.float64)
    low, best, high = along.T  # of a parabola
    u, v = predicted - reach + [x, y] + (high - low) / (4 * best - 2 * (low + high) + 1e-9)
    return float(u), float(v)


def corner_at(image: Image, point: Place) -> Place:
    """The corner near a click, where edges meet."""
    if (part := _square(image, point, 3 * HALF)) is None:
        raise StereocalError("The click is outside the picture.")
    start = np.full((1, 1, 2), 3 * HALF, np.float32)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.001)
    shift = (cv2.cornerSubPix(part, start.copy(), (HALF // 2,) * 2, (-1, -1), stop) - start).ravel()
    if not 0 < np.abs(shift).max() <= HALF / 2:
        raise StereocalError("There is no corner at the click: click nearer to one, or with shift.")
    return point[0] + float(shift[0]), point[1] + float(shift[1])


def _square(image: Image, middle: Sequence[float] | FloatArray, half: int) -> Image | None:
    """The square about a place, continued at the edges; None if its middle is outside the image."""
    (height, width), (u, v) = image.shape, middle
    if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
        return None
    return np.asarray(cv2.getRectSubPix(image, (2 * half + 1,) * 2, (u, v)), np.uint8)
