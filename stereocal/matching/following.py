"""Where the point of a track is in another frame: its velocity says where to look, and the image
where it is. Normalised correlation finds the pixel, the tracker of Lucas and Kanade its fraction.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.matching.clicks import Click
from stereocal.rig.compiled import FloatArray

HALF = 12
"""Of the square about the point that is looked for, px."""
REACH_PX, REACH_OF_STEP, REACH_UNKNOWN = 16, 0.5, 0.04
"""How far from the predicted place it is looked for: at least, in px; of the predicted step; and of
the image's width, where the velocity is not known."""
ALIKE = 0.75
"""Correlation below which the image shows something else."""
FINEST_PX = 1.5
"""Most px by which the fraction may differ from the pixel found."""
FARTHEST = 10
"""Frames from the nearest click beyond which a track has ended."""
Image = npt.NDArray[np.uint8]
Pixel = npt.NDArray[np.int64]


def nearest_clicks(along: Sequence[Click], frame: int) -> list[Click]:
    """The click nearest in time to a frame, of those of a track in one camera, and the next one on
    its side; those before go first."""
    before = [each for each in along if each.frame < frame][::-1]
    after = [each for each in along if each.frame > frame]
    sides = sorted((s for s in (before, after) if s), key=lambda s: abs(s[0].frame - frame))
    return sides[0][:2] if sides and abs(sides[0][0].frame - frame) <= FARTHEST else []


def velocity(nearest: Sequence[Click]) -> FloatArray | None:
    """(2,): px per frame, by two clicks; None by one."""
    if len(nearest) < 2:
        return None
    one, two = nearest
    return np.array([one.u - two.u, one.v - two.v]) / (one.frame - two.frame)


def follow(
    before: Image, now: Image, nearest: Sequence[Click], frame: int
) -> tuple[float, float] | None:
    """Where the point is in a frame; None if the image does not show it near the predicted place.

    Args:
        before: grey image in which `nearest[0]` was clicked; now: that of the frame.
        nearest: one or two clicks, as of `nearest_clicks`.
    """
    last, speed = nearest[0], velocity(nearest)
    at, whole = np.array([last.u, last.v]), _pixel(last.u, last.v)
    step = np.zeros(2) if speed is None else speed * (frame - last.frame)
    reach = max(REACH_PX, round(REACH_OF_STEP * float(np.linalg.norm(step))))
    if speed is None:
        reach = max(reach, round(REACH_UNKNOWN * now.shape[1]))
    there = _pixel(*(at + step))
    sought, area = _square(before, whole, HALF), _square(now, there, HALF + reach)
    if sought is None or area is None or sought.std() < 1.0:
        return None
    scores = cv2.matchTemplate(area, sought, cv2.TM_CCOEFF_NORMED)
    _, alike, _, best = cv2.minMaxLoc(scores)
    if not alike >= ALIKE:
        return None
    found = there - reach + np.array(best)
    one, two = _square(before, whole, 3 * HALF), _square(now, found, 3 * HALF)
    if one is None or two is None:
        return None
    start = (at - whole + 3 * HALF).astype(np.float32).reshape(1, 1, 2)
    fine, is_found, _ = cv2.calcOpticalFlowPyrLK(
        one,
        two,
        start,
        start.copy(),
        winSize=(2 * HALF + 1,) * 2,
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    shift = np.asarray(fine - start, np.float64).reshape(2)
    shift *= bool(is_found.item()) and np.linalg.norm(shift) <= FINEST_PX
    u, v = at + (found - whole) + shift
    return float(u), float(v)


def corner_at(image: Image, point: tuple[float, float]) -> tuple[float, float]:
    """The corner near a click, where edges meet."""
    middle = _pixel(*point)
    if (part := _square(image, middle, 3 * HALF)) is None:
        raise StereocalError("The click is outside the picture.")
    start = (np.array(point) - middle + 3 * HALF).astype(np.float32).reshape(1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.001)
    shift = (cv2.cornerSubPix(part, start.copy(), (HALF // 2,) * 2, (-1, -1), stop) - start).ravel()
    if not 0 < np.abs(shift).max() <= HALF / 2:
        raise StereocalError("There is no corner at the click: click nearer to one, or with shift.")
    return point[0] + float(shift[0]), point[1] + float(shift[1])


def _pixel(u: float, v: float) -> Pixel:
    return np.round([u, v]).astype(np.int64)


def _square(image: Image, middle: Pixel, half: int) -> Image | None:
    """The square about a pixel, continued at the edges; None if its middle is outside the image."""
    height, width = image.shape
    if not (0 <= middle[0] < width and 0 <= middle[1] < height):
        return None
    (u, v), (right, below) = middle - half, middle + half + 1
    part = image[max(v, 0) : below, max(u, 0) : right]
    edges = max(-v, 0), max(below - height, 0), max(-u, 0), max(right - width, 0)
    return np.asarray(cv2.copyMakeBorder(part, *edges, cv2.BORDER_REPLICATE), np.uint8)
