"""Files of several cameras that are given as one camera's, and chapters of one video that are given
as two cameras'."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath

from stereocal.frames.conventions import readings_by_words
from stereocal.frames.pairing import natural
from stereocal.frames.which_camera import Series, numbered_cameras, pair_by_last_number
from stereocal.rig.camera import CAMERAS
from stereocal.system.taken import Taken

SURE_RANK = 2
"""Words up to this rank (left, cam0, R) name a camera by themselves; `a` and `1/` may count days,
and do so only where the names of both are alike."""
MOST, ALL_BUT_FEW = 0.6, 0.9
"""Least share of the names that words tell: of names that are alike, and of others."""
FEWEST = 2
"""Photographs of a camera."""
CHAPTERS = tuple(
    re.compile(rf"(?<![a-z0-9]){name}(?!\d)", re.IGNORECASE)
    for name in (
        r"g[hxslp](?P<number>\d\d)\d{4}",
        r"(?:dji|vid|pro)_\d{4,}_(?:\d{2,}_)*(?P<number>\d{3})",
    )
)
"""Names of long recordings, which cameras divide: `GX020123` is the second chapter of 0123, in
older GoPros `GP010123` after `GOPR0123` (community.gopro.com, "GoPro Camera File Naming
Convention"); DJI and Insta360 count `DJI_0007_001`, `VID_20240501_101500_00_001` on."""


def cameras_told(taken: Mapping[str, Taken]) -> dict[str, Series]:
    """The photographs of each camera, by the cameras' names; empty unless names or files tell that
    there are two or more.

    Folders and numbers that do not name cameras, such as days, do not divide them.

    Args:
        taken: what each file says, by name.
    """
    names = sorted(taken, key=natural)
    if several := numbered_cameras(names):
        return {camera: Series(tuple(of_camera)) for camera, of_camera in several.items()}
    bodies = Counter(one.body for one in taken.values())
    if len(bodies) > 1 and "" not in bodies and min(bodies.values()) >= FEWEST:
        return _named({name: [*bodies].index(taken[name].body) for name in names})
    readings = readings_by_words(names)
    for reading in sorted(readings, key=lambda one: (-len(one.side_and_key), one.rank)):
        known = reading.side_and_key
        keys = [{key for side, key in known.values() if side == camera} for camera in (0, 1)]
        fewer, share = min(map(len, keys)), len(known) / len(names)
        alike = share >= MOST and 2 * len(keys[0] & keys[1]) >= fewer
        sure = share >= ALL_BUT_FEW and reading.rank <= SURE_RANK
        if fewer >= FEWEST and (alike or sure):
            return _named({name: known[name][0] for name in names if name in known})
    by_number = pair_by_last_number(names)
    of_both = len(by_number) >= 2 * FEWEST
    return _named({n: CAMERAS.index(side) for n, side in by_number.items()}) if of_both else {}


def _named(number_of: Mapping[str, int]) -> dict[str, Series]:
    numbers = sorted({*number_of.values()})
    labels = CAMERAS if len(numbers) == 2 else [f"camera_{k + 1}" for k in numbers]
    return {
        label: Series(tuple(name for name, its in number_of.items() if its == number))
        for number, label in zip(numbers, labels, strict=True)
    }


def chapters_of(names: Iterable[str]) -> list[list[str]]:
    """Videos by recording: the chapters of one in their order, others by themselves."""
    recordings: dict[str, list[tuple[int, str]]] = {}
    for name in names:
        path = PurePosixPath(name.replace("\\", "/"))
        stem = re.sub(r"(?<![a-z0-9])gopr(?=\d{4}(?!\d))", "GP00", path.stem, flags=re.IGNORECASE)
        hit = next((hit for pattern in CHAPTERS if (hit := pattern.search(stem))), None)
        key, chapter = name, 0
        if hit is not None:
            start, end = hit.span("number")
            key = f"{path.parent}/{stem[:start]}#{stem[end:]}{path.suffix}"
            chapter = int(hit["number"])
        recordings.setdefault(key.lower(), []).append((chapter, name))
    return [[name for _, name in sorted(recording)] for recording in recordings.values()]


def chapters_in_words(names: Iterable[str]) -> str:
    """How to join videos that are chapters of one recording; empty if none are."""
    several = next((one for one in chapters_of(names) if len(one) > 1), [])
    if not several:
        return ""
    listing = "\\n".join(f"file '{name}'" for name in several)
    return (
        f"{', '.join(several[:-1])} and {several[-1]} are chapters of one recording of one camera: "
        f'join them first, as with ffmpeg: printf "{listing}" > list.txt; ffmpeg -f concat -safe '
        f"0 -i list.txt -c copy joined{PurePosixPath(several[0]).suffix}"
    )
