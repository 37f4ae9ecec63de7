"""How hot functions are compiled: to machine code, cached on disk, without the interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
CountArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

P = ParamSpec("P")
T = TypeVar("T")


FAST_MATH = {"contract", "nsz", "arcp", "reassoc"}
"""Sums may be reordered, so that loops over points use vector instructions; NaN stays NaN."""


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile `function` with numba on its first call.

    A division by zero gives inf or NaN as in NumPy (`error_model`), which a cost then carries to
    the search, where NaN never counts as an improvement.
    """
    decorated: Callable[P, T] = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH
    )(function)
    return decorated


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """As `compiled`, and copied into its callers: a call in a loop keeps it from vectorising."""
    decorated: Callable[P, T] = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH, inline="always"
    )(function)
    return decorated
