"""Are the stated errors of a lens true, and are fisheyes found?

    python -m benchmarks.lenses [brown|fisheyes|errors|forecast] [--trials N]

- brown: series of a chessboard (18x12 inner corners, 2336x1728 px, 0.1 px of noise on every corner)
  are calibrated as in the paper; each parameter's error is divided by what was stated;
- fisheyes (2 minutes of CPU): lenses of 175 to 220 degrees (`tests.rigs.fisheyes`) from 5 to 15
  boards of 4x5 to 8x6 corners, half of them at the rim, noise of 0.1 to 0.5 px; a fit has converged
  if its error is that of a fit from the true lens. The peer is OpenCV's `fisheye.calibrate`, with
  its own start and with the best of ours;
- errors: those of fisheyes over the stated ones, 8 to 24 boards;
- forecast: are 95 % of the lengths of fresh boards within what is forecast? Pairs side by side and
  facing each other, lenses from the same 20 boards; and bars before fisheyes of 150 degrees.
"""

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from benchmarks.studies import Asked, exact_interval, rms, run_studies, spread
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.fisheye_fit import STARTS
from stereocal.intrinsics.lens_fit import (
    FEWEST_VIEWS,
    PARAMETERS,
    LensSettings,
    better_model,
    camera_of,
    held_out_px,
    residuals_of,
    rms_px,
    solve_lens,
)
from stereocal.intrinsics.stereo_boards import found_of, lenses_of_boards
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.rigid_object import BoardPattern
from stereocal.simulation.simulate import field_rig, observe
from stereocal.system.array_types import FloatArray
from stereocal.verdict.forecast import forecast_files
from stereocal.workflow.pair_run import PairRun
from tests.fisheye_rig import NOISE_PX as OF_BARS_PX
from tests.fisheye_rig import recording as recording_of_bars
from tests.lens import AtOnce
from tests.rigs.fisheyes import draw_boards, draw_case, draw_fisheye, draw_pairs, radius_of
from tools.photographs.board_series import draw_board_poses, true_corners
from tools.photographs.rendering import turned

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


def brown(asked: Asked) -> None:
    """Errors over the spread of the draws, over the stated errors, and OpenCV's over its own."""
    camera = field_rig().primary
    K = camera.K
    true = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion])
    print(f"{'':>22} " + " ".join(f"{name:>6}" for name in PARAMETERS))
    with ThreadPoolExecutor() as executor:
        for photographs, subset in CASES:
            rng = np.random.default_rng(0)
            rows: dict[str, list[FloatArray]] = {}
            for _ in asked.numbers:
                search = series(camera, photographs, rng)
                lens = calibrate_lens(search, LensSettings(subset), executor)
                error, of_all = lens.values - true, lens.of_all - true
                rows.setdefault("error / spread", []).append(error / lens.spread)
                rows.setdefault("error / stated", []).append(error / lens.standard_errors)
                rows.setdefault("all / OpenCV's", []).append(of_all / opencv_errors(search))
            print(f"  {subset} of {photographs} photographs")
            for title, ratios in rows.items():
                each = np.sqrt(np.mean(np.square(ratios), axis=0))
                print(f"{title:>22} " + " ".join(f"{value:6.2f}" for value in each))


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


def fisheyes(asked: Asked) -> None:
    """Print how many are found, and how well they predict."""
    refused, missed, ratios, peers, proposed, compared = 0, 0, [], np.zeros(2, int), 0, 0
    for seed in asked.numbers:
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
    print(f"  refused {exact_interval(refused, asked.trials)}")
    print(f"  not the fit from the true lens {exact_interval(missed, asked.trials)}")
    print(f"  held-out error over the true lens's: {spread(ratios)}")
    print(f"  from {FEWEST_VIEWS} boards on, fisheye instead of brown: {proposed} of {compared}")
    print(f"  OpenCV finds {peers[0]} from its own start, {peers[1]} of {len(STARTS)} starts")


