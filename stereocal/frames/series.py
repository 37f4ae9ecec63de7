"""Find the targets in many photographs on all cores, with progress and cancelling."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import closing
from typing import TypeVar

import cv2

from stereocal.detection.balls import find_balls
from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.detection.sighting import Sighting
from stereocal.detection.tags import find_tags
from stereocal.detection.target import Balls, Tags
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.system.photograph import PhotographFile, read_colours, read_photograph
from stereocal.system.photograph_files import Photographs, for_worker
from stereocal.system.tasks import Pieces, Progress, StoppedError, Task, run_tasks

T = TypeVar("T")


def detect_series(
    photographs: Photographs,
    executor: Executor,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[Detection] | None = None,
) -> dict[str, Detection] | None:
    """Find the 2x2 targets in each photograph, as `search_series`."""
    return search_series(
        photographs, lambda _: detect_in_file, executor, progress, cancelled, pieces
    )


def search_series(
    photographs: Photographs,
    search_of: Callable[[str], Callable[[PhotographFile, str], T]],
    executor: Executor,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[T] | None = None,
) -> dict[str, T] | None:
    """Search each photograph.

    Memory does not grow with the number of photographs. An unreadable one is refused with the
    reader's error message.

    Args:
        search_of: by a photograph's name, the search, which can be pickled.
        progress: called with the number done and the total.
        cancelled: polled during the search.
        pieces: checkpoint of earlier results by file name, which must identify the content.

    Returns the results by name; None if cancelled.
    """
    tasks = (
        Task(path.name, search_of(name), (for_worker(path, executor), name))
        for name, path in photographs.items()
    )
    every = run_tasks(tasks, executor, len(photographs), progress, cancelled, pieces)
    try:
        with closing(every) as finished:
            return dict(zip(photographs, (found for _, found in finished), strict=True))
    except StoppedError:
        return None


def detect_in_file(photograph: PhotographFile, name: str) -> Detection:
    """The 2x2 targets of one photograph: the task of an executor."""
    cv2.setNumThreads(1)  # the executor already uses all cores
    try:
        return detect_targets(read_photograph(photograph, name))
    except StereocalError as error:
        return refusal((0, 0), "unreadable", str(error))


def sight_in_file(
    target: Balls | Tags, camera: Camera, photograph: PhotographFile, name: str
) -> Sighting:
    """The targets with names of their own in one photograph: the task of an executor."""
    cv2.setNumThreads(1)
    try:
        if isinstance(target, Tags):
            return find_tags(read_photograph(photograph, name), target, camera)
        return find_balls(read_colours(photograph, name), target, camera)
    except StereocalError as error:
        return Sighting((None, None), str(error), unreadable=True)
