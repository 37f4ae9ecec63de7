"""Targets in photographs: accuracy against OpenCV and the Cramer-Rao bound, clutter, seconds.

python -m benchmarks.detection [pairs]
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from stereocal.backgrounds import outdoors
from stereocal.camera import Camera
from stereocal.compiled import FloatArray
from stereocal.corner_fit import window
from stereocal.corner_model import ALL, CORE, FRAME, fill_frame, fill_rows
from stereocal.detection import Detection, corner_near, detect_targets
from stereocal.labelling import label_targets
from stereocal.photographs import BarSettings, photograph_bars, place_visible_bars
from stereocal.rendering import Photograph, PhotographSettings
from stereocal.simulate import field_rig
from tests.boards import Board, picture, plane_to_image

RENDERS = 200
WINDOWS = (2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 20, 30)
PER_SCENE = 10
"""Pairs of one background: the geometry of all of them tells A and B apart."""
WRONG_PX = 1.0


@dataclass(frozen=True)
class Case:
    """One render: a board, the noise, its picture."""

    board: Board
    noise: float
    size: int
    seed: int

    def picture(self) -> Photograph:
        """(size, size), with a board on grey."""
        fine = 8 if self.board.side < 120 else 4
        grey = float(np.random.default_rng([2, self.seed]).uniform(20, 230))
        return picture(self.board, (self.size, self.size), self.noise, self.seed, grey, fine)


def cases(count: int) -> Iterator[Case]:
    """Noise 0 to 8 grey levels, blur 0.5 to 3 px, tilt to 60 degrees, contrast from 40, boards of
    20 to 400 px."""
    for seed in range(count):
        rng = np.random.default_rng([1, seed])
        side = float(np.exp(rng.uniform(np.log(20), np.log(400))))
        size = int(1.3 * side + 20)
        contrast = rng.uniform(40, 200)
        middle = rng.uniform(contrast / 2 + 5, 250 - contrast / 2)
        u, v = (size / 2 + rng.uniform(-0.5, 0.5, 2)).tolist()
        board = Board(
            (u, v),
            side,
            turn=rng.uniform(0, 2 * np.pi),
            tilt=np.deg2rad(rng.uniform(0, 60)),
            tilt_axis=rng.uniform(0, 2 * np.pi),
            blur=rng.uniform(0.5, 3),
            black=middle - contrast / 2,
            white=middle + contrast / 2,
        )
        yield Case(board, float(rng.uniform(0, 8)), size, seed)


def bound(case: Case) -> FloatArray:
    """(2, 2): the Cramer-Rao bound of the centre for all pixels of the board.

    Unknown: the centre, both directions, blur, offset, contrast. The noise is the sensor's with
    that of rounding; the border of the board, which could tell more, is left out.
    """
    board = case.board
    H = plane_to_image(board)
    ends = H @ np.array([[1e-4, 0, 1], [0, 1e-4, 1], [0, 0, 1]]).T
    flat = ends[:2] / ends[2]
    along: FloatArray = np.asarray((flat[:, :2] - flat[:, 2:]).T * 1e4)
    lengths: FloatArray = np.sqrt((along**2).sum(axis=1))
    p = np.zeros(ALL)
    p[:2] = board.centre
    p[2:4] = [np.arctan2(-a[0], a[1]) for a in along]
    p[4], p[6] = 0.5 * np.log(board.blur**2 + 1 / 12), (board.white - board.black) / 2
    grey = np.zeros((case.size, case.size), np.float32)
    pixels = window(grey, p[0], p[1], along / lengths[:, None], lengths / 2, 1)
    frame, rows = np.empty(FRAME), np.empty((ALL + 1, len(pixels)))
    fill_frame(p, 1.0, 1, frame)
    fill_rows(p, frame, pixels, rows)
    J = rows[:CORE].T
    inverse: FloatArray = np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)[:2, :2]
    return inverse * (case.noise**2 + 1 / 12)


def subpix(image: Photograph, start: FloatArray, half: int) -> FloatArray:
    """OpenCV's corner, (2,)."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    point = start.astype(np.float32).reshape(1, 1, 2)
    return np.asarray(
        cv2.cornerSubPix(image, point, (half, half), (-1, -1), criteria), dtype=float
    ).ravel()


