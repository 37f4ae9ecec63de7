"""How long the refined method takes, and how much faster it is than SciPy.

    python -m benchmarks.refine

Both sides minimise over the same unknowns (pose, baseline, bar, both lenses, 13 numbers) with the
same priors, from the same start, in turn in one run; the ratio is taken within each turn. Times are
processor time of the thread, so that other work on the computer counts little.

- SciPy, no places: `least_squares` with finite differences; residuals are Sampson's form of the
  epipolar error and the length of the midpoints, vectorised in NumPy, OpenCV takes out the lens.
  What one writes in an afternoon. All bars have one weight, so that its result may differ from
  ours by up to 4 standard errors; that of the second must be the same to 0.01.
- SciPy, places kept: `least_squares` on our residuals with the places of all targets as unknowns
  and the sparsity of the Jacobian given.
"""

import os
import time
from collections.abc import Callable

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

from stereocal.calibration.essential import calibrate_essential
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import FACTOR, moved, pose_at, step_between
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.least_squares.views import EACH, LENS, OWN, Cameras
from stereocal.fit.refine import fit_from, refine
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose, stack_rays, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

SIGMA_PX, SCATTER_M = 0.2, 0.001
TURNS = 9
PRIMARY, SECONDARY = LENS, EACH + LENS
SETTINGS = RefineSettings(
    lenses=dict.fromkeys(CAMERAS, LensPrior(0.003, 5.0)),
    baseline_sigma_m=0.005,
    distance_sigma_m=0.0005,
    sigma_px=SIGMA_PX,
    scatter_m=SCATTER_M,
)


def lens(camera: Camera, values: FloatArray) -> FloatArray:
    """K with other fx, fy, cx, cy; OpenCV's own functions leave the skew out."""
    K = camera.K.copy()
    K[0, 0], K[1, 1], K[0, 2], K[1, 2] = values[:4]
    return K


class Unknown:
    """The cameras by free parameters, and what is known of these beside the images."""

    def __init__(self, begin: RobustFit) -> None:
        self.begin, self.unknowns = begin.at, begin.unknowns
        self.free = np.isfinite(self.unknowns.sigma)
        _, _, self.baseline_m, self.baseline_sigma_m = begin.baselines[0]

    def at(self, p: FloatArray) -> Cameras:
        """The cameras."""
        return moved(self.begin, self.unknowns.M @ p)

    def priors(self, p: FloatArray, pose: Pose) -> FloatArray:
        """Their residuals, and that of the measured baseline."""
        off = (pose.baseline - self.baseline_m) / self.baseline_sigma_m
        return np.append(p[self.free] / self.unknowns.sigma[self.free], off)


class Afternoon(Unknown):
    """The residuals without places, in NumPy."""

    def __init__(self, dataset: Pair, begin: RobustFit) -> None:
        super().__init__(begin)
        self.dataset = dataset
        rows = dataset.correspondences
        self.pixels = [np.ascontiguousarray(rows.primary), np.ascontiguousarray(rows.secondary)]

    def rays(self, q: FloatArray) -> FloatArray:
        """Undistorted rays (4, n) with the lenses of q; OpenCV's inverse."""
        found = []
        cameras: list[tuple[Camera, int]] = [
            (self.dataset.primary, PRIMARY),
            (self.dataset.secondary, SECONDARY),
        ]
        for (camera, at), pixels in zip(cameras, self.pixels, strict=True):
            inverse = np.linalg.inv(lens(camera, q[at:]))
            bent = np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T
            flat = np.ascontiguousarray(bent[:, None, :2])
            found.append(cv2.undistortPoints(flat, np.eye(3), camera.distortion)[:, 0])
        return stack_rays(found[0], found[1])

    def __call__(self, p: FloatArray) -> FloatArray:
        at = self.at(p)
        q, pose = at.q, pose_at(at)
        rays = self.rays(q)
        E = pose.essential
        ones = np.ones(rays.shape[1])
        first, second = np.vstack([rays[:2], ones]), np.vstack([rays[2:], ones])
        line_second, line_first = E @ first, E.T @ second
        value = np.sum(second * line_second, axis=0)
        slope = (line_second[0] / q[SECONDARY]) ** 2 + (line_second[1] / q[SECONDARY + 1]) ** 2
        slope += (line_first[0] / q[PRIMARY]) ** 2 + (line_first[1] / q[PRIMARY + 1]) ** 2
        sampson = value / np.sqrt(slope) / SIGMA_PX
        points = triangulate_rays(pose.R, pose.T, rays)
        bars = self.dataset.correspondences.bars
        lengths = np.linalg.norm(points[bars[:, 0]] - points[bars[:, 1]], axis=1)
        # A weight that ours finds for each bar: here one for all, from the mean depth.
        spread = 2.0 * np.median(points[:, 2]) * SIGMA_PX / q[PRIMARY]
        gaps = (lengths - q[FACTOR] * self.dataset.bar_distances_m) / np.hypot(SCATTER_M, spread)
        return np.concatenate([sampson, gaps, self.priors(p, pose)])

    def solve(self) -> FloatArray:
        """The 13 numbers."""
        start = np.zeros(len(self.unknowns.names))
        return np.asarray(least_squares(self, start, x_scale="jac").x)


