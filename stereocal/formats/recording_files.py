"""`dataset.json`; and a data set of format 2: any cameras, any rigid object, `points.csv`."""

import difflib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError, naming
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import codes_of
from stereocal.matching.point_table import OWN_FRAME
from stereocal.network.frame_rates import RATES, at_stated_rates
from stereocal.network.started_by_hand import bring_into_step
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.dataset import check_length, check_uncertainty
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.array_types import IntArray
from stereocal.system.csv_text import as_names, csv_text
from stereocal.system.json_text import read_json
from stereocal.system.names import check_camera_names, label_of
from stereocal.system.records import of_plain, plain, settings_of
from stereocal.system.tables import EMPTY, Column, Rows, names_of, read_rows, text_of

DATASET_FORMAT = "stereocal-dataset/1"
"""Two cameras and a bar, with `correspondences.csv`."""
RECORDING_FORMAT = "stereocal-dataset/2"
"""Any cameras and any rigid object, with `points.csv`."""
DESCRIPTION = "dataset.json"
HOW_MADE = (
    " Of a table of points and camera files `python -m stereocal import` makes one; the Data page "
    "takes photographs and such files as they are."
)
LARGEST_DESCRIPTION = 4_000_000
POINTS = "points.csv"
REQUIRED = ("frame", "camera", "target", "u", "v")
SIGMA = "sigma_px"
STARTS = "start_frames"
"""The entry that says which frame was 0 of each camera that counted its own."""
ENTRIES = (
    *("format", "name", "notes", "cameras", "points", "frames", STARTS, RATES, "object"),
    *("baseline_m", "baselines_m", "baseline_sigma_m"),
    *("target_distance_m", "target_distance_sigma_m", "object_sigma_m"),
)
"""Those of `dataset.json`; others that look like one of these are taken for slips of the pen."""
ALIKE = 0.85
NUMBERS = (
    Column("frame", is_whole=True),
    Column(OWN_FRAME, is_whole=True),
    Column("u"),
    Column("v"),
    Column(SIGMA, may_be_empty=True, is_positive=True),
)
BOARD = "board"


@dataclass(frozen=True)
class Description:
    """The `dataset.json` among files by name."""

    files: Mapping[str, bytes]
    source: str
    folder: str
    """The folder of the file, with its slash, or empty."""
    entries: Mapping[str, Any]

    @property
    def where(self) -> str:
        """What errors begin with."""
        return f"{self.source}: {DESCRIPTION}"

    @property
    def is_recording(self) -> bool:
        """Whether it is of format 2."""
        return bool(self.entries["format"] == RECORDING_FORMAT)

    @property
    def name(self) -> str:
        """The name of the data set, as it can be displayed."""
        return label_of(str(self.entries.get("name") or Path(self.source).stem))

    @property
    def counts_own_frames(self) -> bool:
        """Whether each camera counts its own frames, as cameras that were started by hand."""
        given = self.entries.get("frames", "common")
        if given not in ("own", "common"):
            raise StereocalError(f'{self.where}: "frames" must be "own" or "common".')
        return bool(given == "own")

    @property
    def notes(self) -> str:
        return str(self.entries.get("notes", ""))

    def cameras(self, lens_model: LensModel | None) -> dict[str, Camera]:
        """The cameras of the files that it names: primary and secondary in format 1."""
        named = self.entries.get("cameras")
        wanted = () if self.is_recording else CAMERAS
        if not isinstance(named, dict) or len(named) < 2 or not set(wanted) <= named.keys():
            which = "two cameras at least" if self.is_recording else "the primary and the secondary"
            raise StereocalError(f'{self.where}: "cameras" must name the files of {which}.')
        with naming(self.where):
            check_camera_names(wanted or named)
        found = {}
        for which in wanted or named:
            name = named[which]
            if not isinstance(name, str) or self.folder + name not in self.files:
                raise StereocalError(
                    f"{self.source}: the {which}'s camera file {name!r} is missing."
                )
            content, source = self.files[self.folder + name], f"{self.source}: {name}"
            found[which] = read_camera(content, source, lens_model)
        return found

    def length(self, key: str) -> float:
        """An entry in metres that must be there."""
        value = self.optional_length(key)
        if value is None:
            raise StereocalError(f"{self.where}: {key} is missing.")
        return value

    def optional_length(self, key: str, of: Mapping[str, Any] | None = None) -> float | None:
        """An entry in metres; None if there is none. Its value is not checked here."""
        value = (self.entries if of is None else of).get(key)
        try:
            return of_plain(value, float | None)  # type: ignore[arg-type]
        except ValueError as error:
            raise StereocalError(
                f"{self.where}: {key} is {str(value)[:60]!r}; it must be a number, in metres."
            ) from error


