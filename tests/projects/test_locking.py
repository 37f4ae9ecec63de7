"""Locks: between threads, between processes, and after a process was killed."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.locking import LOCK, FileLock, locked

HOLDER = """
import sys, time
from pathlib import Path
from stereocal.locking import FileLock
lock = FileLock(Path(sys.argv[1]))
lock.acquire()
print("held", flush=True)
time.sleep(60)
"""


def test_two_locks_on_one_file_exclude_each_other(tmp_path: Path) -> None:
    first, second = FileLock(tmp_path / "a"), FileLock(tmp_path / "a")
    assert first.acquire(wait=False)
    assert not second.acquire(wait=False)
    first.release()
    assert second.acquire(wait=False)
    second.release()


def test_a_killed_process_lets_go(tmp_path: Path) -> None:
    path = tmp_path / "a"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        assert not FileLock(path).acquire(wait=False)
        holder.send_signal(signal.SIGKILL)
    lock = FileLock(path)
    assert lock.acquire(wait=False)
    lock.release()


def test_a_folder_is_one_threads_at_a_time_and_may_be_taken_again_inside(tmp_path: Path) -> None:
    count, seen = [0], []

    def add() -> None:
        for _ in range(50):
            with locked(tmp_path), locked(tmp_path):
                before = count[0]
                time.sleep(0.0001)  # lets the others run
                count[0] = before + 1
                seen.append(FileLock(tmp_path / LOCK).acquire(wait=False))

    threads = [threading.Thread(target=add) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert count == [200]
    assert not any(seen)
    assert FileLock(tmp_path / LOCK).acquire(wait=False)


def test_an_error_inside_lets_go(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), locked(tmp_path):
        raise ZeroDivisionError
    assert FileLock(tmp_path / LOCK).acquire(wait=False)


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(StereocalError, match="nowhere cannot be written to: No such file"):
        locked(tmp_path / "nowhere").__enter__()
