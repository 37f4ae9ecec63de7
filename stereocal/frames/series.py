"""Find the targets in many photographs on all cores, with progress and cancelling."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import closing

import cv2

from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.errors import StereocalError
from stereocal.system.photograph_files import Photographs
from stereocal.system.photograph_tasks import PhotographFile, for_worker, read_for_worker
from stereocal.system.tasks import Pieces, Progress, StoppedError, Task, run_tasks


def detect_series(
    photographs: Photographs,
    executor: Executor,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[Detection] | None = None,
) -> dict[str, Detection] | None:
    """Find the targets in each photograph.

    Memory does not grow with the number of photographs. An unreadable one is refused with the
    reader's error message.

    Args:
        progress: called with the number done and the total.
        cancelled: polled during the search.
        pieces: checkpoint of earlier results by file name, which must identify the content.

    Returns the detections by name; None if cancelled.
    """
    tasks = (
        Task(path.name, detect_in_file, (for_worker(path, executor), name))
        for name, path in photographs.items()
    )
    every = run_tasks(tasks, executor, len(photographs), progress, cancelled, pieces)
    try:
        with closing(every) as finished:
            return dict(zip(photographs, (found for _, found in finished), strict=True))
    except StoppedError:
        return None


def detect_in_file(photograph: PhotographFile, name: str) -> Detection:
    """The detection of one photograph: the task of an executor."""
    cv2.setNumThreads(1)  # the executor already uses all cores
    try:
        return detect_targets(read_for_worker(photograph, name))
    except StereocalError as error:
        return refusal((0, 0), "unreadable", str(error))
