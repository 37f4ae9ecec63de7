"""Targets in many photographs: on all cores, with progress and cancel, in little memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path
from typing import Any

import cv2
import numpy.typing as npt

from stereocal.detection import Detection, detect_targets, refusal
from stereocal.errors import StereocalError

Read = Callable[[Path], npt.NDArray[Any]]

AHEAD = 16
"""Photographs that are handed to the workers before the first is done; each worker holds one."""


def detect_series(
    paths: Sequence[Path],
    read: Read,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> list[Detection] | None:
    """Find the targets in each photograph.

    Only paths go to the workers and only detections come back, so memory does not grow with the
    number of photographs. One that cannot be read is refused with the reader's sentence.

    Args:
        read: gives the grey photograph (h, w) of a path; a function of a module, so that worker
            processes can find it.
        progress: called with how many are done, and of how many.
        cancelled: asked after each photograph.

    Returns the detections in the order of the paths; None when cancelled.
    """
    found: list[Detection | None] = [None] * len(paths)
    waiting: dict[Future[Detection], int] = {}
    given = done = 0
    while done < len(paths):
        if cancelled is not None and cancelled():
            for future in waiting:
                future.cancel()
            return None
        while given < len(paths) and len(waiting) < AHEAD:
            waiting[executor.submit(detect_path, paths[given], read)] = given
            given += 1
        finished, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
        for future in finished:
            found[waiting.pop(future)] = future.result()
            done += 1
            if progress is not None:
                progress(done, len(paths))
    return [detection for detection in found if detection is not None]


def detect_path(path: Path, read: Read) -> Detection:
    """The detection of one photograph on disk."""
    cv2.setNumThreads(1)  # the executor already uses all cores
    try:
        return detect_targets(read(path))
    except StereocalError as error:
        return refusal((0, 0), "unreadable", str(error))
