"""Projection matrices, K [R | t]."""

import numpy as np
from scipy.linalg import rq

from stereocal.errors import StereocalError
from stereocal.formats.exchange.reading import pose_from
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.system.arrays import LARGEST


def decomposed(P: FloatArray, source: str) -> tuple[FloatArray, Pose]:
    """K and pose of a projection matrix of any scale and sign."""
    largest = float(np.abs(P).max())
    scale = float(np.linalg.norm(P[2, :3])) if largest < LARGEST else 0.0
    if largest >= LARGEST * scale or abs(np.linalg.det(P[:, :3] / scale)) < 1e-9:
        raise StereocalError("this is not the projection matrix of a camera.", source)
    P = P / scale * np.sign(np.linalg.det(P[:, :3]))
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    if np.diag(K).min() < 1e-12 * np.abs(K).max():
        raise StereocalError("this is not the projection matrix of a camera.", source)
    t = np.linalg.solve(K, P[:, 3])
    K /= K[2, 2]
    K[[1, 2, 2], [0, 0, 1]] = 0.0
    K[2, 2] = 1.0
    return K, pose_from(R, t, source)
