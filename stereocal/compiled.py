"""How hot functions are compiled: to machine code, cached on disk, without the interpreter lock."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeVar

import numba
import numpy as np
import numpy.typing as npt
from numba import types
from numba.extending import typeof_impl

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
CountArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

P = ParamSpec("P")
T = TypeVar("T")


FAST_MATH = {"contract", "nsz", "arcp", "reassoc"}
"""Sums may be reordered, so that loops over points use vector instructions; NaN stays NaN."""


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile `function`, which Python calls, with numba on its first call.

    A division by zero gives inf or NaN as in NumPy (`error_model`), which a cost then carries to
    the search, where NaN never counts as an improvement.
    """
    return _decorated(function)


class _Internal(Generic[P, T]):
    """A function that compiled code calls compiled, and Python as it was written.

    numba's own object without what a call from Python needs ends the process when Python calls it.
    """

    def __init__(self, function: Callable[P, T], **options: bool) -> None:
        self.function = function
        self.dispatcher = _decorated(function, no_cpython_wrapper=True, **options)
        functools.update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> T:
        return self.function(*args, **kwargs)


@typeof_impl.register(_Internal)
def _type_of_internal(value: _Internal[P, T], _: object) -> types.Dispatcher:
    return types.Dispatcher(value.dispatcher)  # type: ignore[arg-type]


def internal(function: Callable[P, T]) -> Callable[P, T]:
    """As `compiled`, for what only compiled code calls: a wrapper less to compile for each."""
    return _Internal(function)


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """As `internal`, and copied into its callers: a call in a loop keeps it from vectorising."""
    return _Internal(function, forceinline=True)


def _decorated(function: Callable[P, T], **options: bool) -> Callable[P, T]:
    every: dict[str, Any] = {"no_cfunc_wrapper": True, **options}  # numba's types lack these
    decorated: Callable[P, T] = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH, **every
    )(function)
    return decorated


def plain(array: FloatArray) -> FloatArray:
    """The array, or a copy, of the one kind that compiled code is given: contiguous and writable.

    numba compiles a function once more for each other kind.
    """
    return array if array.flags.carray else np.array(array, order="C")