def find_description(files: Mapping[str, bytes], source: str) -> Description:
    """The only `dataset.json` among files, which may all be in one subfolder."""
    found = [
        name
        for name in files
        if PurePosixPath(name).name == DESCRIPTION and not name.startswith("__MACOSX/")
    ]
    if not found:
        zips = [name for name in files if name.lower().endswith(".zip")]
        inside = f" It holds the zip {zips[0][:60]}: unpack that, and give it." if zips else ""
        raise StereocalError(
            f"there is no {DESCRIPTION} in it, which names the cameras and their lengths."
            f"{inside or HOW_MADE}",
            source,
        )
    if len(found) > 1:
        raise StereocalError(
            f"{source}: it contains {len(found)} data sets ({', '.join(sorted(found)[:3])}); "
            "use one at a time."
        )
    content = files[found[0]]
    if len(content) > LARGEST_DESCRIPTION:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a {DESCRIPTION}.")
    entries = read_json(content, f"{source}: {DESCRIPTION}")
    known = (DATASET_FORMAT, RECORDING_FORMAT)
    if not isinstance(entries, dict) or entries.get("format") not in known:
        raise StereocalError(
            f'{source}: {DESCRIPTION} must be an object with "format": "{DATASET_FORMAT}", or '
            f'"{RECORDING_FORMAT}".'
        )
    for entry in entries.keys() - {*ENTRIES}:
        if meant := difflib.get_close_matches(str(entry), ENTRIES, 1, ALIKE):
            raise StereocalError(
                f'{source}: {DESCRIPTION}: "{entry[:60]}" is not known: write "{meant[0]}".'
            )
    return Description(files, source, found[0][: -len(DESCRIPTION)], entries)


def parse_recording(
    files: Mapping[str, bytes],
    source: str,
    photographs: bool = False,
    lens_model: LensModel | None = None,
    with_points: bool = True,
    pair: str | None = None,
) -> Recording:
    """The recording from files by name, which may all be in one subfolder.

    Args:
        photographs: whether there are photographs too, in which targets can be detected.
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
        with_points: whether to read its points; else it has none.
        pair: the only cameras to bring into step, such as `left-right`, and to keep; None: all.
    """
    found = find_description(files, source)
    if not found.is_recording:
        raise StereocalError(f'{found.where}: its "format" must be "{RECORDING_FORMAT}".')
    cameras, rigid_object = found.cameras(lens_model), _object(found)
    if not with_points:
        none = np.empty(0, dtype=np.int64)
        recording = Recording(
            "", cameras, rigid_object, none, none, none, np.empty((0, 2)), np.empty(0)
        )
    else:
        recording = _points(found, cameras, rigid_object, photographs)
    recording = replace(
        recording,
        name=found.name,
        baselines_m=_baselines(found, cameras),
        baseline_sigma_m=found.optional_length("baseline_sigma_m"),
        notes=found.notes,
    )
    if not found.counts_own_frames and found.entries.get(RATES) is not None:
        raise StereocalError(f'{found.where}: "{RATES}" is for cameras with "frames": "own".')
    if with_points and found.counts_own_frames:
        recording = _in_own_frames(found, recording, pair)
        if not recording.start_frames:
            with naming(found.source):
                return bring_into_step(recording).recording
    return recording


def _points(
    found: Description, cameras: Mapping[str, Camera], rigid_object: RigidObject, photographs: bool
) -> Recording:
    """The points of one table, or of a table for each camera."""
    tables = found.entries.get("points", POINTS)
    by_camera = dict(tables) if isinstance(tables, dict) else {None: tables}
    if by_camera.keys() not in ({None}, cameras.keys()):
        raise StereocalError(f'{found.where}: "points" must name a table for each of the cameras.')
    parts = []
    for camera, name in by_camera.items():
        content = found.files.get(f"{found.folder}{name}")
        if content is None:
            how = "; find the targets first, with `stereocal detect`" if photographs else ""
            raise StereocalError(
                f"{found.source}: the table of points {str(name)[:60]!r} is missing{how}."
            )
        about = f"{found.source}: {name}"
        parts.append(
            read_points_csv(content, cameras, rigid_object, about, camera, found.counts_own_frames)
        )
    rows = ("frame", "camera", "target", "points", "sigma_px")
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in rows
    }
    beyond = {name: sum(part.beyond_view.get(name, 0) for part in parts) for name in cameras}
    return replace(parts[0], **columns, beyond_view=beyond if any(beyond.values()) else {})


