"""Fit a fisheye to boards by OpenCV's `fisheye.calibrate`, which needs a start near the lens."""

from contextlib import suppress
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
UNDETERMINED = (
    "The boards determine no lens: take photographs with the board tilted in different directions."
)
STARTS = np.geomspace(0.2, 0.7, 10)
"""Focal lengths over the longer side of the image from which a fisheye is fitted: lenses of 80 to
290 degrees. OpenCV's own start is half the side; real fisheyes of 180 degrees converge only from
0.9 to 1.2 times their focal length."""
LOST = 0.02
"""RMS over the longer side of the image of a fit that found no lens. Fits of a real fisheye with
f = 337 px from wrong starts ended at 140 to 1300 px of 1032, right ones at 0.64."""


def fit_fisheye(boards: tuple[Any, Any, tuple[int, int]], start: FloatArray | None) -> FloatArray:
    """(9,): fx, fy, cx, cy, k1 to k4 and 0, of the fit with the smallest error.

    Args:
        boards: of each view (1, n, 3) points on the board and (1, n, 2) px; width and height.
        start: as returned; None: the best of `STARTS`.

    Raises:
        StereocalError: the boards determine no lens.
    """
    width, height = boards[2]
    side, rest = max(width, height), [0.5 * (width - 1), 0.5 * (height - 1), *[0.0] * 5]
    starts = [[part * side, part * side, *rest] for part in STARTS] if start is None else [start]
    # OpenCV 5 has the names in another module than OpenCV 4.
    of: Any = cv2 if hasattr(cv2, "CALIB_RECOMPUTE_EXTRINSIC") else cv2.fisheye
    flags = of.CALIB_RECOMPUTE_EXTRINSIC | of.CALIB_FIX_SKEW | of.CALIB_USE_INTRINSIC_GUESS
    best: FloatArray | None = None
    least = LOST * side
    for fx, fy, cx, cy, *k in starts:
        K, distortion = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(k[:4])[:, None]
        # Far from the lens, it divides by zero or finds no pose.
        with suppress(cv2.error):
            error, K, distortion, *_ = cv2.fisheye.calibrate(
                *boards, K, distortion, flags=flags, criteria=CRITERIA
            )
            if error < least and min(K[0, 0], K[1, 1]) > 0:
                found = K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(distortion)[:4], 0.0
                best, least = np.array(found), error
    if best is None:
        raise StereocalError(UNDETERMINED)
    return best
