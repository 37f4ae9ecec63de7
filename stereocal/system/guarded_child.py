"""The child process of `guarded`: reads requests, tries files within limits, says if it survived.

It ends when its standard input does, so that it never outlives the server, even a killed one.
"""

from __future__ import annotations

import importlib
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from stereocal.errors import StereocalError

READY, SURVIVED, MEMORY, FAILED = "ready", "survived", "memory", "failed"
OPENCV_NO_MEMORY = -4


Prepared = tuple[int, Callable[[], object]]
"""Bytes of memory that the reading of a file may take, and the reading."""
GuardedReader = Callable[[Path], Prepared]
"""Looks at a file without any native code, and prepares its reading."""


def main(module: str) -> None:
    """Answer requests, one line of JSON each, until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a decoder prints is no answer
    _without_core_dumps()
    requests: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    readers: Mapping[str, GuardedReader] = importlib.import_module(module).READERS
    answer = READY
    while True:
        answers.write(answer + "\n")
        answers.flush()
        request = requests.get()
        answer = _tried(readers[request["kind"]], Path(request["path"]), request["seconds"])


def _listen(requests: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Take requests also while a decoder is at work, which may never come back."""
    for line in sys.stdin:
        requests.put(json.loads(line))
    os._exit(0)


def _tried(reader: GuardedReader, path: Path, seconds: float) -> str:
    if hasattr(signal, "alarm"):  # should the server that waits be gone, and all threads stuck
        signal.alarm(int(seconds) + 5)
    try:
        _limit_memory(None)  # that of the last file may be too small for this one
        room, read = reader(path)
        _limit_memory(room)
        read()
        return SURVIVED
    except StereocalError:
        return SURVIVED
    except MemoryError:
        return MEMORY
    except Exception as error:  # whatever it is, it must not happen in the server
        return MEMORY if getattr(error, "code", 0) == OPENCV_NO_MEMORY else FAILED
    finally:
        if hasattr(signal, "alarm"):
            signal.alarm(0)


def _limit_memory(room: int | None) -> None:
    """Allow so many bytes more than are in use now, where the system counts them; None: all."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        most = hard
        if room is not None:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            most = pages * resource.getpagesize() + room
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def _without_core_dumps() -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main(sys.argv[1])
