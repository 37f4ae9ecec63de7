"""Pass photographs to workers: by path if they can access this disk, else by content."""

from __future__ import annotations

from concurrent.futures import Executor

from stereocal.system.executors import Cluster
from stereocal.system.photograph import (
    FileContent,
    GreyImage,
    decode_colours,
    decode_photograph,
    read_colours,
    read_photograph,
)

PhotographFile = FileContent | bytes


def for_worker(path: FileContent, executor: Executor) -> PhotographFile:
    """The photograph as an argument of a task."""
    if not isinstance(executor, Cluster):
        return path
    try:
        return path.read_bytes()
    except OSError:  # the worker will report it
        return path


def read_for_worker(photograph: PhotographFile, name: str) -> GreyImage:
    """The photograph of `for_worker`; `name` is its name in messages."""
    if isinstance(photograph, bytes):
        return decode_photograph(photograph, name)
    return read_photograph(photograph, name)


def read_colours_for_worker(photograph: PhotographFile, name: str) -> GreyImage:
    """As `read_for_worker`, (h, w, 3): blue, green, red."""
    if isinstance(photograph, bytes):
        return decode_colours(photograph, name)
    return read_colours(photograph, name)
