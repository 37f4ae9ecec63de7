"""The world frame's file, `stereocal-world/1`, and plain 4x4 tables."""

from __future__ import annotations

import csv
import datetime
import json
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.field.world.frame import SOURCES, WorldFrame
from stereocal.matching.reconstruction import name_of_world
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.atomic_files import read_whole
from stereocal.system.json_text import read_json
from stereocal.version import __version__

WORLD_FORMAT = "stereocal-world/1"
CONVENTION = "x_world = R @ x_primary + t; world_from_primary = [[R, t], [0, 0, 0, 1]]; metres"
LARGEST_BYTES = 1_000_000


def write_world(frame: WorldFrame, rig: RigParameters) -> bytes:
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
        "parameters": {"method": rig.method, "inputs_sha256": rig.inputs.get("sha256")},
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
    """As `read_world`, from the content of the file; `source` is its name."""
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