def accuracy(count: int = RENDERS) -> None:
    """Ours against OpenCV and the bound, on the same renders from the same starts."""
    ours, normal, least, seconds, sizes = [], [], [], [], []
    peers: dict[int, list[float]] = {half: [] for half in WINDOWS}
    dominated = []
    for case in cases(count):
        image, truth = case.picture(), np.array(case.board.centre)
        start = truth + np.random.default_rng([3, case.seed]).uniform(-0.7, 0.7, 2)
        began = time.thread_time()
        corner = corner_near(image, (float(start[0]), float(start[1])))
        seconds.append(time.thread_time() - began)
        for half in WINDOWS:
            fits = 2 * half + 5 < case.size
            place = subpix(image, start, half) if fits else start
            peers[half].append(float(np.linalg.norm(place - truth)))
        if corner is None:
            print(f"  not found: {case}")
        error = corner.centre - truth if corner else np.full(2, np.nan)
        ours.append(float(np.linalg.norm(error)))
        covariance = corner.covariance if corner else np.eye(2)
        normal.append(np.linalg.solve(np.linalg.cholesky(covariance), error))
        least.append(float(np.trace(bound(case))))
        shortest = case.board.side * np.cos(case.board.tilt)
        dominated.append(
            case.noise > 1 and case.board.blur > 0.8 and shortest > 12 * case.board.blur
        )
        sizes.append(case.board.side)
    found = np.isfinite(ours)
    e = np.array(ours)

    def pooled(values: FloatArray) -> float:
        return float(np.sqrt(np.mean(values[found] ** 2)))

    by_window = {half: pooled(np.array(errors)) for half, errors in peers.items()}
    best = min(by_window, key=lambda half: by_window[half])
    oracle = np.min(list(peers.values()), axis=0)
    print(f"found {found.sum()} of {count}; CPU {1e3 * np.median(seconds):.1f} ms a corner")
    print(f"pooled RMS: ours {pooled(e):.4f} px, median {np.median(e[found]):.4f} px")
    print(
        f"cornerSubPix: {by_window[best]:.4f} px at its best window {best} "
        f"(ratio {pooled(e) / by_window[best]:.3f}), median {np.median(peers[best]):.4f} px; with "
        f"each picture's own best {pooled(oracle):.4f} px (ratio {pooled(e) / pooled(oracle):.3f})"
    )
    z = np.array(normal)[found]
    print(
        f"normalised errors: std {z.std():.2f}, {1.4826 * np.median(np.abs(z)):.2f} by the median"
    )
    use = found & np.array(dominated)
    ratio = np.sqrt(np.mean(e[use] ** 2) / np.mean(np.array(least)[use]))
    each = np.sqrt(np.mean(e[use] ** 2 / np.array(least)[use]))
    print(
        f"Cramer-Rao, {use.sum()} pictures where blur and noise dominate: pooled RMS {ratio:.2f} "
        f"times the bound; each to its own {each:.2f}"
    )
    bands = ((20, 40), (40, 100), (100, 200), (200, 400))
    for low, high in bands:
        band = found & (np.array(sizes) >= low) & (np.array(sizes) < high)
        print(
            f"  boards of {low} to {high} px: ours {np.sqrt(np.mean(e[band] ** 2)):.4f} px, "
            f"cornerSubPix {np.sqrt(np.mean(np.array(peers[best])[band] ** 2)):.4f} px, "
            f"normalised {z[band[found]].std():.2f}"
        )


def right(detection: Detection, centres: FloatArray) -> bool:
    """Both targets are where they are, in either order."""
    if detection.targets is None:
        return False
    found = np.array([corner.centre for corner in detection.targets])
    off = min(np.abs(found - centres).max(), np.abs(found - centres[::-1]).max())
    return bool(off < WRONG_PX)


def clutter(pairs: int) -> None:
    """Full-size pairs with houses, leaves, fences and a chessboard; labels and seconds."""
    states: Counter[str] = Counter()
    frames: Counter[str] = Counter()
    seconds, errors = [], []
    good = wrong_sure = labelled = mislabelled_sure = 0
    rig = field_rig()
    cameras: tuple[Camera, Camera] = (rig.primary, rig.secondary)
    for scene_number in range(pairs // PER_SCENE):
        rng = np.random.default_rng([4, scene_number])
        scene = place_visible_bars(rig, rng, PER_SCENE, 0.9)
        backgrounds = outdoors(rig, rng, softness_px=float(rng.uniform(0, 2)))
        black, white = rng.uniform(20, 60), rng.uniform(110, 220)
        bar = BarSettings(black=black, white=white, tilt_rad=(0.0, float(np.deg2rad(60))))
        settings = PhotographSettings(
            blur_px=float(rng.uniform(0.5, 2)), read_noise=float(rng.uniform(0.5, 6))
        )
        found: tuple[dict[int, Detection], dict[int, Detection]] = ({}, {})
        truth = {}
        for pair in photograph_bars(scene, backgrounds, bar, settings, rng):
            truth[pair.frame] = (pair.centres_primary, pair.centres_secondary)
            for which, image in enumerate((pair.primary, pair.secondary)):
                began = time.thread_time()
                detection = detect_targets(image)
                seconds.append(time.thread_time() - began)
                found[which][pair.frame] = detection
                states[detection.state] += 1
                ok = right(detection, truth[pair.frame][which])
                wrong_sure += detection.state == "found" and not ok
                if not ok:
                    print(f"  scene {scene_number}, {pair.frame}, {which}: {detection.sentence}")
        labelling = label_targets(found[0], found[1], cameras)
        frames.update(report.state for report in labelling.frames)
        for frame, centres in truth.items():
            both = all(right(found[i][frame], centres[i]) for i in range(2))
            good += both
            rows = [pair for pair in labelling.pairs if pair.frame == frame]
            if not both:
                mislabelled_sure += any(row.sure for row in rows)
                continue
            places = np.array([[row.primary.centre, row.secondary.centre] for row in rows])
            off = places - np.stack(centres, axis=1)
            off = off if np.abs(off).max() < WRONG_PX else places - np.stack(centres, axis=1)[::-1]
            agree = bool(np.abs(off).max() < WRONG_PX)
            labelled += agree
            mislabelled_sure += not agree and rows[0].sure
            errors.append(off)
    total = sum(states.values()) // 2
    print(f"{total} pairs: both targets in both {good}, rightly labelled {labelled}")
    print(f"photographs {dict(states)}, wrong and sure {wrong_sure}")
    print(f"frames {dict(frames)}, wrong and sure {mislabelled_sure}")
    error = np.concatenate(errors).ravel()
    print(f"error of a coordinate: RMS {np.sqrt(np.mean(error**2)):.4f} px")
    middle, high = np.percentile(seconds[2:], [50, 95])
    print(f"CPU seconds a photograph: median {middle:.3f}, 95 % below {high:.3f}")


def main() -> None:
    """Measure and print."""
    cv2.setNumThreads(1)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    accuracy()
    clutter(int(sys.argv[1]) if len(sys.argv) > 1 else 200)


if __name__ == "__main__":
    main()
