"""A recording of all cameras, from their files and one table of points."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import Part, lens_taken, with_background
from stereocal.formats.archives.easywand import LENS_FIELDS
from stereocal.formats.archives.gather import (
    counted_as,
    is_table,
    layout_of_bars,
    names_in,
    sorted_files,
    with_one_table,
)
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.exchange.chosen_cameras import namesakes
from stereocal.formats.exchange.exchange import camera_names, read_camera_pair
from stereocal.formats.exchange.options import LOWER_LEFT, Contents, ExchangeOptions
from stereocal.formats.point_files import read_bars
from stereocal.formats.point_layouts import first_rows
from stereocal.formats.points_csv import NUMBERS, REQUIRED, read_points_csv
from stereocal.matching.point_table import OWN_FRAME
from stereocal.rig.camera import Camera, camera_in_words
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.measured_lengths import check_length
from stereocal.rig.recording import NO_POINTS, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.csv_text import as_names
from stereocal.system.tables import EMPTY, names_of, read_rows, text_of

ENDS = ("A", "B")
MOST_TARGETS = 6
"""On a bar, whose places along it are asked for."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """The recording, and what was taken from where."""

    recording: Recording
    taken: tuple[Part, ...]
    remarks: tuple[str, ...]
    is_long: bool = False
    """Whether a row has points of one camera: its frames may be that camera's own count."""

    @cached_property
    def files(self) -> dict[str, bytes]:
        return pack_recording(self.recording)


def gather_all(
    files: Contents, options: ExchangeOptions, name: str, lengths: Mapping[str, float]
) -> Gathered:
    """The recording of all cameras; baselines are free.

    Cameras of a table of format 2 have its names, others their numbers.

    Args:
        files: one of every camera, or one of each in the order of the table, and the table.
        lengths: by target, its distance from the first along a straight bar, in metres. Other
            targets are not used; of another program's bar it may be missing if the files have it.
    """
    files, options = with_one_table(files, options)
    tables = [name for name, content in files.items() if is_table(name, content)]
    if len(tables) == 1 and names_cameras(files[tables[0]], tables[0]):
        return _of_points(files, tables[0], options, name, lengths)
    return _of_bars(files, options, name, lengths.get("B"))


def _of_bars(
    files: Contents, options: ExchangeOptions, name: str, distance_m: float | None
) -> Gathered:
    """The recording of another program's files."""
    table, others, opened = sorted_files(files)
    size = options.image_sizes[0]
    if opened is not None:
        every, origin = range(len(opened.cameras)), options.origin(LOWER_LEFT)
        sizes = opened.image_sizes(every, [size] * len(every))
        cameras = [opened.camera(k, size, origin) for k, size in enumerate(sizes)]
    else:
        cameras = [*cameras_in(others, options).values()]
    if (count := len(cameras)) < 3:
        raise StereocalError(
            "Files of three cameras or more are expected; these name "
            f"{count or 'none'}: give those of the others too.",
            option="--cameras 1,2 for two",
        )
    remarks: tuple[str, ...] = ()
    own_frames = is_long = False
    if opened is not None:
        bars, background = opened.seen_bars(every, sizes, origin)
        if background is not None and len(bars.frame):
            bars, _ = with_background(bars, background)
        distance_m = opened.bar_length(options.unit) if distance_m is None else distance_m
    elif not table:
        raise StereocalError("Table of points missing, give the CSV of the bar's ends.")
    else:
        layout, ends, remarks = layout_of_bars(files[table], table, options)
        if len(layout.cameras) != count:
            raise StereocalError(
                f"The table has the points of {len(layout.cameras)} cameras, and the camera files "
                f"name {count}: give both for the same cameras.",
                option="--cameras 1,2 for two of them",
            )
        if layout.states_cameras and (same := namesakes(layout.cameras, names_in(others))):
            cameras = [cameras[k] for k in same]
        heights = [(size or camera.image_size)[1] for camera in cameras]
        layout, own_frames = counted_as(layout, table, options)
        bars = read_bars(files[table], layout, layout.cameras, ends, heights, table)
        bars = bars if own_frames else bars.seen_by_two()
        is_long = layout.camera_column is not None
    if distance_m is None:
        raise StereocalError(
            "The distance from A to B is missing: state it in metres.", option="--distance D"
        )
    check_length("distance between the targets", distance_m)
    lenses = {str(k): lens for k, lens in enumerate(cameras, 1)}
    empty = Recording(name, lenses, RigidObject.bar(distance_m), *NO_POINTS, own_frames=own_frames)
    seen, recording = bars.seen, bars.put_into(empty)
    remarks += tuple(filter(None, [beyond_in_words(recording.beyond_view)]))
    if unseen := [camera for k, camera in enumerate(recording.cameras) if not seen[:, k].any()]:
        raise StereocalError(
            f"Camera {unseen[0]} sees no end of the bar that another camera sees: use two of the "
            "others only."
        )
    pairs = [] if own_frames else recording.pairs
    apart = (pair for pair in pairs if not len(recording.common_frames(*pair)))
    remarks += tuple(f"Cameras {a} and {b}: no end of the bar was seen by both." for a, b in apart)
    taken = [Part("points", f"{seen.sum()} of {count} cameras", ", ".join(files))]
    origin_of = LENS_FIELDS if opened is not None else ", ".join(others)
    taken += [lens_taken(f"camera {k}", lens, origin_of) for k, lens in recording.cameras.items()]
    return Gathered(recording, tuple(taken), remarks, is_long)


