"""Cholesky's factor of small matrices, compiled by hand: numpy.linalg takes seconds to compile."""

from __future__ import annotations

import numpy as np

from stereocal.compiled import FloatArray, compiled


@compiled
def factor(A: FloatArray, n: int) -> bool:
    """Cholesky's lower factor of the first n rows, in place; false if A is not positive."""
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        if not A[j, j] > 0.0:
            return False
        A[j, j] = np.sqrt(A[j, j])
        scale = 1.0 / A[j, j]
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] *= scale
    return True


@compiled
def forward(L: FloatArray, b: FloatArray, n: int) -> None:
    """Solve L y = b in place."""
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]


@compiled
def backward(L: FloatArray, b: FloatArray, n: int) -> None:
    """Solve L^T y = b in place."""
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]
