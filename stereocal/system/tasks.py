"""Long computations piece by piece: what was finished before is taken, and the rest computed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Executor, Future, as_completed
from typing import Any, Protocol, TypeVar

T = TypeVar("T")
Task = tuple[Callable[..., T], tuple[Any, ...]]
"""A function of a module and its arguments, as an executor gets them."""


class Pieces(Protocol[T]):
    """Finished pieces by a key, which tells all that a piece depends on."""

    def get(self, key: str, /) -> T | None:
        """The piece; None where it has not been finished, or cannot be read."""

    def keep(self, key: str, piece: T, /) -> None:
        """Keep a finished piece."""


def each_finished(
    executor: Executor, tasks: Mapping[str, Task[T]], pieces: Pieces[T] | None = None
) -> Generator[tuple[str, T], None, None]:
    """Key and result of each task: first those kept, then the others in the order they finish.

    When it is closed, what has not begun is dropped: iterate inside `contextlib.closing`.
    """
    futures: dict[Future[T], str] = {}
    try:
        for key, (function, arguments) in tasks.items():
            kept = None if pieces is None else pieces.get(key)
            if kept is not None:
                yield key, kept
            else:
                futures[executor.submit(function, *arguments)] = key
        for future in as_completed(futures):
            key, found = futures[future], future.result()
            if pieces is not None:
                pieces.keep(key, found)
            yield key, found
    finally:
        for future in futures:
            future.cancel()
