"""Where an object is, by the image of one camera."""

from __future__ import annotations

import cv2
import numpy as np

from stereocal.rig.compiled import FloatArray, IntArray

FEWEST_TO_PLACE = 4
"""Points of an object in one image."""
COLLINEAR = 0.05
"""Points closer to a line than this share of their length do not tell how they are turned."""


def placed(frame: IntArray, points: FloatArray, rays: FloatArray) -> FloatArray:
    """The points (n, 3) in the camera's frame, in metres; NaN where too few are seen.

    Args:
        frame: (n,).
        points: (n, 3), in the object's own frame, in metres.
        rays: (2, n), undistorted and normalised.
    """
    found = np.full_like(points, np.nan)
    for one in np.unique(frame):
        rows = np.flatnonzero(frame == one)
        own, seen = points[rows], np.ascontiguousarray(rays[:, rows].T)
        spread = np.linalg.svd(own - own.mean(axis=0), compute_uv=False)
        if len(rows) < FEWEST_TO_PLACE or spread[1] < COLLINEAR * spread[0]:
            continue
        # SQPnP takes four points, in a plane or not; ITERATIVE wants six that are not.
        solved, turn, at = cv2.solvePnP(own, seen, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        if solved:
            turn, at = cv2.solvePnPRefineLM(own, seen, np.eye(3), None, turn, at)
            found[rows] = own @ cv2.Rodrigues(turn)[0].T + at.T
    return found