def errors(asked: Asked) -> None:
    """Print errors over stated errors, of the parameters and of images at 70 degrees."""
    found, shifts = [], []
    for seed in asked.numbers:
        rng = np.random.default_rng(5000 + seed)
        lens, pattern = draw_fisheye(rng), BoardPattern(8, 6, 0.03)
        boards = draw_boards(lens, pattern, int(rng.integers(8, 25)), rng.uniform(0.1, 0.5), rng)
        fit = calibrate_lens(boards, SETTINGS, AtOnce())
        error, sigma = fit.of_all[:8] - lens.values, fit.standard_errors[:8]
        found.append(error / sigma)
        angle = np.radians(np.array([70.0]))
        by_k = lens.values[0] * angle ** np.array([3, 5, 7, 9])
        moves = np.array([*radius_of(angle, lens.values[4:]), 0.0, 1.0, 0.0, *by_k])
        covariance = fit.correlation * np.outer(sigma, sigma)
        shifts.append(moves @ error / np.sqrt(moves @ covariance @ moves))
    each = " ".join(f"{rms(own):.2f}" for own in np.transpose(found))
    print(f"  rms z of fx fy cx cy k1 k2 k3 k4: {each}; of images at 70 degrees {rms(shifts):.2f}")


def forecast(asked: Asked) -> None:
    """Print the forecast of 95 % of lengths over the truth, and how often its interval holds it."""
    across = turned([0.02, np.pi - 0.03, 0.01])
    rigs = {
        "side by side": Pose(turned([0.02, 0.2, 0.03]), np.array([-0.3, 0.01, 0.02])),
        "facing": Pose(across, -across @ np.array([0.01, 0.02, 0.6])),
    }
    for name, rig in rigs.items():
        report(name, [of_boards(rig, seed) for seed in asked.numbers])
    report("bars, 150 degrees", [of_bars(seed) for seed in asked.numbers])


def report(name: str, each: list[tuple[Estimate, float]]) -> None:
    """Print a line on forecasts and the true values."""
    ratios = [own.value / true for own, true in each]
    inside = sum(own.low <= true <= own.high for own, true in each)
    print(f"  {name}: forecast over truth {spread(ratios, 100)}, inside {inside} of {len(each)}")


def of_boards(rig: Pose, seed: int) -> tuple[Estimate, float]:
    """The forecast of 95 % of lengths, and the truth on the diagonals of 200 fresh boards."""
    rng, pattern = np.random.default_rng(seed), BoardPattern(8, 6, 0.03)
    pair = draw_fisheye(rng), draw_fisheye(rng)
    boards = draw_pairs(pair, rig, pattern, 20, 0.2, rng)
    found = {name: lens.camera for name, lens in lenses_of_boards(boards, None, AtOnce()).items()}
    recording = found_of(boards, found).recording
    data = with_baseline_found(recording.pair("primary", "secondary"))
    fresh = draw_pairs(pair, rig, pattern, 200, 0.2, rng).of_pair("primary", "secondary")
    corners = [0, len(pattern.points) - 1, pattern.columns - 1, -pattern.columns]
    points = [np.concatenate([v.views[k].corners[corners] for v in fresh]) for k in (0, 1)]
    return judged(data, points[0], points[1], float(np.linalg.norm(pattern.points[-1])))


def of_bars(seed: int) -> tuple[Estimate, float]:
    """The same of bars, from 30 frames."""
    data, scene = recording_of_bars(150.0, 1000 + seed, 30)
    _, fresh = recording_of_bars(150.0, 5000 + seed, 400)
    test = observe(replace(fresh, rig=scene.rig), np.random.default_rng(seed), OF_BARS_PX, "test")
    rows = test.correspondences
    at = rows.bars.ravel()
    return judged(data, rows.primary[at], rows.secondary[at], test.target_distance_m)


def judged(
    data: Pair, primary: FloatArray, secondary: FloatArray, length_m: float
) -> tuple[Estimate, float]:
    """The forecast, and the truth on pixels (2 n, 2) of the ends of bars, one after the other."""
    calibration = PairRun(data).calibration
    found = calibration.refined
    assert found is not None
    applied = found.apply(data)
    rig = Rig(applied.primary, applied.secondary, found.pose)
    one, other = rig.primary.undistort(primary), rig.secondary.undistort(secondary)
    seen = rig.primary.uses(one) & rig.secondary.uses(other)
    points = np.where(seen[:, None], rig.reconstruct(primary, secondary), np.nan)
    points = points.reshape(-1, 2, 3)
    lengths = np.linalg.norm(points[:, 0] - points[:, 1], axis=1)
    true = float(np.nanquantile(np.abs(lengths / length_m - 1.0), 0.95))
    return forecast_files(calibration).draws.figures["refined"].p95_error_3d, true


if __name__ == "__main__":
    warnings.simplefilter("error")
    studies = {
        "brown": (brown, 40),
        "fisheyes": (fisheyes, 200),
        "errors": (errors, 40),
        "forecast": (forecast, 20),
    }
    run_studies(studies, __doc__)
