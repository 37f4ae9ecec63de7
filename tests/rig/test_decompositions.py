"""The small compiled decompositions against NumPy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereocal.rig import decompositions
from tests.known_rig import SEEDS
from tests.rig.machine_code import machine_code

triangle = machine_code(decompositions.triangle)
solve_positive = machine_code(decompositions.solve_positive)


@given(SEEDS, st.integers(1, 9), st.integers(1, 40))
def test_the_triangle_has_the_columns_products(seed: int, m: int, n: int) -> None:
    columns = np.random.default_rng(seed).standard_normal((m, n))
    R = triangle(columns.copy())
    assert np.array_equal(R, np.triu(R))
    # Rounding of sums of 40 squares of order 1; measured: 2e-14.
    np.testing.assert_allclose(R.T @ R, columns @ columns.T, rtol=0, atol=1e-12)


def test_columns_of_zeros_have_a_triangle_of_zeros() -> None:
    assert not triangle(np.zeros((3, 5))).any()


@given(SEEDS, st.integers(1, 9))
def test_solves_as_numpy_does(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((n + 3, n))
    A, b = half.T @ half, rng.standard_normal(n)
    x = b.copy()
    assert solve_positive(A.copy(), x)
    np.testing.assert_allclose(A @ x, b, rtol=0, atol=1e-9 * np.abs(x).max() * np.abs(A).max())
    A[0, 0] = -1.0
    assert not solve_positive(A, b)
