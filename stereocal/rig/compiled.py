"""Decorators that compile hot functions with numba: cached on disk, without the GIL."""

import functools
import gc
import hashlib
import inspect
import pickle
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import numba
import numpy as np
from numba import types
from numba.core import event
from numba.extending import typeof_impl

from stereocal.system.array_types import FloatArray

P = ParamSpec("P")
T = TypeVar("T")


_PACKAGE = Path(__file__).parents[1]
_IMPORTED = re.compile(rf"^from ({_PACKAGE.name}[.\w]*) import ([\w, ]*)", re.MULTILINE)

FAST_MATH = {"contract", "nsz", "arcp", "reassoc"}
"""Allows reordered sums, so that loops over points are vectorised; keeps the rules for NaN."""

_ON_DISK: list[Any] = []
"""The cached code of each function of this package that was decorated."""


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
    """What `compiled` is, for functions that only compiled code calls: no wrapper is compiled."""
    return _Internal(function)


def borrowing(function: Callable[P, T]) -> Callable[P, T]:
    """What `internal` is, for functions that allocate no array.

    What they are given is in use as long as they run, so that it need not be counted as in use by
    each tuple and each part of an array: the sums of `adjustment` take a third less time.
    """
    return _Internal(function, _nrt=False)


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """What `internal` is, inlined into its callers: a call inside a loop prevents vectorisation."""
    return _Internal(function, forceinline=True)


def _decorated(function: Callable[P, T], **options: bool) -> Callable[P, T]:
    untyped: dict[str, Any] = {"no_cfunc_wrapper": True, **options}  # not in numba's type hints
    decorated: Callable[P, T] = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH, **untyped
    )(function)
    _without_literals(decorated)
    # By itself, numba invalidates the cache only when the function's own file changes.
    on_disk = getattr(getattr(decorated, "_cache", None), "_cache_file", None)
    if on_disk is not None:  # None with NUMBA_DISABLE_JIT
        on_disk._source_stamp = _stamp(Path(inspect.getfile(function)))
        on_disk._load_index = functools.partial(_readable_index, on_disk._load_index)
        if function.__module__.startswith(f"{_PACKAGE.name}."):
            _ON_DISK.append(on_disk)
    return decorated


def _readable_index(load: Callable[[], dict[Any, str]]) -> dict[Any, str]:
    """What the cache has of a function; nothing if it names a class that another version moved.

    numba reads the signatures before it compares the versions.
    """
    try:
        return load()
    except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
        return {}


def uncompiled() -> bool:
    """Whether the cache lacks any function of the modules that are imported."""
    return not all(on_disk._load_index() for on_disk in _ON_DISK)


def _without_literals(dispatcher: Any) -> None:
    """Make numba compile a function once for all constant arguments of compiled code, which it does
    anew for each by itself."""
    general_of: Callable[[Any], Any] = types.unliteral
    types_of_call = getattr(dispatcher, "get_call_template", None)
    if types_of_call is None:  # with NUMBA_DISABLE_JIT
        return

    def of_any_value(arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        general = {name: general_of(argument) for name, argument in named.items()}
        return types_of_call(tuple(map(general_of, arguments)), general)

    dispatcher.get_call_template = of_any_value


@functools.cache
def _stamp(path: Path) -> str:
    """A digest of a source file and of all modules of this package that it imports, recursively.

    Compiled code contains the functions it calls and the constants it reads from other modules.
    """
    seen, left = {path}, [path]
    while left:
        new = _source(left.pop())[1] - seen
        left += new
        seen |= new
    return hashlib.sha256(b"".join(_source(file)[0] for file in sorted(seen))).hexdigest()


@functools.cache
def _source(path: Path) -> tuple[bytes, frozenset[Path]]:
    """A source file, and the modules of this package that it imports: read once by a process."""
    content, modules = path.read_bytes(), set[Path]()
    for module, names in _IMPORTED.findall(content.decode()):
        of_module = _PACKAGE.parent.joinpath(*module.split("."))
        inside = (of_module / f"{name.strip()}.py" for name in names.split(","))
        modules |= {file for file in (of_module.with_suffix(".py"), *inside) if file.is_file()}
    return content, frozenset(modules)


def contiguous(array: FloatArray) -> FloatArray:
    """The array, or a copy of it, C-contiguous and writable.

    numba compiles a function again for every other memory layout.
    """
    return array if array.flags.carray else np.array(array, order="C")


@contextmanager
def compilations(on_count: Callable[[int], None]) -> Iterator[None]:
    """Report the compilations of stereocal's functions, in all threads, inside a `with` block.

    `on_count` is called with 0 when the first compilation starts, and with the number of finished
    ones after each. Functions loaded from the cache do not count.
    """
    with event.install_listener("numba:compile", _Listener(on_count)):
        yield


class _Listener(event.Listener):
    def __init__(self, on_count: Callable[[int], None]) -> None:
        self._on_count = on_count
        self._started = False
        self._finished = 0

    def on_start(self, compilation: Any) -> None:
        if not self._started and _is_ours(compilation):
            self._started = True
            self._on_count(0)

    def on_end(self, compilation: Any) -> None:
        if _is_ours(compilation):
            self._finished += 1
            self._on_count(self._finished)


def _is_ours(compilation: Any) -> bool:
    """Whether the compiled function is stereocal's; numba compiles its own versions of NumPy's."""
    module: str = compilation.data["dispatcher"].py_func.__module__
    return module.startswith("stereocal.")


def clock() -> float:
    """Seconds as from `time.perf_counter`, without the time that this thread spent compiling.

    Loading compiled code from the cache, and waiting for another thread's compilation, are left
    out as well.
    """
    return time.perf_counter() - _waited.seconds


class _Waited(threading.local):
    """Seconds that one thread spent in numba's compiler lock."""

    seconds = 0.0
    depth = 0
    since = 0.0
    collecting = True


class _LockListener(event.Listener):
    """Times the outermost lock: compiling a function also compiles the functions that it calls.

    Garbage is not collected meanwhile: a tenth of the time goes into looking through numba's many
    objects, which are all in use.
    """

    def on_start(self, _: Any) -> None:
        if not _waited.depth:
            _waited.since = time.perf_counter()
            _waited.collecting = gc.isenabled()
            gc.disable()
        _waited.depth += 1

    def on_end(self, _: Any) -> None:
        _waited.depth -= 1
        if not _waited.depth:
            _waited.seconds += time.perf_counter() - _waited.since
            if _waited.collecting:
                gc.enable()


_waited = _Waited()
event.register("numba:compiler_lock", _LockListener())  # type: ignore[no-untyped-call]
