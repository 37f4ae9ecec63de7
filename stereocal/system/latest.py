"""What was computed last, kept in memory."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, cast, overload

from stereocal.errors import StereocalError

P = ParamSpec("P")
Value = TypeVar("Value")


class _Lock:
    """A lock that a copy of its owner does not share."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type["_Lock"], tuple[()]]:
        return _Lock, ()


class step(Generic[Value]):  # noqa: N801 - as `property`
    """A property that is computed when it is first asked for, by one thread, and kept.

    Others that ask for it wait. `functools.cached_property` has all instances wait (before Python
    3.12): also for the forecast of another recording.
    """

    def __init__(self, make: Callable[[Any], Value]) -> None:
        self._make, self.__doc__ = make, make.__doc__

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> "step[Value]": ...
    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...
    def __get__(self, instance: object | None, owner: type) -> "step[Value] | Value":
        if instance is None:
            return self
        kept = vars(instance)
        with kept.setdefault(f"_lock_{self._name}", _Lock()):
            if self._name not in kept:
                kept[self._name] = self._make(instance)
            return cast(Value, kept[self._name])


def is_made(instance: object, name: str) -> bool:
    """Whether a `step` of an instance has been computed."""
    return name in vars(instance)


class Latest(Generic[Value]):
    """The values used last, by key; any thread may use it."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._lock = threading.Lock()
        self._values: OrderedDict[str, Value] = OrderedDict()

    def get(self, key: str) -> Value | None:
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def clear(self) -> None:
        """Keep nothing."""
        with self._lock:
            self._values.clear()

    def once(self, key: str, make: Callable[[], Value]) -> Value:
        """The value of a key; made, and kept, if it is not kept yet."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        made = make()
        self.keep(key, made)
        return made

    def keep(self, key: str, value: Value) -> None:
        """Keep a value; that unused for longest makes room."""
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > self.most:
                self._values.popitem(last=False)


MOST = {
    **{"data set": 32, "recording": 8, "table": 8, "camera": 64, "run": 64, "answer": 64},
    **{"file": 32, "validation": 8, "screening": 64, "validation shown": 64, "points": 24},
    **{"photograph": 8, "thumbnail": 4000, "board in a photograph": 200, "board": 1000},
    **{"patterns": 64, "plan": 24, "card": 500, "title": 4096, "clusters": 100, "rays": 256},
    **{"footage of photographs": 4},
}
"""How many values of a step are kept; of another one `USUAL`."""
USUAL = 16
_KEPT: dict[str, Latest[Any]] = {}


def _of(step: str) -> Latest[Any]:
    return _KEPT.setdefault(step, Latest(MOST.get(step, USUAL)))


def once(step: str, key: str, make: Callable[[], Value]) -> Value:
    """A value from the one store of what is read or computed, for all sessions; made, and kept, if
    it is not kept yet.

    Args:
        step: what makes it, in words.
        key: all that it is made from, so that no value is ever out of date.
    """
    return cast(Value, _of(step).once(key, make))


def keep(step: str, key: str, value: object) -> None:
    """Keep a value that is there already."""
    _of(step).keep(key, value)


def get(step: str, key: str) -> Any:
    """A value, if it is kept, else None."""
    return _of(step).get(key)


def once_or_refused(step: str, key: str, make: Callable[[], Value]) -> Value:
    """A value, made once; an error is kept too, and raised each time, unless it may not last."""

    def answer() -> Value | StereocalError:
        try:
            return make()
        except StereocalError as error:
            if not error.lasts:
                raise
            return error

    value = once(step, key, answer)
    if isinstance(value, StereocalError):
        raise value.with_traceback(None)
    return value


def read_once(
    read: Callable[Concatenate[bytes, P], Value],
    content: bytes,
    *arguments: P.args,
    **named: P.kwargs,
) -> Value:
    """What a reader returns for a file's content, read once for this content and these arguments.

    For pages, which show a file on every draw. An error is kept as well: a file that takes its
    reader long to reject would otherwise take that long on every draw.

    Args:
        arguments: of the reader, after the content; distinguished by their `repr`.
    """
    call = (read.__module__, read.__qualname__, arguments, sorted(named.items()))
    key = f"{hashlib.sha256(content).hexdigest()} {call!r}"
    return once_or_refused("file", key, lambda: read(content, *arguments, **named))


def forget() -> None:
    """Keep nothing, as after a restart."""
    for values in _KEPT.values():
        values.clear()
