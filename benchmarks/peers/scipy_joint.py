"""Plain SciPy: everything in one `least_squares`, with finite differences.

Unknowns are the poses, focal factor and principal point of all cameras, and every point. The
structure of the Jacobian is given to SciPy, which then differentiates many columns at once.

As a peer, residuals are pixels / 0.3 px, lengths / 0.1 %, baseline / 1 % and lenses / 1 % and
10 px, with the loss `soft_l1`: the same information as stereocal's refined method by default.
Points that OpenCV's MAGSAC++ does not trust are left out beforehand: with them the solve ends far
off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import Rotation

from benchmarks.peers import opencv
from benchmarks.peers.solution import Peer, Solution
from stereocal.fit.least_squares.observations import Observations
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

SIGMA_PX = 0.3
SIGMA_BAR = 0.001
SIGMA_BASELINE = 0.01
POSE, LENS = 6, 3
"""Unknowns of a pose, and of a lens: factor of the focal lengths less 1, shift of cx and of cy."""
EVALUATIONS = 300
"""Then the solve stops and its last point counts."""


@dataclass(frozen=True, eq=False)
class Known:
    """Standard deviations of all that is measured or stated."""

    pixels: float
    lengths_m: float
    focal: float = 0.01
    centre_px: float = 10.0
    factor: float = 0.0
    """Of all lengths together; 0: they are right."""
    baseline: tuple[float, float] | None = None
    """Of two cameras: in metres, and its standard deviation."""


def joint(
    recording: Recording,
    start: Sequence[Pose],
    points: FloatArray,
    known: Known,
    loss: Literal["linear", "soft_l1"],
) -> tuple[list[Pose], list[Camera]]:
    """The poses and lenses of all cameras.

    Args:
        start: `camera_from_first` of each camera.
        points: (n, 2, 3), as the units and ends of `Observations`; NaN is not known.
    """
    own, stated = Observations.of(recording), list(recording.cameras.values())
    count = len(stated)
    lens_at, shared = POSE * (count - 1), POSE * (count - 1) + LENS * count + 1
    unit, end, camera = np.nonzero(np.isfinite(own.pixels[..., 0]))  # (n, 2, c)
    measured, bars = own.pixels[unit, end, camera], np.flatnonzero(np.isfinite(own.distances))
    sigma = np.array([known.focal, known.centre_px, known.centre_px] * count)
    rows = [np.flatnonzero(camera == number) for number in range(count)]
    seen, eye = [(mine, 2 * unit[mine] + end[mine]) for mine in rows], np.eye(3)

    def moves(x: FloatArray) -> FloatArray:
        """(c, 6): rotation vector and translation; those of the first camera are 0."""
        return np.vstack([np.zeros(POSE), x[:lens_at].reshape(-1, POSE)])

    def matrices(x: FloatArray) -> list[FloatArray]:
        found = [lens.K.copy() for lens in stated]
        for K, (focal, cx, cy) in zip(
            found, x[lens_at : shared - 1].reshape(-1, LENS), strict=True
        ):
            K[[0, 1], [0, 1]] *= 1 + focal
            K[:2, 2] += cx, cy
        return found

    def residuals(x: FloatArray) -> FloatArray:
        flat, images, at = x[shared:].reshape(-1, 3), np.empty_like(measured), moves(x)
        for (mine, points), move, K, lens in zip(seen, at, matrices(x), stated, strict=True):
            bent, _ = cv2.projectPoints(flat[points], move[:3], move[3:], eye, lens.distortion)
            images[mine] = bent[:, 0] @ K[:2, :2].T + K[:2, 2]
        ends = flat.reshape(-1, 2, 3)[bars]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        lengths = lengths / (1 + known.factor * x[shared - 1]) - own.distances[bars]
        parts = [
            ((images - measured) / known.pixels).ravel(),
            lengths / known.lengths_m,
            x[lens_at : shared - 1] / sigma,
            x[shared - 1 : shared],
        ]
        if known.baseline is not None:
            baseline_m, sigma_m = known.baseline
            parts.append(np.array([(np.linalg.norm(at[1, 3:]) - baseline_m) / sigma_m]))
        return np.concatenate(parts)

    turns = [np.append(Rotation.from_matrix(pose.R).as_rotvec(), pose.T) for pose in start[1:]]
    places = np.where(np.isfinite(points), points, [0.0, 0.0, 1.0]).ravel()
    begin = np.concatenate([*turns, np.zeros(LENS * count + 1), places])
    structure = lil_matrix((len(residuals(begin)), len(begin)), dtype=np.int8)
    structure[:, :shared] = 1
    for k, first in enumerate((shared + 6 * unit + 3 * end).tolist()):
        structure[2 * k : 2 * k + 2, first : first + 3] = 1
    for k, first in enumerate((shared + 6 * bars).tolist(), 2 * len(unit)):
        structure[k, first : first + 6] = 1
    found = least_squares(
        residuals,
        begin,
        jac_sparsity=structure,
        x_scale="jac",
        tr_solver="lsmr",
        loss=loss,
        ftol=1e-8 if loss == "linear" else 1e-6,
        max_nfev=EVALUATIONS,
    )
    lenses = zip(stated, matrices(found.x), strict=True)
    poses = [Pose(Rotation.from_rotvec(own[:3]).as_matrix(), own[3:]) for own in moves(found.x)]
    return poses, [replace(camera, K=K) for camera, K in lenses]


def solve(dataset: Pair) -> Solution:
    """From OpenCV's pose and the points that it trusts."""
    begin, inliers = opencv.estimate(dataset)
    trusted = dataset.where(inliers).recording
    pixels = Observations.of(trusted).pixels
    rig = Rig(dataset.primary, dataset.secondary, begin.pose)
    points = rig.reconstruct(pixels[..., 0, :].reshape(-1, 2), pixels[..., 1, :].reshape(-1, 2))
    known = Known(
        SIGMA_PX,
        SIGMA_BAR * dataset.target_distance_m,
        baseline=(dataset.baseline_m, SIGMA_BASELINE * dataset.baseline_m),
    )
    poses = [Pose(np.eye(3), np.zeros(3)), begin.pose]
    (_, pose), (one, two) = joint(trusted, poses, points.reshape(-1, 2, 3), known, "soft_l1")
    return Solution(pose.R, pose.T, (one, two))


PEERS = (
    Peer(
        name="SciPy joint",
        solve=solve,
        scale="bar 0.1 % and baseline 1 %",
        lenses="f, c freed, priors",
        outliers="OpenCV's inliers, soft_l1",
    ),
)