def _in_own_frames(found: Description, recording: Recording, pair: str | None) -> Recording:
    """The recording in frames of one rate; in step if the starts of its cameras are stated."""
    with naming(found.source):
        recording = at_stated_rates(recording, found.entries.get(RATES))
        known = dict[str, int]()
        if (starts := found.entries.get(STARTS)) is not None:
            with suppress(ValueError):
                known = of_plain(starts, dict[str, int])
            if known.keys() != recording.cameras.keys():
                raise StereocalError(f'"{STARTS}" must give a whole number of each camera.')
        recording = replace(recording.counted_from(known), start_frames=known)
        return recording.of_cameras(recording.pair_named(pair)) if pair else recording


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
        longest = found.longest_m
        check_length("longest distance between points of the object", longest)
        check_uncertainty("object", sigma, longest)
        return found


def _baselines(description: Description, cameras: Iterable[str]) -> dict[CameraPair, float]:
    """The measured baselines by pair of cameras."""
    where, given = description.where, description.entries.get("baselines_m") or {}
    if not isinstance(given, dict):
        raise StereocalError(f'{where}: "baselines_m" must give lengths by pair of cameras.')
    pairs = {f"{a}-{b}": (a, b) for a, b in permutations(cameras, 2)}
    found: dict[CameraPair, float] = {}
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


def read_points_csv(
    content: bytes,
    cameras: Mapping[str, Camera],
    rigid_object: RigidObject,
    source: str,
    of_camera: str | None = None,
    own_frames: bool = False,
) -> Recording:
    """The recording of a table of points, without name and baselines.

    Args:
        of_camera: the camera of all rows, if the table has no such column.
        own_frames: take the column `camera_frame`, if there is one, instead of `frame`.
    """
    names, _ = names_of(text_of(content, source), source)
    number = OWN_FRAME if own_frames and OWN_FRAME in names else "frame"
    needed = [name for name in REQUIRED if of_camera is None or name != "camera"]
    needed[0] = number
    rows = read_rows(content, source, needed, NUMBERS, (), EMPTY)
    rows.values["frame"] = rows.values[number]
    if of_camera is not None:
        rows.raw["camera"] = of_camera
    codes: dict[str, IntArray] = {}
    for column, names in (("camera", list(cameras)), ("target", list(rigid_object.names))):
        words = as_names(rows.raw[column])
        allowed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        known = {name: i for i, name in enumerate(names)}
        codes[column] = codes_of(words, known, allowed, words, rows.reasons)
    points = np.column_stack([rows.values["u"], rows.values["v"]])
    _refuse_twice(rows, codes["camera"], codes["target"])
    for code, camera in enumerate(cameras.values()):
        its_rows = np.flatnonzero(codes["camera"] == code)
        for at, what in camera.outside(points[its_rows]):
            row = int(its_rows[at])
            rows.reasons.setdefault(row, f"{_at(rows, row)}: the {what}")
    rows.check(source)
    seen = rows.values["frame"].astype(np.int64), codes["camera"], codes["target"], points
    recording = Recording("", dict(cameras), rigid_object, *seen, rows.values[SIGMA])
    with naming(source):
        return recording.within_view()


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
    if recording.baseline_sigma_m == np.inf:  # the file states what was measured
        recording = replace(recording, baselines_m={}, baseline_sigma_m=None)
    rigid_object, board = recording.object, recording.object.board
    names = {which: f"camera_{i + 1}.json" for i, which in enumerate(recording.cameras)}
    described: Any = dict(zip(rigid_object.names, rigid_object.points.tolist(), strict=True))
    if board is not None:
        described = {BOARD: {k: v for k, v in plain(board).items() if v is not None}}
    description = {
        "format": RECORDING_FORMAT,
        "name": recording.name,
        "cameras": names,
        "object": described,
        "object_sigma_m": rigid_object.sigma_m,
        "baselines_m": {f"{a}-{b}": m for (a, b), m in recording.baselines_m.items()} or None,
        "baseline_sigma_m": recording.baseline_sigma_m,
        "notes": recording.notes or None,
        "frames": "own" if recording.start_frames else None,
        STARTS: dict(recording.start_frames) or None,
    }
    kept = {key: value for key, value in description.items() if value is not None}
    return {
        DESCRIPTION: (json.dumps(kept, indent=2) + "\n").encode(),
        **{names[which]: write_camera(camera) for which, camera in recording.cameras.items()},
        POINTS: write_points(recording),
    }


def write_points(recording: Recording) -> bytes:
    """`points.csv`, read back exactly by `read_points_csv`."""
    table = recording.to_dataframe()
    if recording.start_frames:
        starts = np.array([recording.start_frames[name] for name in recording.cameras])
        table.insert(1, OWN_FRAME, recording.frame - starts[recording.camera])
    return csv_text(table).encode()
