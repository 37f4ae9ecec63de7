"""A data set of format 2: any number of cameras, any rigid object, and `points.csv`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import RefusedRowsError, StereocalError, naming
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import codes_of
from stereocal.formats.description import (
    DESCRIPTION,
    RECORDING_FORMAT,
    Description,
    find_description,
)
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import Camera, LensModel
from stereocal.rig.compiled import IntArray
from stereocal.rig.dataset import check_length, check_uncertainty
from stereocal.rig.recording import Pair, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.limits import Limits
from stereocal.system.records import of_plain, plain, settings_of
from stereocal.system.tables import EMPTY, Column, Rows, read_rows

POINTS = "points.csv"
REQUIRED = ("frame", "camera", "target", "u", "v")
SIGMA = "sigma_px"
NUMBERS = (
    Column("frame", is_whole=True),
    Column("u"),
    Column("v"),
    Column(SIGMA, may_be_empty=True, is_positive=True),
)
BOARD = "board"


def parse_recording(
    files: Mapping[str, bytes],
    source: str,
    photographs: bool = False,
    lens_model: LensModel | None = None,
    with_points: bool = True,
) -> Recording:
    """The recording from files by name, which may all be in one subfolder.

    Args:
        photographs: whether there are photographs too, in which targets can be detected.
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
        with_points: whether to read its points; else it has none.
    """
    found = find_description(files, source)
    if not found.is_recording:
        raise StereocalError(f'{found.where}: its "format" must be "{RECORDING_FORMAT}".')
    cameras, own = found.cameras(lens_model), _object(found)
    if not with_points:
        none = np.empty(0, dtype=np.int64)
        recording = Recording("", cameras, own, none, none, none, np.empty((0, 2)), np.empty(0))
    elif found.folder + POINTS not in files:
        how = "; find the targets first, with `stereocal detect`" if photographs else ""
        raise StereocalError(f"{source}: the table of points {POINTS!r} is missing{how}.")
    else:
        recording = read_points(files[found.folder + POINTS], cameras, own, f"{source}: {POINTS}")
    return replace(
        recording,
        name=found.name,
        baselines_m=_baselines(found, cameras),
        baseline_sigma_m=found.optional_length("baseline_sigma_m"),
        notes=found.notes,
    )


def _object(description: Description) -> RigidObject:
    """The object that `dataset.json` describes: points by name, or a board."""
    given = description.entries.get("object")
    sigma = description.optional_length("object_sigma_m")
    with naming(description.where):
        if not isinstance(given, dict) or not given:
            raise StereocalError(
                '"object" must give the points of the object in metres, as {"A": [0, 0, 0], "B": '
                '[0.39, 0, 0]}, or a board: {"board": {"columns": 9, "rows": 6, "square_m": 0.03}}.'
            )
        if BOARD in given:
            found = RigidObject.of_board(settings_of(given[BOARD], BoardPattern, "board"), sigma)
        else:
            points = []
            for name, xyz in given.items():
                try:
                    points.append(of_plain(xyz, tuple[float, float, float]))
                except ValueError as error:
                    raise StereocalError(
                        f"the point {name[:40]!r} must be three numbers, in metres."
                    ) from error
            found = RigidObject(tuple(given), np.array(points), sigma)
        longest = float(found.distances.max())
        check_length("longest distance between points of the object", longest)
        check_uncertainty("object", sigma, longest)
        return found


def _baselines(description: Description, cameras: Iterable[str]) -> dict[Pair, float]:
    """The measured baselines by pair of cameras."""
    where, given = description.where, description.entries.get("baselines_m") or {}
    if not isinstance(given, dict):
        raise StereocalError(f'{where}: "baselines_m" must give lengths by pair of cameras.')
    pairs = {f"{a}-{b}": (a, b) for a, b in permutations(cameras, 2)}
    found: dict[Pair, float] = {}
    for key in given:
        value = description.optional_length(key, given)
        if key not in pairs:
            raise StereocalError(
                f"{where}: the baseline {key[:60]!r} is of no pair of cameras: {', '.join(pairs)}."
            )
        if value is not None:
            with naming(where):
                check_length(f"baseline {key}", value)
            if pairs[key][::-1] in found:
                raise StereocalError(f"{where}: the baseline {key} is stated twice.")
            found[pairs[key]] = value
    return found


def read_points(
    content: bytes, cameras: Mapping[str, Camera], own: RigidObject, source: str
) -> Recording:
    """The recording of a table of points, without name and baselines."""
    lines = max(content.count(b"\n"), content.count(b"\r"))
    Limits.from_environment().check_pairs(lines - 1, source)
    rows = read_rows(content, source, REQUIRED, NUMBERS, (), EMPTY)
    codes: dict[str, IntArray] = {}
    for column, names in (("camera", list(cameras)), ("target", list(own.names))):
        words = rows.raw[column].str.strip()
        allowed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        known = {name: i for i, name in enumerate(names)}
        codes[column] = codes_of(words, known, allowed, words, rows.reasons)
    points = np.column_stack([rows.values["u"], rows.values["v"]])
    _refuse_twice(rows, codes["camera"], codes["target"])
    # An image ends 0.5 px beyond the outermost pixel centres.
    sizes = np.array([camera.image_size for camera in cameras.values()])[codes["camera"]]
    for row in np.flatnonzero(((points < -0.5) | (points > sizes - 0.5)).any(axis=1)).tolist():
        (u, v), (width, height) = points[row], sizes[row]
        rows.reasons.setdefault(
            row,
            f"{_at(rows, row)}: the point ({u:g}, {v:g}) is outside the {width}x{height} px image",
        )
    if rows.problems:
        raise RefusedRowsError(f"{source}: ", rows.problems, "cannot be used")
    return Recording(
        name="",
        cameras=dict(cameras),
        object=own,
        frame=rows.values["frame"].astype(np.int64),
        camera=codes["camera"],
        target=codes["target"],
        points=points,
        sigma_px=rows.values[SIGMA],
    )


def _at(rows: Rows, row: int) -> str:
    camera, target = (rows.raw[name].iloc[row].strip() for name in ("camera", "target"))
    return f"frame {rows.values['frame'][row]:.0f}, camera {camera}, target {target}"


def _refuse_twice(rows: Rows, camera: IntArray, target: IntArray) -> None:
    """Add the valid rows with a point that the table has already."""
    keys = pd.DataFrame({"frame": rows.values["frame"], "camera": camera, "target": target})
    keys = keys.drop(index=list(rows.reasons))
    lines = pd.Series(rows.raw.index.to_numpy(), index=range(len(rows.raw)))
    first = lines[keys.index].groupby([keys[name] for name in keys]).transform("first")
    for row in keys.index[keys.duplicated()].tolist():
        rows.reasons[row] = f"{_at(rows, row)} is in line {first[row]} already"


def pack_recording(recording: Recording) -> dict[str, bytes]:
    """The files of a recording by name, read back exactly by `parse_recording`."""
    own, board = recording.object, recording.object.board
    names = {which: f"camera_{i + 1}.json" for i, which in enumerate(recording.cameras)}
    described: Any = dict(zip(own.names, own.points.tolist(), strict=True))
    if board is not None:
        described = {BOARD: {k: v for k, v in plain(board).items() if v is not None}}
    description = {
        "format": RECORDING_FORMAT,
        "name": recording.name,
        "cameras": names,
        "object": described,
        "object_sigma_m": own.sigma_m,
        "baselines_m": {f"{a}-{b}": m for (a, b), m in recording.baselines_m.items()} or None,
        "baseline_sigma_m": recording.baseline_sigma_m,
        "notes": recording.notes or None,
    }
    kept = {key: value for key, value in description.items() if value is not None}
    return {
        DESCRIPTION: (json.dumps(kept, indent=2) + "\n").encode(),
        **{names[which]: write_camera(camera) for which, camera in recording.cameras.items()},
        POINTS: write_points(recording),
    }


def write_points(recording: Recording) -> bytes:
    """`points.csv`, read back exactly by `read_points`."""
    named = np.array([*recording.cameras])[recording.camera]
    targets = np.array(recording.object.names)[recording.target]
    table = pd.DataFrame({"frame": recording.frame, "camera": named, "target": targets})
    table[["u", "v"]] = recording.points
    if np.isfinite(recording.sigma_px).any():
        table[SIGMA] = recording.sigma_px
    return table.to_csv(index=False, lineterminator="\n").encode()
