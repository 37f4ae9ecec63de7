"""Are fisheyes found from boards? `python -m benchmarks.fisheyes [--lenses 200]`

Simulated lenses of 175 to 220 degrees (`tests/rigs/fisheyes.py`): 5 to 15 boards of 4x5 to 8x6
corners, half of them at the rim, noise of 0.1 to 0.5 px. A fit has converged if its error is that
of a fit from the true lens. The peer is OpenCV's `fisheye.calibrate`, with its own start and with
the best of ours.
"""

from typing import Any

import cv2
import numpy as np

from benchmarks.studies import exact_interval, numbers_asked
from stereocal.errors import StereocalError
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.fisheye_fit import STARTS
from stereocal.intrinsics.lens_fit import (
    FEWEST_VIEWS,
    LensSettings,
    better_model,
    camera_of,
    held_out_px,
    residuals_of,
    rms_px,
    solve_lens,
)
from stereocal.rig.compiled import FloatArray
from tests.rigs.fisheyes import draw_case

SETTINGS = LensSettings(model="fisheye")
SAME = 1.001
"""Error of a fit over that of a fit from the true lens, up to which it is the same fit."""
NEAR = 0.05
"""Relative error of the focal length up to which OpenCV is counted as having found a lens."""


def error_of(values: FloatArray, boards: BoardSearch) -> float:
    """RMS of the residuals with a pose of each board, px."""
    camera = camera_of(values, boards.image_size, "fisheye")
    return rms_px(np.concatenate([residuals_of(camera, boards.pattern, v) for v in boards.views]))


def opencv(boards: BoardSearch, starts: FloatArray) -> float:
    """fx of OpenCV's best fit, from its own start (none) or from focal lengths in px; 0 if none."""
    width, height = boards.image_size
    seen = (
        [boards.pattern.points[view.ids][None] for view in boards.views],
        [view.corners[None] for view in boards.views],
        boards.image_size,
    )
    # OpenCV 5 has the names in another module than OpenCV 4.
    of: Any = cv2 if hasattr(cv2, "CALIB_RECOMPUTE_EXTRINSIC") else cv2.fisheye
    least, fx = np.inf, 0.0
    for f in starts if len(starts) else [0.0]:
        K = np.array([[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]])
        flags = of.CALIB_RECOMPUTE_EXTRINSIC | of.CALIB_FIX_SKEW
        flags |= of.CALIB_USE_INTRINSIC_GUESS * bool(f)
        try:
            error, K, *_ = cv2.fisheye.calibrate(*seen, K, np.zeros((4, 1)), flags=flags)
        except cv2.error:
            continue
        if error < least:
            least, fx = error, float(K[0, 0])
    return fx


def main() -> None:
    """Print how many are found, and how well they predict."""
    count = numbers_asked(__doc__, lenses=200).lenses
    refused, missed, ratios, peers, proposed, compared = 0, 0, [], np.zeros(2, int), 0, 0
    for seed in range(count):
        lens, boards, tested = draw_case(seed)
        about = boards.pattern, boards.views, boards.image_size, SETTINGS
        focal = np.array([opencv(boards, s * max(lens.image_size)) for s in (STARTS[:0], STARTS)])
        peers += np.abs(focal / lens.values[0] - 1.0) < NEAR
        if len(boards.views) >= FEWEST_VIEWS:
            compared += 1
            proposed += better_model(held_out_px(boards, SETTINGS), "brown") == "fisheye"
        try:
            values = solve_lens(*about)
        except StereocalError:
            refused += 1
            continue
        true = np.append(lens.values, 0.0)
        missed += error_of(values, boards) > SAME * error_of(solve_lens(*about, true), boards)
        ratios.append(error_of(values, tested) / error_of(true, tested))
    print(f"refused {exact_interval(refused, count)}")
    print(f"not the fit from the true lens {exact_interval(missed, count)}")
    low, middle, high = np.percentile(ratios, (5, 50, 95))
    print(f"held-out error over the true lens's: {middle:.3f} ({low:.3f} to {high:.3f})")
    print(
        f"from {FEWEST_VIEWS} boards on, fisheye proposed instead of brown: {proposed}/{compared}"
    )
    print(
        f"OpenCV finds, from its own start: {peers[0]}/{count}; of {len(STARTS)} starts: {peers[1]}"
    )


if __name__ == "__main__":
    main()
