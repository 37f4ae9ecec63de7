"""DLT coefficients, for DLTdv, easyWand and Argus: 11 rows, one column per camera.

`u = (L1 X + L2 Y + L3 Z + L4) / (L9 X + L10 Y + L11 Z + 1)`, v with L5 to L8, for undistorted
points; the lens is not in the file. They are P = K [R | t] row by row, divided by its last entry.

That entry is the depth of the world's origin. So where the origin is in front of a camera, the
determinant of the first three columns is positive, unless v is counted from below.
"""

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.exchange.camera_format import (
    ExchangeFormat,
    Files,
    ForeignPair,
    Posed,
    camera_from,
    decomposed,
    number,
    only_file,
    size_of,
)
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import CORNERS, ExchangeOptions, OriginError
from stereocal.formats.file_storage import ForeignFile
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from stereocal.system.arrays import LARGEST
from stereocal.system.numbers import is_number

ORIGIN_BEHIND_M = 1e-6
"""DLT cannot represent a camera at the origin, where the last entry of P is 0. So without a world
frame of the user, the origin is put 0.001 mm in front of the primary camera."""
COEFFICIENTS = 11
ENDINGS = (".csv", ".txt", ".tsv")
WHOLE = re.compile(r"[-+]?\d*")


def write_dlt(cameras: Sequence[Posed], options: ExchangeOptions) -> dict[str, bytes]:
    """`dlt.csv`, a column a camera."""
    first = Pose(np.eye(3), np.array([0.0, 0.0, ORIGIN_BEHIND_M]))
    if options.world is not None:
        first = options.world.inverse()
    columns = [dlt_coefficients(camera, pose @ first, options) for _, camera, pose in cameras]
    rows = zip(*columns, strict=True)
    return {"dlt.csv": "".join(",".join(map(number, row)) + "\n" for row in rows).encode()}


def dlt_coefficients(
    camera: Camera, camera_from_world: Pose, options: ExchangeOptions
) -> FloatArray:
    """(11,): of a camera, for undistorted pixels with the origin of `options`."""
    origin = options.origin().matrix(camera.image_size[1])
    P = origin @ camera.K @ np.column_stack([camera_from_world.R, camera_from_world.T])
    if abs(P[2, 3]) < 1e-9:
        raise StereocalError(
            "The origin of the world lies in the plane of a camera's centre, where DLT "
            "coefficients do not exist: move the world's origin."
        )
    return np.asarray((P / P[2, 3]).ravel()[:11])


