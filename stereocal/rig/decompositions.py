"""Small decompositions for compiled code, where LAPACK's cost more.

Processor time to compile a use of 9 x 9, and to run it:
`np.linalg.solve` 4.6 s and 9.5 us, `solve_positive` 0.7 s and 1.5 us; `np.linalg.qr` 1.3 s and
8.6 us, `triangle` 0.6 s and 3.0 us; `np.linalg.cholesky` 0.28 s and 4.1 us, and an exception where
the matrix is not positive, `factor` 0.29 s and 1.8 us. The singular values are LAPACK's: 1.0 s, and
0.2 s for each further use.
"""

import numpy as np

from stereocal.rig.compiled import FloatArray, internal


@internal
def triangle(columns: FloatArray) -> FloatArray:
    """R of the QR decomposition, by Householder reflections.

    Args:
        columns: (m, n): the m columns of a matrix of n rows; overwritten.

    Returns:
        (m, m) upper triangle with `R.T @ R = columns @ columns.T`; rows beyond n are 0.
    """
    m, n = columns.shape
    R = np.zeros((m, m))
    for i in range(min(m, n)):
        squares = 0.0
        for k in range(i, n):
            squares += columns[i, k] * columns[i, k]
        norm = np.sqrt(squares)
        head = columns[i, i]
        diagonal = -norm if head > 0.0 else norm
        R[i, i] = diagonal
        columns[i, i] = head - diagonal
        half = squares - head * diagonal  # half the squared length of the mirror's normal
        for j in range(i + 1, m):
            along = 0.0
            for k in range(i, n):
                along += columns[i, k] * columns[j, k]
            if half > 0.0:
                for k in range(i, n):
                    columns[j, k] -= along / half * columns[i, k]
            R[i, j] = columns[j, i]
    return R


@internal
def is_finite(A: FloatArray) -> bool:
    """Whether all entries (n, m) are finite; LAPACK raises an exception if they are not."""
    total = 0.0
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            total += abs(A[i, j])
    return bool(total < np.inf)


@internal
def solve_positive(A: FloatArray, b: FloatArray) -> bool:
    """Solve `A x = b` in place on `b`, with Cholesky's factor in place on `A` (n, n).

    Returns:
        False if A is not positive definite; A and b are then undefined.
    """
    if not factor(A, 0.0):
        return False
    forward(A, b)
    backward(A, b)
    return True


@internal
def factor(A: FloatArray, least: float) -> bool:
    """Cholesky's lower factor of A (n, n), in place; returns False if A is not positive definite.

    Args:
        least: minimum of each pivot over the diagonal entry of A.
    """
    for j in range(len(A)):
        before = A[j, j]
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        if not A[j, j] > least * before:
            return False
        A[j, j] = np.sqrt(A[j, j])
        scale = 1.0 / A[j, j]
        for i in range(j + 1, len(A)):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] *= scale
    return True


@internal
def forward(L: FloatArray, b: FloatArray) -> None:
    """Solve L y = b in place."""
    for i in range(len(L)):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]


@internal
def backward(L: FloatArray, b: FloatArray) -> None:
    """Solve L^T y = b in place."""
    for i in range(len(L) - 1, -1, -1):
        for k in range(i + 1, len(L)):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]
