"""The long work of a project on disk: what was begun, how far it is, and what it has finished.

Below the project's folder, in `jobs/<kind>/`, for one job of a kind at a time:

- `job.json`: the record (`Record`); there while the job runs, and after one that failed.
- `progress.json`: how far it is.
- `lock`: held by the process that runs the job, and let go of when that ends, however it ends. A
  record without a holder is a job that was interrupted.
- `<digest>/<stage>`: finished parts (`parts.Parts`) of the work with this digest.
- `cancel`: somebody at another server has asked for the job to stop.

All of it belongs to this server: it is not carried with a project nor copied.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
import numba
import numpy as np
import scipy

import stereocal
from stereocal.errors import DAMAGED, LONGEST, StereocalError, can_be_shown
from stereocal.locking import FileLock
from stereocal.store.parts import Parts
from stereocal.system.atomic_files import make_folder, write_atomically

T = TypeVar("T")
JOBS = "jobs"
"""The folder below a project's."""
MOST = 10**12
LATEST_S = 1e11
"""The year 5138."""
JOB_FORMAT = "stereocal-job/1"
EVERY_S = 1.0
"""Progress is written at most so often."""
PATIENCE_S = 0.3
"""Who only looks whether a job runs holds its lock for a moment."""
LOOKING_S = 0.05
"""Two who look at the same moment do not take each other for a job."""
State = Literal["running", "interrupted", "failed"]


@dataclass(frozen=True)
class Record:
    """A job that was begun."""

    kind: str
    stages: tuple[str, ...]
    """What is counted, in the order of the work."""
    digest: str
    """Of the work and of the software that does it."""
    work: Mapping[str, Any]
    """Inputs, by their digests, and settings."""
    begun: float
    """Seconds since 1970."""
    at: int = 0
    """Number of the stage."""
    done: int = 0
    total: int = 0
    sentence: str = ""
    """Why it failed; empty while it has not."""


def digest_of(kind: str, work: Mapping[str, Any]) -> str:
    """The same for the same work done by the same software."""
    software = [one.__version__ for one in (stereocal, np, scipy, numba, cv2)]
    content = json.dumps([kind, work, software], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:32]


class KeptJob:
    """A job that this process runs, made by `begin`; for the thread that runs it."""

    def __init__(self, folder: Path, lock: FileLock, record: Record) -> None:
        self.folder = folder
        self.record = record
        self._lock = lock
        self._parts: list[Parts[Any]] = []
        self._written = 0.0

    def parts(
        self, stage: str, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]
    ) -> Parts[T]:
        """What the same work has finished of a stage before, and where more of it is kept.

        Raises:
            StereocalError: the disk cannot be written to.
        """
        found = Parts(self.folder / self.record.digest / stage, pack, unpack)
        self._parts.append(found)
        return found

    def progress(self, at: int, done: int, total: int) -> bool:
        """Note how far the job is, at most once a second.

        Returns:
            False where it is to stop: somebody has asked for it, or the project was removed.
        """
        self.record = replace(self.record, at=at, done=done, total=total)
        if time.monotonic() - self._written < EVERY_S:
            return True
        self._written = time.monotonic()
        if not (self.folder / "job.json").is_file():
            return False
        with suppress(StereocalError):  # on a full disk the job goes on
            self._write_progress()
        return not (self.folder / "cancel").exists()

    def end(self) -> None:
        """It has ended well, or was cancelled: nothing of it is kept."""
        self._close()
        with suppress(OSError):
            _forget(self.folder)
        self._lock.release()

    def fail(self, sentence: str) -> None:
        """It could not be done. The reason is kept until the next, and what was finished too."""
        self._close()
        with suppress(StereocalError):  # on a full disk: it is shown as interrupted
            if (self.folder / "job.json").is_file():
                self._write_progress()
                _write(self.folder, replace(self.record, sentence=sentence))
        self._lock.release()

    def _write_progress(self) -> None:
        how_far = {name: getattr(self.record, name) for name in ("at", "done", "total")}
        write_atomically(self.folder / "progress.json", json.dumps(how_far).encode())

    def _close(self) -> None:
        for parts in self._parts:
            parts.close()