def targets_in(content: bytes, source: str) -> tuple[str, ...]:
    """The targets of a table of format 2, sorted; `ENDS` for one of another program."""
    if not names_cameras(content, source):
        return ENDS
    targets = tuple(sorted({*_column(content, source, "target")}))
    if len(targets) > MOST_TARGETS:
        raise StereocalError(
            f"{source}: it has {len(targets)} targets. Say where they are on the object in a "
            "dataset.json, and give it with the other files."
        )
    return targets


def names_cameras(content: bytes, source: str) -> bool:
    """Whether a file is a table of format 2, which names the camera of each row."""
    try:
        head, _ = first_rows(content, source)
    except StereocalError:
        return False
    names = {cell.strip().lower() for cell in head[0]}
    return {*REQUIRED[1:]} <= names and bool({REQUIRED[0], OWN_FRAME} & names)


def _of_points(
    files: Contents, table: str, options: ExchangeOptions, name: str, lengths: Mapping[str, float]
) -> Gathered:
    """The recording of a table of format 2."""
    first, *others = targets = targets_in(files[table], table)
    if not {*others} & {*lengths}:
        raise StereocalError(
            f"{table}: the distance from {first} to {(*others, 'another target')[0]} is missing: "
            "state it in metres."
        )
    rest = {file: content for file, content in files.items() if file != table}
    cameras = _named_as(cameras_in(rest, options), _column(files[table], table, "camera"), table)
    # Those without a length are read too, so that their rows are no errors.
    along = np.array([lengths.get(target, -1.0 - k) for k, target in enumerate(targets)])
    along[0] = 0.0
    check_length(f"longest distance from {first}", float(along.max()))
    every_target = RigidObject(targets, np.column_stack([along, np.zeros((len(along), 2))]))
    content = files[table]
    stated = {*names_of(text_of(content, table), table)[0]}
    as_counted = options.frames == "own" or REQUIRED[0] not in stated
    every_row = read_points_csv(content, cameras, every_target, table, own_frames=as_counted)
    used = np.flatnonzero(along >= 0.0)
    rows = np.isin(every_row.target, used)
    recording = replace(
        every_row.where(rows),
        name=name,
        object=RigidObject(tuple(targets[k] for k in used), every_target.points[used]),
        target=np.searchsorted(used, every_row.target[rows]),
        own_frames=as_counted and options.frames != "common",
    )
    taken = [Part("points", f"{rows.sum()} of {len(cameras)} cameras", table)]
    taken += [Part("lens", f"of camera {camera}", ", ".join(rest)) for camera in cameras]
    remarks = [
        f"{camera_in_words(camera, begins=True)} has no points in {table}."
        for number, camera in enumerate(cameras)
        if number not in recording.camera
    ]
    remarks += [
        f"The target {target} has no length, and is not used."
        for target in targets
        if target not in recording.object.names
    ]
    return Gathered(recording, tuple(taken), tuple(remarks), True)


def _column(content: bytes, source: str, name: str) -> list[str]:
    """The values of a column of a table of format 2, in the order of their first rows."""
    raw = read_rows(content, source, REQUIRED[1:], NUMBERS, (), EMPTY).raw[name]
    return [str(cell) for cell in as_names(raw).unique()]


def cameras_in(files: Contents, options: ExchangeOptions) -> dict[str, Camera]:
    """The cameras by the name in a file of several, or of the file of one."""
    cameras: dict[str, Camera] = {}
    for name, content in files.items():
        names = camera_names(name, content)
        of_file = {PurePath(name).stem: None} if len(names) < 2 else dict.fromkeys(names)
        for number, camera in enumerate(of_file):
            if camera in cameras:
                raise StereocalError(f"{name}: there is a camera {camera} already.")
            chosen = None if len(names) < 2 else (int(number == 0), number)
            pair = read_camera_pair({name: content}, replace(options, cameras=chosen))
            cameras[camera] = pair.secondary
    return cameras


def _named_as(
    cameras: Mapping[str, Camera], wanted: Iterable[str], source: str
) -> dict[str, Camera]:
    """The cameras by their names in a table, in their own order."""
    names, name_by_camera = [*cameras], dict[int, str]()
    for name in wanted:
        same = namesakes([name], names)
        if not same:
            raise StereocalError(
                f"{source}: it has points of a camera {name[:40]}, and no camera file is named so "
                f"(there are {', '.join(cameras)[:200] or 'none'}): give {name[:40]}.json, or name "
                "its file so."
            )
        name_by_camera[same[0]] = name
    return {name_by_camera.get(k, name): cameras[name] for k, name in enumerate(names)}
