"""Decorators that compile hot functions with numba: cached on disk, without the GIL."""

import functools
import hashlib
import inspect
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import event

from stereocal.system.array_types import FloatArray

P = ParamSpec("P")
T = TypeVar("T")


_PACKAGE = Path(__file__).parents[1]
_SETTINGS: Any = numba.config  # whose type hints lack them
_KEPT = Path(_SETTINGS.CACHE_DIR or _PACKAGE / "__pycache__")
_IMPORTED = re.compile(rf"^from ({_PACKAGE.name}[.\w]*) import ([\w, ]*)", re.MULTILINE)

FAST_MATH = {"contract", "nsz", "arcp", "reassoc"}
"""Allows reordered sums, so that loops over points are vectorised; keeps the rules for NaN."""

DAY_S = 86400.0
END_OF_PICKLE = b"."

_ON_DISK: list[tuple[Path, str]] = []
"""The folder and the name of each function of this package that was decorated."""
_DECORATING = threading.Lock()


def compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Compile a function at its first call.

    A division by zero gives inf or NaN as in NumPy. A NaN cost never counts as an improvement.
    """
    return _decorated(function)


def inlined(function: Callable[P, T]) -> Callable[P, T]:
    """What `compiled` is, inlined into its callers: a call inside a loop prevents vectorisation."""
    return _decorated(function, forceinline=True)


def _decorated(function: Callable[P, T], forceinline: bool = False) -> Callable[P, T]:
    """The compiled function, kept in the folder of its file's state, or else not at all.

    Where numba cannot write there, it would take code from beside the source, whatever its state.
    """
    folder = _folder(Path(inspect.getfile(function)))

    def decorate(cache: bool) -> Callable[P, T]:
        made: Callable[P, T] = numba.njit(
            cache=cache,
            nogil=True,
            error_model="numpy",
            fastmath=FAST_MATH,
            forceinline=forceinline,
        )(function)
        return made

    with _DECORATING:
        others, _SETTINGS.CACHE_DIR = _SETTINGS.CACHE_DIR, str(folder)
        try:
            decorated = decorate(cache=True)
        finally:
            _SETTINGS.CACHE_DIR = others
    if decorated is function:  # with NUMBA_DISABLE_JIT
        return function
    dispatcher: Any = decorated
    if not Path(dispatcher.stats.cache_path).is_relative_to(folder):
        decorated = decorate(cache=False)
    elif function.__module__.startswith(f"{_PACKAGE.name}."):
        _ON_DISK.append((folder, function.__qualname__))
    return decorated


def uncompiled() -> bool:
    """Whether the cache lacks any function of the modules that are imported."""
    return not all(any(folder.glob(f"*/*.{name}-*.nbi")) for folder, name in _ON_DISK)


@functools.cache
def _folder(path: Path) -> Path:
    """Where the compiled functions of a source file are kept.

    Those of its earlier states go once nothing was written there for a day: another process may
    still run one. So do files that a power cut left empty or cut off, since numba's reader raises.

    Compiled code contains the functions it calls and the constants it reads from other modules, but
    numba looks only at the function's own file: each state of the file and of all modules of this
    package that it imports, recursively, has a folder of its own. Its name is short for Windows.
    """
    seen, left = {path}, [path]
    while left:
        new = _source(left.pop())[1] - seen
        left += new
        seen |= new
    stamp = hashlib.sha256(b"".join(_source(file)[0] for file in sorted(seen))).hexdigest()[:12]
    owner = f"{path} {numba.__version__} {sys.implementation.cache_tag}"
    prefix = hashlib.sha256(owner.encode()).hexdigest()[:8]
    folder = _KEPT / f"{prefix}-{stamp}"
    with suppress(OSError):  # another process removes the same
        for earlier in _KEPT.glob(f"{prefix}-*"):
            written = max(at.stat().st_mtime for at in (earlier, *earlier.iterdir()))
            if earlier != folder and time.time() - written > DAY_S:
                shutil.rmtree(earlier, ignore_errors=True)
        for kept in folder.glob("*/*.nb[ci]"):
            if _last_byte(kept) != END_OF_PICKLE:
                kept.unlink(missing_ok=True)
    return folder


def _last_byte(file: Path) -> bytes:
    """Of a file that may be empty; the rest, megabytes of code, is not read at each start."""
    with file.open("rb") as content:
        content.seek(max(content.seek(0, os.SEEK_END) - 1, 0))
        return content.read()


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


class _LockListener(event.Listener):
    """Times the outermost lock: compiling a function also compiles the functions that it calls."""

    def on_start(self, _: Any) -> None:
        if not _waited.depth:
            _waited.since = time.perf_counter()
        _waited.depth += 1

    def on_end(self, _: Any) -> None:
        _waited.depth -= 1
        if not _waited.depth:
            _waited.seconds += time.perf_counter() - _waited.since


_waited = _Waited()
event.register("numba:compiler_lock", _LockListener())  # type: ignore[no-untyped-call]
