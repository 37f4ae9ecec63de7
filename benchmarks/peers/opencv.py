"""OpenCV: essential matrix by MAGSAC++, then `recoverPose`."""

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.peers.solution import THRESHOLD_PX, NoSolutionError, Peer, Solution
from stereocal.rig.pair import Pair


def solve(dataset: Pair) -> Solution:
    """Normalised points in, unit translation out, times the measured baseline."""
    return estimate(dataset)[0]


def estimate(dataset: Pair) -> tuple[Solution, npt.NDArray[np.bool_]]:
    """The pose, and which rows (n,) MAGSAC++ trusts."""
    primary = np.ascontiguousarray(dataset.rays[:2].T)
    secondary = np.ascontiguousarray(dataset.rays[2:].T)
    focal = float(np.sqrt(np.prod(dataset.pixel_scale[:, 0])))
    E, mask = cv2.findEssentialMat(
        primary,
        secondary,
        np.eye(3),
        method=cv2.USAC_MAGSAC,
        prob=0.9999,
        threshold=THRESHOLD_PX / focal,
    )
    if E is None or np.shape(E) != (3, 3):
        raise NoSolutionError("OpenCV found no essential matrix")
    inliers = np.asarray(mask, dtype=bool).ravel()
    _, R, t, _ = cv2.recoverPose(E, primary, secondary, np.eye(3), mask=mask)
    found = Solution(
        np.asarray(R, dtype=np.float64),
        dataset.baseline_m * np.asarray(t, dtype=np.float64).ravel(),
        (dataset.primary, dataset.secondary),
    )
    return found, inliers


PEERS = (
    Peer(
        name="OpenCV MAGSAC + recoverPose",
        solve=solve,
        scale="measured baseline",
        lenses="held",
        outliers="MAGSAC++",
    ),
)
