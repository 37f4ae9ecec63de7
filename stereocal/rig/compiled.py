"""Decorators that compile hot functions with numba: cached on disk, without the GIL."""

from __future__ import annotations

import functools
import hashlib
import inspect
import re
from collections.abc import Callable
from pathlib import Path
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


_PACKAGE = Path(__file__).parents[1]
_IMPORTED = re.compile(rf"^from ({_PACKAGE.name}[.\w]*) import ([\w, ]*)", re.MULTILINE)

FAST_MATH = {"contract", "nsz", "arcp", "reassoc"}
"""Allows reordered sums, so that loops over points are vectorised; keeps the rules for NaN."""


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a function that Python calls, at its first call.

    A division by zero gives inf or NaN as in NumPy. A NaN cost never counts as an improvement.
    """
    return _decorated(function)


class _Internal(Generic[P, T]):
    """A function that compiled code calls in compiled form, and Python in its original form.

    A numba dispatcher without a Python wrapper crashes the process when Python calls it.
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
    """As `compiled`, for functions that only compiled code calls; saves compiling a wrapper."""
    return _Internal(function)


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """As `internal`, inlined into its callers: a call inside a loop prevents vectorisation."""
    return _Internal(function, forceinline=True)


def _decorated(function: Callable[P, T], **options: bool) -> Callable[P, T]:
    untyped: dict[str, Any] = {"no_cfunc_wrapper": True, **options}  # not in numba's type hints
    decorated: Callable[P, T] = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH, **untyped
    )(function)
    # By itself, numba invalidates the cache only when the function's own file changes.
    on_disk = getattr(getattr(decorated, "_cache", None), "_cache_file", None)
    if on_disk is not None:  # None with NUMBA_DISABLE_JIT
        on_disk._source_stamp = _stamp(Path(inspect.getfile(function)))
    return decorated


@functools.cache
def _stamp(path: Path) -> str:
    """A digest of a source file and of all modules of this package that it imports, recursively.

    Compiled code contains the functions it calls and the constants it reads from other modules.
    """
    seen, left = {path}, [path]
    while left:
        for module, names in _IMPORTED.findall(left.pop().read_text(encoding="utf-8")):
            of_module = _PACKAGE.parent.joinpath(*module.split("."))
            inside = [of_module / f"{name.strip()}.py" for name in names.split(",")]
            new = {each for each in (of_module.with_suffix(".py"), *inside) if each.is_file()}
            left += new - seen
            seen |= new
    return hashlib.sha256(b"".join(each.read_bytes() for each in sorted(seen))).hexdigest()


def contiguous(array: FloatArray) -> FloatArray:
    """The array, or a copy of it, C-contiguous and writable.

    numba compiles a function again for every other memory layout.
    """
    return array if array.flags.carray else np.array(array, order="C")
