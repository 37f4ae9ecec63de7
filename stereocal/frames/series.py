"""Targets in many photographs: on all cores, with progress and cancel, in little memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any

import cv2
import numpy.typing as npt

from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.errors import StereocalError
from stereocal.system.photograph import FileContent
from stereocal.system.tasks import Pieces

Read = Callable[[FileContent], npt.NDArray[Any]]

AHEAD = 16
"""Photographs that are handed to the workers before the first is done; each worker holds one."""


def detect_series(
    paths: Sequence[FileContent],
    read: Read,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[Detection] | None = None,
) -> list[Detection] | None:
    """Find the targets in each photograph.

    Only paths go to the workers and only detections come back, so memory does not grow with the
    number of photographs. One that cannot be read is refused with the reader's sentence.

    Args:
        read: gives the grey photograph (h, w) of a path; a function of a module, so that worker
            processes can find it.
        progress: called with how many are done, and of how many.
        cancelled: asked after each photograph.
        pieces: what was found before, by the file's name, which must tell its content, and where
            more is kept.

    Returns the detections in the order of the paths; None when cancelled.
    """
    found = [pieces.get(path.name) if pieces is not None else None for path in paths]
    missing = [at for at, detection in enumerate(found) if detection is None]
    waiting: dict[Future[Detection], int] = {}
    given, done = 0, len(paths) - len(missing)
    while done < len(paths):
        if cancelled is not None and cancelled():
            for future in waiting:
                future.cancel()
            return None
        while given < len(missing) and len(waiting) < AHEAD:
            at = missing[given]
            waiting[executor.submit(detect_path, paths[at], read)] = at
            given += 1
        finished, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
        for future in finished:
            at = waiting.pop(future)
            found[at] = detection = future.result()
            done += 1
            if pieces is not None:
                pieces.keep(paths[at].name, detection)
            if progress is not None:
                progress(done, len(paths))
    return [detection for detection in found if detection is not None]


def detect_path(path: FileContent, read: Read) -> Detection:
    """The detection of one photograph on disk."""
    cv2.setNumThreads(1)  # the executor already uses all cores
    try:
        return detect_targets(read(path))
    except StereocalError as error:
        return refusal((0, 0), "unreadable", str(error))
