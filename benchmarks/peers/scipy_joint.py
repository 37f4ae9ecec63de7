"""Plain SciPy: everything in one `least_squares`, with finite differences.

Unknowns are the pose, focal factor and principal point of both cameras, and every point. Residuals
are pixels / 0.3 px, lengths / 0.1 %, baseline / 1 % and lenses / 1 % and 10 px, with the loss
`soft_l1`: the same information as stereocal's refined method by default. Points that OpenCV's
MAGSAC++ does not trust are left out beforehand: with them the solve ends far off. The structure of
the Jacobian is given to SciPy, which then differentiates many columns at once.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix

from benchmarks.peers import opencv
from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray

SIGMA_PX = 0.3
SIGMA_BAR = 0.001
SIGMA_BASELINE = 0.01
SIGMA_FOCAL = 0.01
SIGMA_CENTRE_PX = 10.0
LENS = 3
"""Unknowns of a lens: factor of the focal lengths less 1, shift of cx and of cy."""
SHARED = 6 + 2 * LENS
EVALUATIONS = 300
"""Then the solve stops and its last point counts."""


@dataclass(frozen=True, eq=False)
class Joint:
    """The residuals of a data set as a function of one long vector."""

    dataset: Pair
    begin: Solution

    def residuals(self, x: FloatArray) -> FloatArray:
        """(4 n + bars + 1 + 6,), in standard deviations."""
        data, rows = self.dataset, self.dataset.correspondences
        points = x[SHARED:].reshape(-1, 3)
        bars = points[rows.bars]
        lengths = np.linalg.norm(bars[:, 0] - bars[:, 1], axis=1) / data.bar_distances_m - 1
        baseline = np.linalg.norm(x[3:6]) / data.baseline_m - 1
        still = np.zeros(3)
        primary, secondary = self.cameras(x)
        seen = (
            rows.primary - _project(points, still, still, primary),
            rows.secondary - _project(points, x[:3], x[3:6], secondary),
        )
        sigma = [SIGMA_FOCAL, SIGMA_CENTRE_PX, SIGMA_CENTRE_PX]
        return np.concatenate(
            [
                np.hstack(seen).ravel() / SIGMA_PX,
                lengths / SIGMA_BAR,
                [baseline / SIGMA_BASELINE],
                x[6:SHARED] / np.array(2 * sigma),
            ]
        )

    def cameras(self, x: FloatArray) -> tuple[Camera, Camera]:
        """Both cameras with the lenses of x."""
        first, second = x[6:SHARED].reshape(2, LENS)
        return _moved(self.dataset.primary, first), _moved(self.dataset.secondary, second)

    def sparsity(self) -> lil_matrix:
        """Which residual depends on which unknown."""
        n, bars = len(self.dataset.correspondences), self.dataset.correspondences.bars
        pattern = lil_matrix((4 * n + len(bars) + 1 + 2 * LENS, SHARED + 3 * n), dtype=np.int8)
        pattern[: 4 * n, :SHARED] = 1
        for i in range(n):
            pattern[4 * i : 4 * i + 4, SHARED + 3 * i : SHARED + 3 * i + 3] = 1
        for i, ends in enumerate(bars):
            for end in ends:
                pattern[4 * n + i, SHARED + 3 * end : SHARED + 3 * end + 3] = 1
        pattern[4 * n + len(bars) :, :SHARED] = 1
        return pattern

    def start(self) -> FloatArray:
        """The robust pose, its triangulated points, and the lenses as stated."""
        found = self.begin
        P = np.column_stack([found.R, found.T])
        rays = self.dataset.rays
        homogeneous = cv2.triangulatePoints(np.eye(3, 4), P, rays[:2], rays[2:])
        points = (homogeneous[:3] / homogeneous[3]).T
        rotation = cv2.Rodrigues(found.R)[0].ravel()
        return np.concatenate([rotation, found.T, np.zeros(2 * LENS), points.ravel()])


def solve(dataset: Pair) -> Solution:
    """One `least_squares`, method `trf`, finite differences, robust loss."""
    begin, inliers = opencv.estimate(dataset)
    trusted = dataset.where(inliers)
    joint = Joint(trusted, begin)
    found = least_squares(
        joint.residuals,
        joint.start(),
        jac="2-point",
        jac_sparsity=joint.sparsity(),
        x_scale="jac",
        loss="soft_l1",
        method="trf",
        ftol=1e-6,
        max_nfev=EVALUATIONS,
    )
    R = np.asarray(cv2.Rodrigues(found.x[:3])[0], dtype=np.float64)
    return Solution(R, found.x[3:6], joint.cameras(found.x))


def _project(points: FloatArray, rotation: FloatArray, T: FloatArray, to: Camera) -> FloatArray:
    pixels, _ = cv2.projectPoints(points, rotation, T, to.K, to.distortion)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def _moved(camera: Camera, by: FloatArray) -> Camera:
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= 1 + by[0]
    K[:2, 2] += by[1:]
    return replace(camera, K=K)


PEERS = (
    Peer(
        name="SciPy joint",
        solve=solve,
        scale="bar 0.1 % and baseline 1 %",
        lenses="f, c freed, priors",
        outliers="OpenCV's inliers, soft_l1",
    ),
)
