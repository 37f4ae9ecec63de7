"""Count numba's compilations, and a clock that excludes the time they take."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


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

    def on_start(self, found: Any) -> None:
        if not self._started and _is_ours(found):
            self._started = True
            self._on_count(0)

    def on_end(self, found: Any) -> None:
        if _is_ours(found):
            self._finished += 1
            self._on_count(self._finished)


def _is_ours(found: Any) -> bool:
    """Whether the compiled function is stereocal's; numba compiles its own versions of NumPy's."""
    module: str = found.data["dispatcher"].py_func.__module__
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
