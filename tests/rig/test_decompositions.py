"""The compiled Cholesky factor against NumPy's solution."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereocal.rig import decompositions
from tests.rig.machine_code import machine_code
from tests.rigs.known_rig import SEEDS

factor = machine_code(decompositions.factor)
forward, backward = (machine_code(decompositions.forward), machine_code(decompositions.backward))


@given(SEEDS, st.integers(1, 9))
def test_solves_as_numpy_does(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((n + 3, n))
    A, b = half.T @ half, rng.standard_normal(n)
    L, x = A.copy(), b.copy()
    assert factor(L, 0.0)
    forward(L, x)
    backward(L, x)
    np.testing.assert_allclose(A @ x, b, rtol=0, atol=1e-9 * np.abs(x).max() * np.abs(A).max())
    A[0, 0] = -1.0
    assert not factor(A, 0.0)
