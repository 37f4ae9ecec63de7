"""Camera profiles of Argus: a row for each camera, with one focal length and five coefficients.

`clicker_profile.txt` begins with the number of the camera, the tables of its lenses with a mode:
number, focal length (px), width, height, cx, cy, aspect ratio, k1, k2, t1, t2, k3.
"""

import re

from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import (
    ONE_LENS,
    CameraFormat,
    CameraPair,
    Files,
    camera_from,
    camera_matrix,
    only_file,
)
from stereocal.formats.file_storage import ForeignFile
from stereocal.formats.point_files import is_number_or_empty

ENDINGS = (".txt", ".csv", ".tsv")
_SEPARATOR = re.compile(r"[,;\s]+")
NUMBERS = 11
"""In a row, after the camera."""
ASPECT = (0.5, 2.0)
"""Plausible fy / fx, which tells a profile from a table of points."""


def _rows(file: ForeignFile) -> list[list[str]]:
    """The cells of each camera; empty if it is no profile."""
    if not file.ends_with(*ENDINGS) or len(file.content) > 20_000:
        return []
    lines = file.content.decode("utf-8-sig", errors="replace").splitlines()
    rows = [_SEPARATOR.split(line.strip()) for line in lines if line.strip()]
    rows = [
        row for k, row in enumerate(rows) if k or all(map(is_number_or_empty, row[1 : 1 + NUMBERS]))
    ]
    named = len({row[0] for row in rows}) == len(rows)
    return rows if named and all(map(_is_camera, rows)) else []


def _is_camera(row: list[str]) -> bool:
    numbers = row[1 : 1 + NUMBERS]
    if len(numbers) < NUMBERS or not all(map(is_number_or_empty, numbers)):
        return False
    _, width, height, cx, cy, aspect, *_ = map(float, numbers)
    inside = 0 < cx < width and 0 < cy < height
    return inside and width % 1 == height % 1 == 0 and ASPECT[0] < aspect < ASPECT[1]


def read_profile(files: Files, options: ExchangeOptions, source: str) -> CameraPair:
    """Two cameras of a profile, without a pose; a profile of one camera is a lens for both."""
    file = only_file(files, ENDINGS, source)
    rows = _rows(file)
    names = [row[0] for row in rows]
    chosen = chosen_pair(names, options.cameras, file.name) if len(rows) > 1 else None
    cameras = []
    for k, row in enumerate([rows[each] for each in chosen.pair] if chosen else rows * 2):
        focal, width, height, cx, cy, aspect, *lens = map(float, row[1 : 1 + NUMBERS])
        K = camera_matrix(focal, focal * aspect, cx, cy)
        where = f"{file.name}, {row[0]}"
        cameras.append(camera_from(K, lens, (width, height), False, options, k, where))
    no_pose = f"{file.name}: a camera profile has no pose."
    words = chosen.words if chosen else ONE_LENS
    return CameraPair(cameras[0], cameras[1], None, no_pose, "Argus profile", words, chosen)


ARGUS = CameraFormat(
    "Argus camera profile",
    read_profile,
    lambda file: bool(_rows(file)),
    lambda file: tuple(row[0] for row in _rows(file)),
)
