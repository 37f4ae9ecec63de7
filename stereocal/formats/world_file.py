"""The world frame's file, `stereocal-world/1`, plain 4x4 tables, and what a frame is found from.

Tables of surveyed points, lines and throws name their columns in the first line: `point`, `line` or
`frame` tells which table it is.
"""

import csv
import datetime
import json
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import DAMAGED, RefusedRowsError, StereocalError
from stereocal.field.world.frame import (
    KINDS,
    SOURCES,
    Line,
    LineKind,
    Observed,
    Survey,
    Throw,
    WorldFrame,
)
from stereocal.fit.rig_file import Parameters
from stereocal.matching.reconstruction import name_of_world
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import CameraPair
from stereocal.system.array_types import FloatArray
from stereocal.system.atomic_files import read_whole
from stereocal.system.csv_text import unquoted
from stereocal.system.json_text import read_json
from stereocal.system.names import label_of
from stereocal.system.tables import (
    Column,
    Reasons,
    Values,
    is_missing,
    names_of,
    read_rows,
    text_of,
)
from stereocal.version import __version__

WORLD_FORMAT = "stereocal-world/1"
CONVENTION = "x_world = R @ x_primary + t; world_from_primary = [[R, t], [0, 0, 0, 1]]; metres"
LARGEST_BYTES = 1_000_000
POINT, LINE, FRAME, KIND, THROW = "point", "line", "frame", "kind", "throw"
PIXELS = ("u_primary", "v_primary", "u_secondary", "v_secondary")
SURVEYED = ("x", "y", "z")
MEASURED = ("x_primary", "y_primary", "z_primary")
MOST_ROWS = 5_000
MOST_NAMES = {POINT: 200, LINE: 30, FRAME: 10}
"""Most points, lines and throws; the time of a fit grows with the square of the last two."""
FARTHEST_M = 1e8


