"""Small decompositions for compiled code.

LAPACK does these too, but its numba bindings take 13 s to compile, and called from NumPy they hold
the interpreter's lock, so that the runs of a validation could not share the cores.
"""

from __future__ import annotations

import numpy as np

from stereocal.compiled import FloatArray, compiled

MOST_SWEEPS = 60
"""One-sided Jacobi converges quadratically; 9 columns need 6 to 10 sweeps."""


@compiled
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


@compiled
def singular_vectors(A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular value decomposition `A = U diag(s) V.T` by one-sided Jacobi (Hestenes 1958).

    Args:
        A: (n, m).

    Returns:
        `(U diag(s)).T` (m, n), s (m,), `V.T` (m, m), the largest singular value first. Small
        singular values are as accurate as large ones.
    """
    m = A.shape[1]
    W, V = A.T.copy(), np.eye(m)
    for _ in range(MOST_SWEEPS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                ii, jj, ij = _dot(W[i], W[i]), _dot(W[j], W[j]), _dot(W[i], W[j])
                if abs(ij) <= 1e-16 * np.sqrt(ii * jj):
                    continue
                turned = True
                half_cotangent = 0.5 * (jj - ii) / ij
                tangent = 1.0 / (abs(half_cotangent) + np.sqrt(1.0 + half_cotangent**2))
                if half_cotangent < 0.0:
                    tangent = -tangent
                cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                _turn(W[i], W[j], cosine, cosine * tangent)
                _turn(V[i], V[j], cosine, cosine * tangent)
        if not turned:
            break
    s = np.empty(m)
    for i in range(m):
        s[i] = np.sqrt(_dot(W[i], W[i]))
    order = np.argsort(-s)
    return W[order], s[order], V[order]


@compiled
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@compiled
def _turn(a: FloatArray, b: FloatArray, cosine: float, sine: float) -> None:
    for k in range(len(a)):
        a[k], b[k] = cosine * a[k] - sine * b[k], sine * a[k] + cosine * b[k]


@compiled
def solve_positive(A: FloatArray, b: FloatArray) -> bool:
    """Solve `A x = b` in place on `b`, with Cholesky's factor in place on `A` (n, n).

    Returns:
        False where A is not positive definite; A and b then hold nothing of use.
    """
    n = len(b)
    if not factor(A, n):
        return False
    forward(A, b, n)
    backward(A, b, n)
    return True


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
