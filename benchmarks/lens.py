"""Are the stated errors of a lens true? `python -m benchmarks.lens [--lenses 40]`

Simulated series of a chessboard (18x12 inner corners, 2336x1728 px, 0.1 px of noise on every
corner) are calibrated as in the paper; each parameter's error is divided by what was stated.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from benchmarks.studies import numbers_asked
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import PARAMETERS, LensSettings
from stereocal.rig.camera import Camera
from stereocal.rig.rigid_object import BoardPattern
from stereocal.simulation.simulate import field_rig
from stereocal.system.array_types import FloatArray
from tools.photographs.board_series import draw_board_poses, true_corners

PATTERN = BoardPattern(18, 12, 0.03)
CASES = ((50, 20), (30, 20), (25, 20))
"""Photographs, and how many of them a draw takes."""
NOISE_PX = 0.1


def series(camera: Camera, count: int, rng: np.random.Generator) -> BoardSearch:
    """Found corners of a series of boards."""
    views = []
    for at, pose in enumerate(draw_board_poses(camera, rng, count)):
        corners = true_corners(camera, pose)
        noise = NOISE_PX * rng.normal(size=corners.shape)
        views.append(BoardView(f"{at}", camera.image_size, np.arange(216), corners + noise))
    return BoardSearch(PATTERN, tuple(views), ())


def opencv_errors(search: BoardSearch) -> FloatArray:
    """(9,): the standard deviations that OpenCV states for a fit to all photographs."""
    points = PATTERN.points.astype(np.float32)
    found = cv2.calibrateCameraExtended(
        [points] * len(search.views),
        [view.corners.astype(np.float32) for view in search.views],
        search.image_size,
        np.eye(3),
        np.zeros(5),
    )
    return np.asarray(found[5], dtype=np.float64).ravel()[:9]


def main() -> None:
    """Print a table for each case."""
    count = numbers_asked(__doc__, lenses=40).lenses
    camera = field_rig().primary
    K = camera.K
    true = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion])
    print(f"{'':>22} " + " ".join(f"{name:>6}" for name in PARAMETERS))
    with ThreadPoolExecutor() as executor:
        for photographs, subset in CASES:
            rng, started = np.random.default_rng(0), time.process_time()
            rows: dict[str, list[FloatArray]] = {}
            for _ in range(count):
                search = series(camera, photographs, rng)
                lens = calibrate_lens(search, LensSettings(subset), executor)
                error, of_all = lens.values - true, lens.of_all - true
                rows.setdefault("error / spread", []).append(error / lens.spread)
                rows.setdefault("error / stated", []).append(error / lens.standard_errors)
                rows.setdefault("all / OpenCV's", []).append(of_all / opencv_errors(search))
            seconds = (time.process_time() - started) / count
            print(f"{subset} of {photographs}, {count} lenses, {seconds:.1f} s CPU each")
            for title, ratios in rows.items():
                rms = np.sqrt(np.mean(np.square(ratios), axis=0))
                print(f"{title:>22} " + " ".join(f"{value:6.2f}" for value in rms))


if __name__ == "__main__":
    main()