def write_world(frame: WorldFrame, rig: Parameters) -> bytes:
    """The file of a world frame.

    Args:
        rig: the parameters it was found with.
    """
    pose = frame.pose
    content = {
        "format": WORLD_FORMAT,
        "convention": CONVENTION,
        "name": name_of_world(pose),
        "source": frame.source,
        "world_from_primary": [*np.column_stack([pose.R, pose.T]).tolist(), [0.0, 0.0, 0.0, 1.0]],
        "uncertainty": dict(frame.uncertainty),
        **frame.about,
        "sentence": frame.sentence,
        "notes": list(frame.notes),
        "parameters": rig.found_by,
        "software": {"stereocal": __version__},
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    return (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_world(path: str | Path) -> Pose:
    """`world_from_primary` of `world.json`, or of a 4x4 table: JSON (rows in brackets) or CSV.

    `x_world = R @ x_primary + t`; the last row is 0 0 0 1; metres.
    """
    return parse_world(read_whole(path, LARGEST_BYTES), str(path))


def is_json(source: str) -> bool:
    """Whether a file holds a world frame as JSON, by its name."""
    return source.lower().endswith(".json")


def parse_world(content: bytes, source: str) -> Pose:
    """`world_from_primary` from the content of a file that `read_world` reads, called `source`."""
    if len(content) > LARGEST_BYTES:
        raise StereocalError(f"{source}: the file is too large for a world frame.")
    try:
        table = _table(content, source)
    except (*DAMAGED, csv.Error) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this is not a 4x4 table of numbers.") from error
    if table.shape != (4, 4) or not np.array_equal(table[3], [0, 0, 0, 1]):
        raise StereocalError(
            f"{source}: a world frame needs a 4x4 table whose last row is 0 0 0 1 "
            "(x_world = R x_primary + t, in metres)."
        )
    try:
        return Pose(table[:3, :3], table[:3, 3])
    except StereocalError as error:
        raise StereocalError(
            f"{source}: the world frame must be a rotation and a translation: {error}"
        ) from error


def _table(content: bytes, source: str) -> FloatArray:
    if is_json(source):
        rows: Any = read_json(content, source)
        if isinstance(rows, dict):
            _check_format(rows, source)
            rows = rows["world_from_primary"]
        return np.array(rows, dtype=np.float64)
    lines = content.decode("utf-8-sig").splitlines()
    cells = [row for row in csv.reader(lines) if any(c.strip() for c in row)]
    return np.array(cells, dtype=np.float64)


def _check_format(data: dict[str, Any], source: str) -> None:
    if data.get("format") != WORLD_FORMAT:
        raise StereocalError(
            f"{source}: the format is {str(data.get('format'))[:60]!r}; this version reads "
            f'"{WORLD_FORMAT}", or a 4x4 table.'
        )
    if "world_from_primary" not in data:
        raise StereocalError(f'{source}: "world_from_primary" is missing.')
    if data.get("source") not in SOURCES:
        raise StereocalError(f'{source}: "source" must be one of {", ".join(SOURCES)}.')


def kind_of_table(content: bytes, source: str) -> str:
    """`point`, `line` or `frame`: what the rows of a table are."""
    names, *_ = names_of(text_of(content, source), source)
    for kind in (POINT, LINE, FRAME):
        if kind in names:
            return kind
    raise StereocalError(
        f"{source}: a table for a world frame has a column point (surveyed points), line (plumb "
        f"or level lines) or frame (a throw), and names {', '.join(names)[:200]}."
    )


def pair_in_table(rig: Parameters, content: bytes, source: str) -> CameraPair:
    """The two cameras whose pixels a table has: `u_left,v_left,u_right,v_right`. Of more than two
    of a rig, those that see most of its rows together."""
    cameras = [*rig.placed]
    if len(cameras) == 2:
        return cameras[0], cameras[1]
    rows = read_rows(content, source, (), ()).raw
    names = [*map(str, rows)]
    seen = [name for name in cameras if {f"u_{name}".lower(), f"v_{name}".lower()} <= {*names}]
    if len(seen) < 2:
        if {*MEASURED} <= {*names}:
            return cameras[0], cameras[1]
        raise StereocalError(
            f"{source}: the pixels of two cameras of the rig are needed, as the columns "
            f"{', '.join(f'u_{name},v_{name}' for name in cameras[:2])}; the table names "
            f"{', '.join(names)[:200]}."
        )
    has_pixel = {name: ~is_missing(rows[f"u_{name}".lower()]) for name in seen}

    def seen_by(pair: CameraPair) -> tuple[int, int]:
        first, second = (has_pixel[name] for name in pair)
        return int((first & second).sum()), int(
            min(first.sum(), second.sum())
        )  # of lines: one each

    return max(combinations(seen, 2), key=seen_by)


def read_observed(
    content: bytes, source: str, frame_rate: float | None = None, cameras: CameraPair = CAMERAS
) -> Observed:
    """Surveyed points, lines or a throw from a table; further columns are ignored.

    Args:
        frame_rate: frames per second of a throw.
        cameras: whose pixels are read, the one that serves as the primary first.
    """
    pixels = tuple(f"{axis}_{camera}".lower() for camera in cameras for axis in "uv")
    kind = kind_of_table(content, source)
    if kind == FRAME and frame_rate is None:
        raise StereocalError(
            f"{source}: a throw needs the frame rate of the cameras (frames per second; "
            "--frame-rate on the command line)."
        )
    required = {POINT: (POINT, *SURVEYED), LINE: (LINE, *pixels), FRAME: (FRAME, *pixels)}[kind]
    if max(content.count(b"\n"), content.count(b"\r")) > MOST_ROWS:
        raise StereocalError(f"{source}: at most {MOST_ROWS:,} rows are read for a world frame.")
    numbers = [
        Column(name, name not in required or name in pixels)
        for name in (*pixels, *SURVEYED, *MEASURED)
    ]
    if kind == FRAME:
        numbers.append(Column(FRAME, is_whole=True))
    rows = read_rows(content, source, required, numbers, (POINT, LINE, FRAME, KIND, THROW))
    raw, values, reasons = rows.raw, dict(rows.values), rows.reasons
    values |= {ours: values[column] for ours, column in zip(PIXELS, pixels, strict=True)}
    if rows.too_long:
        rows.check(source)
    _check_sizes(raw, kind, source)
    observed: Observed
    if kind == POINT:
        observed = _survey(raw, values, reasons, pixels)
    elif kind == LINE:
        observed = _lines(raw, values, reasons)
    else:
        observed = _throw(raw, values, reasons, frame_rate or 0.0)
    rows.check(source)
    return observed


def check_world(content: bytes, source: str, rig: Parameters) -> None:
    """Check that a file is a world frame, or a table of a rig's cameras that gives one."""
    if is_json(source):
        parse_world(content, source)
        return
    try:
        cameras = pair_in_table(rig, content, source)
        read_observed(content, source, 1.0, cameras)
    except RefusedRowsError:
        raise
    except StereocalError as error:
        try:
            parse_world(content, source)
        except StereocalError:
            raise error from None


def _check_sizes(raw: pd.DataFrame, kind: str, source: str) -> None:
    names = _names(raw, THROW if kind == FRAME else kind)
    most = MOST_NAMES[kind]
    if len(set(names)) > most:
        raise StereocalError(
            f"{source}: {len(set(names))} different names are too many; at most {most} are read of "
            f"a {'throw' if kind == FRAME else kind}."
        )


def _names(raw: pd.DataFrame, column: str) -> tuple[str, ...]:
    if column not in raw:
        return ("",) * len(raw)
    return tuple(label_of(unquoted(str(name).strip())) for name in raw[column])


def _columns(values: Values, columns: tuple[str, ...]) -> FloatArray:
    return np.column_stack([values[name] for name in columns])


def _survey(raw: pd.DataFrame, values: Values, reasons: Reasons, given: tuple[str, ...]) -> Survey:
    names = _names(raw, POINT)
    world, pixels, measured = (_columns(values, names) for names in (SURVEYED, PIXELS, MEASURED))
    has_pixels = np.asarray(np.isfinite(pixels).all(axis=1))
    has_point = np.asarray(np.isfinite(measured).all(axis=1))
    first: dict[str, int] = {}
    for row, name in enumerate(names):
        if not name:
            reasons.setdefault(row, "the point has no name")
        elif not (has_pixels[row] or has_point[row]):
            reasons.setdefault(
                row, f"{', '.join(given)} are not all given, nor {', '.join(MEASURED)}"
            )
        elif np.abs(world[row]).max() > FARTHEST_M:
            reasons.setdefault(row, "the point is too far away; coordinates are in metres")
        elif not np.array_equal(world[first.setdefault(name, row)], world[row], equal_nan=True):
            reasons.setdefault(row, f"{name} has other coordinates in an earlier row")
    measured[~has_point] = np.nan
    return Survey(names, world, pixels, measured)


def _lines(raw: pd.DataFrame, values: Values, reasons: Reasons) -> tuple[Line, ...]:
    names, pixels = _names(raw, LINE), _columns(values, PIXELS)
    kinds = [kind.lower() or KINDS[0] for kind in _names(raw, KIND)]
    known = [np.isfinite(pixels[:, :2]), np.isfinite(pixels[:, 2:])]
    kind_of: dict[str, LineKind] = {}
    for row, (name, text) in enumerate(zip(names, kinds, strict=True)):
        kind = next((line_kind for line_kind in KINDS if line_kind == text), None)
        if not name:
            reasons.setdefault(row, "the line has no name")
        elif kind is None:
            reasons.setdefault(row, f'kind is "{text[:40]}"; it must be {", ".join(KINDS)}')
        elif kind_of.setdefault(name, kind) != kind:
            reasons.setdefault(row, f"{name} is a {kind_of[name]} line in an earlier row")
        elif any(is_known[row].any() != is_known[row].all() for is_known in known):
            reasons.setdefault(row, "one of u and v is empty")
    seen, lines = [is_known.all(axis=1) for is_known in known], []
    for name, kind in kind_of.items():
        rows = np.array(names) == name
        lines.append(Line(name, kind, (pixels[rows & seen[0], :2], pixels[rows & seen[1], 2:])))
    return tuple(lines)


def _throw(raw: pd.DataFrame, values: Values, reasons: Reasons, frame_rate: float) -> Throw:
    pixels = _columns(values, PIXELS)
    is_usable = np.asarray(np.isfinite(pixels).all(axis=1))
    is_usable[list(reasons)] = False
    if not is_usable.any() and not reasons:
        reasons[0] = "no frame has the point of both cameras"
    tracks = np.array(_names(raw, THROW), dtype=object)[is_usable]
    frames = values[FRAME][is_usable].astype(np.int64)
    return Throw(tuple(tracks.tolist()), frames, pixels[is_usable], frame_rate)
