"""Checks before decoding: is each photograph readable, and do all have the same size?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from stereocal.errors import StereocalError
from stereocal.system.photograph import photograph_size
from stereocal.system.photograph_files import Photographs
from stereocal.system.tasks import Progress

Size = tuple[int, int]


def inspect_photographs(
    photographs: Photographs, progress: Progress, cancelled: Callable[[], bool]
) -> tuple[dict[str, Size], dict[str, str]] | None:
    """Size of each readable photograph, and an error message for each of the others, by name.

    Not run on workers: this takes 0.5 ms a photograph, the search 100 times as long.

    Returns None if cancelled.
    """
    sizes: dict[str, Size] = {}
    problems: dict[str, str] = {}
    for done, (name, path) in enumerate(photographs.items()):
        if cancelled():
            return None
        try:
            sizes[name] = photograph_size(path, name)
        except StereocalError as error:
            problems[name] = str(error)
        progress(done + 1, len(photographs))
    return sizes, problems


def wrong_sizes(
    names: Mapping[str, Sequence[str]], sizes: Mapping[str, Size], expected: Mapping[str, Size]
) -> dict[str, str]:
    """An error message for each photograph whose size differs from its camera's.

    Args:
        names: of the photographs of each camera.
        expected: (width, height) from each camera's file.
    """
    return {
        name: f"{name}: it has {sizes[name][0]}x{sizes[name][1]} px, and the {camera} camera's "
        f"file says {expected[camera][0]}x{expected[camera][1]}."
        for camera, own in names.items()
        for name in own
        if name in sizes and sizes[name] != expected[camera]
    }
