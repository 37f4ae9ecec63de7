"""Checks before decoding: is each photograph readable, and do all have the same size?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pair
from stereocal.rig.camera import CAMERAS
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
    pairs: Sequence[Pair], sizes: Mapping[str, Size], expected: Sequence[Size | None]
) -> dict[str, str]:
    """An error message for each photograph whose size differs from its camera's.

    Args:
        expected: (width, height) from each camera's file; None: the most common size.
    """
    problems = {}
    for camera, stated in enumerate(expected):
        names = [(pair.primary, pair.secondary)[camera] for pair in pairs]
        counted = Counter(sizes[name] for name in names if name in sizes)
        if not counted:
            continue
        usual, often = counted.most_common(1)[0]
        wanted = stated or usual
        reason = (
            f"the {CAMERAS[camera]} camera's file says {wanted[0]}x{wanted[1]}"
            if stated
            else f"{often} of the {len(names)} of the {CAMERAS[camera]} camera have "
            f"{wanted[0]}x{wanted[1]}"
        )
        for name in names:
            if name in sizes and sizes[name] != wanted:
                width, height = sizes[name]
                problems[name] = f"{name}: it has {width}x{height} px, and {reason}."
    return problems
