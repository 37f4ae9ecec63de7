"""A board before two cameras, against OpenCV's `stereoCalibrate`.

    python -m benchmarks.boards [halves|bootstrap] [--trials N] [--data sample_data/boards]

- halves: lenses and pose from a random half of the boards, the other half tested. Both have the
  lens of `calibrateCamera`; `stereoCalibrate` holds it, the refined set moves it within its
  standard errors;
- bootstrap: the spread over boards drawn with replacement, lenses included, over the stated
  standard errors.
"""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.studies import SAMPLES, Asked, run_studies
from stereocal.fit.parameter_file import standard_errors
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.frames.pairing import Pairing, pair_names
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import calibrate_lens
from stereocal.intrinsics.lens_fit import LensSettings, solve_lens
from stereocal.intrinsics.stereo_boards import StereoBoards, find_stereo_boards, found_of
from stereocal.rig.camera import CAMERAS, Camera, LensUncertainty
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from tests.photographs.lens import AtOnce

OPENCV = BoardPattern(9, 6, 0.03)
BOTH: tuple[str, str] = CAMERAS
SETTINGS = LensSettings(subset=4, fix_k3=True)
ENDS = np.array([(i, 53 - i) for i in range(27)])


def boards_in(folder: Path) -> StereoBoards:
    files = {p.name: p for p in folder.glob("*.jpg")}
    about = pair_names(files), files, dict.fromkeys(BOTH), OPENCV
    found = find_stereo_boards(*about, AtOnce(), lambda _: None)
    print(found.sentence)
    return found


def some(boards: StereoBoards, chosen: Collection[int]) -> StereoBoards:
    """Those of the common boards with these indices, which may repeat, numbered anew."""
    seen = boards.of_pair(*BOTH)
    views = [seen[at].views for at in chosen]
    moments = {i: {camera: f"{camera}{i}" for camera in BOTH} for i in range(len(views))}
    searches = {
        camera: BoardSearch(
            OPENCV, tuple(replace(v[c], name=f"{camera}{i}") for i, v in enumerate(views))
        )
        for c, camera in enumerate(BOTH)
    }
    return StereoBoards(Pairing(moments), searches, {})


def camera_of(search: BoardSearch, known: LensUncertainty | None) -> Camera:
    """The lens from all boards at once."""
    v = solve_lens(OPENCV, search.views, search.image_size, SETTINGS)
    K = np.array([[v[0], 0.0, v[2]], [0.0, v[1], v[3]], [0.0, 0.0, 1.0]])
    return Camera(K, v[4:], search.image_size, known)


def uncertainties(boards: StereoBoards, subset: int) -> list[LensUncertainty | None]:
    found = []
    for search in boards.searches.values():
        own = replace(SETTINGS, subset=subset)
        lens = calibrate_lens(search, own, AtOnce(), without_each=True)
        found.append(lens.camera.uncertainty)
    return found


def cameras_of(boards: StereoBoards, known: list[LensUncertainty | None]) -> dict[str, Camera]:
    searches = boards.searches.items()
    return {name: camera_of(own, of) for (name, own), of in zip(searches, known, strict=True)}


def refined(boards: StereoBoards, known: list[LensUncertainty | None]) -> RefinedResult:
    found = found_of(boards, cameras_of(boards, known)).recording
    return refine(with_baseline_found(found.pair(*BOTH)))


def by_opencv(boards: StereoBoards, cameras: tuple[Camera, Camera]) -> Rig:
    searches = boards.searches.values()
    views = [[v.corners.astype(np.float32) for v in search.views] for search in searches]
    points = [OPENCV.points.astype(np.float32)] * len(views[0])
    K1, D1, K2, D2 = (part.copy() for camera in cameras for part in (camera.K, camera.distortion))
    found: Any = cv2.stereoCalibrate(
        points,
        views[0],
        views[1],
        K1,
        D1,
        K2,
        D2,
        cameras[0].image_size,
        np.eye(3),
        np.zeros((3, 1)),
        flags=cv2.CALIB_FIX_INTRINSIC,
        criteria=(3, 200, 1e-12),
    )
    R, T = (np.asarray(part, dtype=np.float64) for part in found[5:7])
    return Rig(*cameras, Pose(R, T.ravel()))


def errors(rig: Rig, boards: StereoBoards) -> tuple[float, float]:
    """Mean distance from the epipolar lines in px, and mean error of 27 lengths a board in %."""
    px, lengths = [], []
    true = np.linalg.norm(np.diff(OPENCV.points[ENDS], axis=1)[:, 0], axis=1)
    for seen in boards.of_pair(*BOTH):
        first, second = (view.corners for view in seen.views)
        px.append(rig.epipolar_distances(first, second).mean())
        points = rig.reconstruct(first, second)
        found = np.linalg.norm(np.diff(points[ENDS], axis=1)[:, 0], axis=1)
        lengths.append(np.abs(found / true - 1).mean())
    return float(np.mean(px)), 100 * float(np.mean(lengths))


def halves(asked: Asked) -> None:
    """Seven of the boards fitted, the others tested."""
    boards, rows = boards_in(Path(asked.data)), []
    for seed in asked.numbers:
        order = np.random.default_rng(seed).permutation(len(boards.seen))
        fitted, tested = some(boards, order[:7]), some(boards, order[7:])
        ours = refined(fitted, uncertainties(fitted, 4))
        first, second = cameras_of(fitted, [None, None]).values()
        theirs = by_opencv(fitted, (first, second))
        rows.append([*errors(theirs, tested), *errors(ours.rig, tested)])
    mean = np.mean(rows, axis=0)
    print(
        f"stereoCalibrate {mean[0]:.3f} px {mean[1]:.3f} %, refined {mean[2]:.3f} px "
        f"{mean[3]:.3f} %: {mean[2] / mean[0]:.2f} and {mean[3] / mean[1]:.2f} times"
    )


def bootstrap(asked: Asked) -> None:
    """Stated standard errors over the spread."""
    boards = boards_in(Path(asked.data))
    whole = some(boards, range(13))
    known = uncertainties(whole, 20)
    one = refined(whole, known)
    stated = standard_errors(one.covariance, one.rig)
    found: list[FloatArray] = []
    for seed in asked.numbers:
        chosen = np.random.default_rng(seed).choice(13, 13)
        fit = refined(some(boards, chosen), known)
        own = standard_errors(fit.covariance, fit.rig).values()
        found.append(np.array([value.value for value in own]))
    spread = np.std(found, axis=0)
    for (name, value), own in zip(stated.items(), spread, strict=True):
        print(
            f"{name:14} {value.value:10.5f} stated {value.sigma:.5f} spread {own:.5f} "
            f"stated/spread {value.sigma / own:.2f}"
        )


if __name__ == "__main__":
    studies = {"halves": (halves, 10), "bootstrap": (bootstrap, 100)}
    run_studies(studies, __doc__, data=str(SAMPLES / "boards"))