def begin(
    project: Path, kind: str, stages: Sequence[str], work: Mapping[str, Any]
) -> KeptJob | None:
    """Begin a job of a project's folder; None where one of its kind runs, here or elsewhere.

    What the same work had finished is there again; parts of any other are removed.

    Raises:
        StereocalError: the disk cannot be written to.
    """
    folder = project / JOBS / kind
    lock = FileLock(folder / "lock")
    try:
        make_folder(folder)
        if not _acquired(lock):
            return None
        record = Record(kind, tuple(stages), digest_of(kind, work), work, time.time())
        for path in folder.iterdir():
            if path.is_dir() and path.name != record.digest:
                shutil.rmtree(path, ignore_errors=True)
            elif path.name in ("cancel", "progress.json") or path.name.startswith("."):
                path.unlink()  # those with a dot were never finished
        (folder / record.digest).mkdir(exist_ok=True)
        _write(folder, record)
    except OSError as error:
        lock.release()
        raise _refusal(error) from error
    except StereocalError:
        lock.release()
        raise
    return KeptJob(folder, lock, record)


def find(project: Path, kind: str) -> tuple[State, Record] | None:
    """The job of this kind that a project has on disk, and how it stands; None without one."""
    folder = project / JOBS / kind
    record = _read(folder)
    if record is None:
        return None
    lock = FileLock(folder / "lock")
    try:
        if not _acquired(lock, LOOKING_S):
            return "running", record
        try:
            # Once more: it may have ended in between.
            record = _read(folder)
        finally:
            lock.release()
    except OSError:
        pass  # nobody can run a job where nothing can be written
    if record is None:
        return None
    return "failed" if record.sentence else "interrupted", record


def interrupted(project: Path) -> list[Record]:
    """The jobs of a project that ended with their server."""
    folder = project / JOBS
    kinds = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    found = [find(project, kind) for kind in kinds]
    return [one[1] for one in found if one is not None and one[0] == "interrupted"]


def discard(project: Path, kind: str) -> None:
    """Forget a job that does not run, with what it had finished."""
    folder = project / JOBS / kind
    lock = FileLock(folder / "lock")
    try:
        if folder.is_dir() and _acquired(lock):
            _forget(folder)
            lock.release()
    except OSError as error:
        raise _refusal(error) from error


def ask_to_stop(project: Path, kind: str) -> None:
    """Ask the server that runs a job to cancel it; it does so within a second or two."""
    try:
        (project / JOBS / kind / "cancel").touch()
    except OSError as error:
        raise StereocalError(f"The job cannot be stopped: {error.strerror or error}.") from error


def _refusal(error: OSError) -> StereocalError:
    return StereocalError(f"The project's folder cannot be written to: {error.strerror or error}.")


def _acquired(lock: FileLock, patience_s: float = PATIENCE_S) -> bool:
    until = time.monotonic() + patience_s
    while not lock.acquire(wait=False):
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def _forget(folder: Path) -> None:
    # The record first: what is left without one is removed when the next job begins.
    for name in ("job.json", "progress.json", "cancel"):
        (folder / name).unlink(missing_ok=True)
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)


def _write(folder: Path, record: Record) -> None:
    content = {"format": JOB_FORMAT, **asdict(record)}
    write_atomically(folder / "job.json", json.dumps(content, indent=1).encode())


def _read(folder: Path) -> Record | None:
    """None where there is none, or one that cannot be read, which nobody could go on with."""
    try:
        content = json.loads((folder / "job.json").read_bytes())
        if content.pop("format") != JOB_FORMAT:
            return None
        record = Record(**{**content, "stages": tuple(content["stages"])})
        _check(record)
    except DAMAGED:
        return None
    try:
        how_far = json.loads((folder / "progress.json").read_bytes())
        at, done, total = (int(how_far[name]) for name in ("at", "done", "total"))
        found = replace(record, at=at, done=done, total=total)
        _check(found)
        return found
    except DAMAGED:
        return record


def _check(record: Record) -> None:
    """ValueError for a record that nobody has written."""
    texts = (*record.stages, record.kind, record.digest, record.sentence)
    if not all(map(can_be_shown, texts)) or len(record.sentence) > LONGEST:
        raise ValueError(record)
    if not (0 <= record.at < len(record.stages) and 0 <= record.done <= record.total <= MOST):
        raise ValueError(record)
    if not 0 <= record.begun < LATEST_S or not isinstance(record.work, dict):
        raise ValueError(record)