class Kept(Unknown):
    """Our residuals with all places as unknowns."""

    def __init__(self, dataset: Pair, begin: RobustFit, start: Pose) -> None:
        super().__init__(begin)
        self.cameras = dataset.primary, dataset.secondary
        rows = dataset.correspondences
        order = rows.bars.ravel()
        self.seen = np.hstack([rows.primary[order], rows.secondary[order]])
        self.distances = dataset.bar_distances_m
        places = triangulate_rays(start.R, start.T, dataset.rays)[order]
        self.k = len(self.unknowns.names)
        self.start = np.concatenate([np.zeros(self.k), places.ravel()])
        frames = len(self.distances)
        pattern = lil_matrix(
            (9 * frames + int(self.free.sum()) + 1, len(self.start)), dtype=np.int8
        )
        pattern[:, : self.k] = 1
        for f in range(frames):
            columns = slice(self.k + OWN * f, self.k + OWN * (f + 1))
            pattern[8 * f : 8 * f + 8, columns] = 1
            pattern[8 * frames + f, columns] = 1
        self.sparsity = pattern

    def __call__(self, z: FloatArray) -> FloatArray:
        p = z[: self.k]
        at = self.at(p)
        q, pose = at.q, pose_at(at)
        places = z[self.k :].reshape(-1, 3)
        found = []
        for camera, place, points in (
            (self.cameras[0], PRIMARY, places),
            (self.cameras[1], SECONDARY, pose.apply(places)),
        ):
            K = lens(camera, q[place:])
            bent, _ = cv2.projectPoints(
                points, np.zeros(3), np.zeros(3), np.eye(3), camera.distortion
            )
            found.append(bent[:, 0] @ K[:2, :2].T + K[:2, 2])
        pixels = (np.hstack(found) - self.seen) / SIGMA_PX
        lengths = np.linalg.norm(places[0::2] - places[1::2], axis=1)
        gaps = (lengths - q[FACTOR] * self.distances) / SCATTER_M
        return np.concatenate([pixels.ravel(), gaps, self.priors(p, pose)])

    def solve(self) -> FloatArray:
        """The 13 numbers."""
        found = least_squares(
            self,
            self.start,
            jac_sparsity=self.sparsity,
            x_scale="jac",
            # The default stops LSMR early, and the solve then takes ten times as long.
            tr_options={"atol": 1e-12, "btol": 1e-12, "maxiter": 2000},
        )
        return np.asarray(found.x[: self.k])


def seconds(function: Callable[[], object]) -> float:
    """Processor time of one call on this thread."""
    started = time.thread_time()
    function()
    return time.thread_time() - started


def check_same(
    name: str, data: Pair, start: Pose, other: Afternoon | Kept, tolerance: float
) -> None:
    """The other side must find the same to so many standard errors, or its time means nothing.

    Raises:
        RuntimeError: it does not.
    """
    ours = refine(data, SETTINGS, start)
    away = np.abs(step_between(other.at(other.solve()), ours.at))
    sigma = np.sqrt(np.diag(ours.covariance))
    off = float(np.max(away[sigma > 0.0] / sigma[sigma > 0.0]))
    if off > tolerance:
        raise RuntimeError(f"{name} differs by {off:.2f} standard errors.")


def ratios(frames: int) -> None:
    """Ours against both ways with SciPy, in turn."""
    rng = np.random.default_rng(frames)
    data = stated(random_scene(rng, frames), rng, Misjudged())
    start = calibrate_essential(data.rays, data.baseline_m).pose
    begin = fit_from(data, start, SETTINGS)
    others: dict[str, tuple[Afternoon | Kept, float]] = {
        "no places": (Afternoon(data, begin), 4.0),
        "places kept": (Kept(data, begin, start), 0.01),
    }
    sides: list[Callable[[], object]] = [lambda: refine(data, SETTINGS, start)]
    for name, (other, tolerance) in others.items():
        check_same(name, data, start, other, tolerance)
        sides.append(other.solve)
    times = np.array([[seconds(side) for side in sides] for _ in range(TURNS)])
    ours, afternoon, kept = np.median(times, axis=0) * 1e3
    for_one, for_other = (times[:, at] / times[:, 0] for at in (1, 2))
    print(
        f"| {frames} | {ours:.1f} | {afternoon:.0f} | {kept:.0f} | {np.median(for_one):.0f} "
        f"({for_one.min():.0f} to {for_one.max():.0f}) | {np.median(for_other):.0f} "
        f"({for_other.min():.0f} to {for_other.max():.0f}) |",
        flush=True,
    )


def growth() -> None:
    """One refined set of 25, 250 and 2,500 frames, noise estimated, start given and found."""
    for frames in (25, 250, 2500):
        rng = np.random.default_rng(frames)
        data = stated(random_scene(rng, frames), rng, Misjudged())
        start = calibrate_essential(data.rays, data.baseline_m).pose
        refine(data, None, start)
        given = [seconds(lambda: refine(data, None, start)) for _ in range(TURNS)]  # noqa: B023
        found = [seconds(lambda: refine(data)) for _ in range(TURNS)]  # noqa: B023
        print(
            f"| {frames} | {1e3 * np.median(given):.1f} ({1e3 * min(given):.1f} to "
            f"{1e3 * max(given):.1f}) | {1e3 * np.median(found):.1f} |",
            flush=True,
        )


def main() -> None:
    """Measure and print both tables."""
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; {TURNS} turns; milliseconds.\n")
    print("| frames | ours | SciPy, no places | SciPy, places kept | ratio | ratio, kept |")
    print("|---|---|---|---|---|---|")
    for frames in (25, 100):
        ratios(frames)
    print("\n| frames | start given (range) | start found too |\n|---|---|---|")
    growth()


if __name__ == "__main__":
    main()