def read_dlt(files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras without lens distortion, and their pose; the world frame is ignored."""
    names, table, name = _coefficients(files, source)
    chosen = chosen_pair(names, options.cameras, name)
    cameras, poses, behind = [], [], []
    for k, which in enumerate(CAMERAS):
        where = f"{name}, {which}"
        size = size_of(None, options, k, name)
        P = table[chosen.pair[k]].reshape(3, 4)
        P = np.linalg.inv(options.origin().matrix(size[1])) @ P
        K, pose = decomposed(P, where)
        cameras.append(camera_from(K, (), size, False, options, k, where))
        poses.append(pose)
        behind.append(bool(np.linalg.det(P[:, :3]) < 0))
    # The file cannot state a unit; our files are recognised by their world origin.
    near = np.allclose(poses[0].T[:2], 0.0, rtol=0, atol=1e-3 * ORIGIN_BEHIND_M) and np.isclose(
        abs(poses[0].T[2]), ORIGIN_BEHIND_M, rtol=1e-3, atol=0
    )
    if options.corner is None and (all(behind) or (near and behind[0])):
        raise OriginError(name)
    ours = near and np.allclose(poses[0].R, np.eye(3), rtol=0, atol=1e-6)
    pair = ForeignPair(cameras[0], cameras[1], poses[1] @ poses[0].inverse(), chosen=chosen)
    return replace(pair, stated="m") if ours else replace(pair, notes=_on_origin(behind, options))


def _on_origin(behind: Sequence[bool], options: ExchangeOptions) -> tuple[str, ...]:
    """A note if the world's origin lies behind a camera, so that v may be counted otherwise."""
    which = " and ".join(name for name, is_behind in zip(CAMERAS, behind, strict=True) if is_behind)
    corner = options.origin().corner
    other = next(other_corner for other_corner in CORNERS if other_corner != corner)
    return (
        f"The world's origin lies behind the {which} camera, if points are counted from the "
        f"{corner.replace('-', ' ')}. If it does not, points are counted from the "
        f"{other.replace('-', ' ')}: state that (on the command line --image-origin {other}).",
    ) * any(behind)


def _coefficients(files: Files, source: str) -> tuple[tuple[str, ...], FloatArray, str]:
    """Names of the cameras, their coefficients (cameras, 12), and the name of the file.

    A file has all cameras, or each camera its own.
    """
    fitting = [file for file in files if file.ends_with(*ENDINGS)]
    with suppress(StereocalError):  # of files that are none of the cameras
        columns = [_table(file)[1] for file in fitting]
        if len(columns) > 1 and all(len(column) == 1 for column in columns):
            names = tuple(file.name.rsplit(".", 1)[0] for file in fitting)
            return names, np.vstack(columns), source
    file = only_file(files, ENDINGS, source)
    names, table = _table(file)
    return names or tuple(f"cam{k + 1}" for k in range(len(table))), table, file.name


def _table(file: ForeignFile) -> tuple[tuple[str, ...], FloatArray]:
    """The names of cameras if the file has them, and the coefficients (cameras, 12)."""
    rows = _rows(file)
    names: list[str] = []
    if rows and not all(map(_is_number, rows[0][-1:])):
        names, *rows = rows
    labels: list[str] = []
    if all(len(row) > 1 and not _is_number(row[0]) for row in rows):
        labels, rows = [row[0] for row in rows], [row[1:] for row in rows]
    widths = {len(row) for row in rows}
    wrong = next((cell for row in rows for cell in row if not _is_number(cell)), None)
    if wrong is not None:
        raise StereocalError(f'"{wrong[:40]}" is not a number.', file.name)
    expected = (COEFFICIENTS, COEFFICIENTS + 1)
    if len(widths) != 1 or not {len(rows), *widths} & {*expected}:
        raise StereocalError(
            f"{COEFFICIENTS} rows with one column for each camera are expected; the file has "
            f"{len(rows)} rows and {max(widths, default=0)} columns.",
            file.name,
        )
    if all(WHOLE.fullmatch(cell) for row in rows for cell in row):
        raise StereocalError(
            "all its numbers are whole: with decimal commas, separate the columns by semicolons.",
            file.name,
        )
    table = np.array(rows, dtype=np.float64)
    if len(rows) in expected:
        table, labels = table.T, names[-len(table.T) :]
    if table.shape[1] == COEFFICIENTS:
        table = np.column_stack([table, np.ones(len(table))])
    return tuple(labels if len({*labels}) == len(table) else ()), table


def _rows(file: ForeignFile) -> list[list[str]]:
    """The cells between commas, semicolons, tabs or spaces; decimal commas become points."""
    lines = [line.strip() for line in file.text.splitlines()]
    lines = [line for line in lines if line and not line.startswith(("#", "%"))]
    between = next((mark for mark in ";\t," if any(mark in line for line in lines)), None)
    try:
        rows = list(csv.reader(lines, delimiter=between)) if between else map(str.split, lines)
    except csv.Error as error:
        raise StereocalError(f"this is not a CSV file ({error}).", file.name) from error
    cells = [[cell.strip(' ",') for cell in row] for row in rows]
    if cells and all(len(row) > 1 and not row[-1] for row in cells):
        cells = [row[:-1] for row in cells]
    commas = "," if between == "," else "."
    return [[cell.replace(",", commas) for cell in row] for row in cells]


def _is_number(cell: str) -> bool:
    return is_number(cell) and abs(float(cell)) <= LARGEST  # rejects NaN too


DLT = ExchangeFormat(
    "DLT coefficients (DLTdv, easyWand, Argus)",
    read_dlt,
    names=lambda file: _coefficients([file], file.name)[0],
    write=write_dlt,
    of_rigs=True,
    without_lens=True,
)
