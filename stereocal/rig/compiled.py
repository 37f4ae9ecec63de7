"""How hot functions are compiled: to machine code, cached on disk, without the interpreter lock."""

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
    # numba itself trusts what is on disk for as long as the function's own file is the same.
    on_disk = getattr(getattr(decorated, "_cache", None), "_cache_file", None)
    if on_disk is not None:  # None with NUMBA_DISABLE_JIT
        on_disk._source_stamp = _stamp(Path(inspect.getfile(function)))
    return decorated


@functools.cache
def _stamp(path: Path) -> str:
    """A digest of a file and of all of this package that it imports, directly or not.

    Compiled code holds a copy of what it calls and the constants it reads, also of other files.
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


def plain(array: FloatArray) -> FloatArray:
    """The array, or a copy, of the one kind that compiled code is given: contiguous and writable.

    numba compiles a function once more for each other kind.
    """
    return array if array.flags.carray else np.array(array, order="C")
