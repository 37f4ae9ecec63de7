"""Notice of numba compiling something, in any thread of this process; nothing is said of what it
reads from its cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


@contextmanager
def compilations(heard: Callable[[int], None]) -> Iterator[None]:
    """Call `heard` with 0 when the first function of stereocal begins to be compiled, and with
    their number so far whenever one is finished.
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
