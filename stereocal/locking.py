"""One at a time: threads of a server, and processes that share a folder.

A lock is let go of when its process ends, however it ends.
"""

from __future__ import annotations

import errno
import os
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stereocal.errors import StereocalError

LOCK = ".lock"
"""The file below a folder that carries its lock; it stays, empty."""
WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOTSUP)
"""What file systems say that know no locks, some on a network: processes there are on their own."""

if os.name == "nt":
    import msvcrt

    def _take(handle: int, wait: bool) -> None:
        while True:
            try:
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
                return
            except PermissionError as error:  # somebody else has it
                if not wait:
                    raise BlockingIOError from error
                time.sleep(0.01)
else:
    import fcntl

    def _take(handle: int, wait: bool) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


class FileLock:
    """An exclusive lock on a file, which is made if it is not there.

    Two locks on one file exclude each other, also within a process.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle: int | None = None

    def acquire(self, wait: bool = True) -> bool:
        """Take the lock; False if another has it and `wait` is.

        Raises:
            OSError: the file cannot be opened for writing.
        """
        handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            _take(handle, wait)
        except BlockingIOError:
            os.close(handle)
            return False
        except OSError as error:
            if error.errno not in WITHOUT_LOCKS:
                os.close(handle)
                raise
        self._handle = handle
        return True

    def release(self) -> None:
        """Let go of the lock, if it is held."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


class _Folder:
    """Who has the lock of a folder in this process. Weakly kept: an instance a folder."""

    def __init__(self) -> None:
        self.threads = threading.RLock()
        self.depth = 0


_FOLDERS: weakref.WeakValueDictionary[str, _Folder] = weakref.WeakValueDictionary()
_FINDING = threading.Lock()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Have a folder for oneself; the same thread may take it again inside.

    Raises:
        StereocalError: there is no such folder, or nothing can be written to it.
    """
    with _FINDING:
        own = _FOLDERS.setdefault(str(folder.absolute()), _Folder())
    with own.threads:
        lock = FileLock(folder / LOCK)
        own.depth += 1
        try:
            if own.depth == 1:
                try:
                    lock.acquire()
                except OSError as error:
                    raise StereocalError(
                        f"The folder {folder.name} cannot be written to: {error.strerror or error}."
                    ) from error
            yield
        finally:
            own.depth -= 1
            lock.release()
