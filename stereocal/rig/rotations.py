"""Rotations that were printed with few decimals."""

import numpy as np

from stereocal.rig.compiled import FloatArray

EXACT_ROTATION = 1e-6
"""Largest entry of R R^T - I up to which R is kept as it is."""
ROTATION_TOLERANCE = 1e-4
"""The same up to which the nearest rotation is taken without a message: the product of two matrices
printed with five decimals has 2.8e-5 at most, with six 3e-6, with four 3e-4 (3000 random ones)."""
NEAREST_TOLERANCE = 5e-3
"""The same up to which `Pose.nearest` takes it: with three decimals 3e-3 at most, with two 3e-2."""


def rotation_error(R: FloatArray) -> float:
    """Largest entry of R R^T - I; infinite if det R is below 0 or the shape is wrong."""
    # Entries are checked first, because their squares may overflow.
    if R.shape != (3, 3) or not np.abs(R).max() < 2 or np.linalg.det(R) < 0:
        return np.inf
    return float(np.abs(R @ R.T - np.eye(3)).max())


def nearest_rotation(R: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix, by the sum of squares of their difference."""
    U, _, V = np.linalg.svd(R)
    return np.asarray(U @ V, dtype=np.float64)
