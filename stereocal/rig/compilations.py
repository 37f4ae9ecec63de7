"""What numba compiles, counted in all threads, and a clock that stands still meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


@contextmanager
def compilations(heard: Callable[[int], None]) -> Iterator[None]:
    """Call `heard` with 0 when the first function of stereocal begins to be compiled, and with
    their number so far whenever one is finished; not for what is read from the cache.
    """
    with event.install_listener("numba:compile", _Listener(heard)):
        yield


class _Listener(event.Listener):
    def __init__(self, heard: Callable[[int], None]) -> None:
        self._heard = heard
        self._begun = False
        self._finished = 0

    def on_start(self, found: Any) -> None:
        if not self._begun and _is_ours(found):
            self._begun = True
            self._heard(0)

    def on_end(self, found: Any) -> None:
        if _is_ours(found):
            self._finished += 1
            self._heard(self._finished)


def _is_ours(found: Any) -> bool:
    """What numba compiles of its own, for a function of NumPy, is not counted."""
    module: str = found.data["dispatcher"].py_func.__module__
    return module.startswith("stereocal.")


def clock() -> float:
    """Seconds, as `time.perf_counter`, but for those in which this thread compiles, reads compiled
    code from the cache, or waits for another thread that does.
    """
    return time.perf_counter() - _waited.seconds


class _Waited(threading.local):
    """Of one thread."""

    seconds = 0.0
    depth = 0
    since = 0.0


class _LockListener(event.Listener):
    """Compiling a function compiles those that it calls: only the outermost counts."""

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
