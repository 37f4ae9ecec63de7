"""A recording of all cameras, from their files and one table of points."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, repeat
from pathlib import PurePath

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import Taken
from stereocal.formats.archives.easywand import open_easywand
from stereocal.formats.archives.gather import TABLES, gather
from stereocal.formats.exchange.exchange import READ, camera_names, format_of, read_camera_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.other_files import is_matlab
from stereocal.formats.point_layouts import first_rows
from stereocal.formats.recording_files import NUMBERS, REQUIRED, read_points
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import check_length
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.tables import EMPTY, read_rows

ENDS = ("A", "B")
MOST_TARGETS = 6
"""On a bar, whose places along it are asked for."""
_PREFIX = re.compile(r"(?i)(cam(era)?)?[\s_.-]*0*(?=.)")
"""Before the number of a camera: `camera_1` and `cam1` are the same."""


@dataclass(frozen=True, eq=False)
class EveryCamera:
    """The recording, and what was taken from where."""

    recording: Recording
    taken: tuple[Taken, ...]
    remarks: tuple[str, ...]


def gather_all(
    files: Mapping[str, bytes], options: ExchangeOptions, name: str, lengths: Mapping[str, float]
) -> EveryCamera:
    """The recording of all cameras; baselines are free.

    Cameras of a table of format 2 have its names, others their numbers.

    Args:
        files: one of every camera, or one of each in the order of the table, and the table.
        lengths: by target, its distance from the first along a straight bar, in metres. Other
            targets are not used; of another program's bar it may be missing if the files have it.
    """
    tables = [each for each in files if each.lower().endswith(TABLES)]
    if len(tables) == 1 and _is_of_points(files[tables[0]], tables[0]):
        return _of_points(files, tables[0], options, name, lengths)
    return _of_pairs(files, tables, options, name, lengths.get("B"))


def _of_pairs(
    files: Mapping[str, bytes],
    tables: Sequence[str],
    options: ExchangeOptions,
    name: str,
    distance_m: float | None,
) -> EveryCamera:
    """The recording of another program's files, by reading every pair of their cameras."""
    single = {each: content for each, content in files.items() if _is_single(each, content)}
    count = max(_count(files), len(single))
    if count < 3:
        raise StereocalError(
            "--cameras all is for files of three cameras or more; these name "
            f"{count or 'none'}: give --cameras 1,2."
        )
    cameras: dict[str, Camera] = {}
    images: dict[tuple[int, int, int], FloatArray] = {}
    taken: dict[str, Taken] = {}
    remarks: dict[str, None] = {}
    failed: list[str] = []
    numbers = [str(number + 1) for number in range(count)]
    for pair in combinations(range(count), 2):
        chosen = numbers[pair[0]], numbers[pair[1]]
        own = files
        if single:  # of which a pair is read at a time
            two = [[*single][number] for number in pair]
            own = {each: files[each] for each in (*tables, *two)}
        try:
            found = gather(own, replace(options, cameras=chosen), baseline_known=True)
        except StereocalError as error:  # as of two cameras that see nothing together
            failed.append(f"Cameras {' and '.join(chosen)}: {error}")
            continue
        distance_m = found.target_distance_m if distance_m is None else distance_m
        if found.primary is None or found.secondary is None or found.correspondences is None:
            lines = found.missing(1.0, distance_m or 1.0)
            text = "; ".join(f"{each.what} missing, {each.origin}" for each in lines)
            raise StereocalError(f"{text[0].upper()}{text[1:]}.")
        cameras |= {chosen[0]: found.primary, chosen[1]: found.secondary}
        rows = found.correspondences
        times, targets = rows.time_frame.tolist(), rows.target.tolist()
        for which, pixels in zip(pair, (rows.primary, rows.secondary), strict=True):
            rows_of_camera = zip(times, repeat(which), targets, strict=False)
            known = dict(zip(rows_of_camera, pixels, strict=True))
            if any(np.abs(images[key] - known[key]).max() > 1e-6 for key in {*images} & {*known}):
                raise StereocalError(
                    f"The table does not have the points of all {count} cameras that the "
                    "camera files name: give the table of all, or --cameras 1,2."
                )
            images |= known
        taken |= {f"{each.what} {each.taken}": each for each in found.taken}
        remarks |= dict.fromkeys(found.remarks)
    if len(cameras) < count:
        raise StereocalError(failed[0])
    if distance_m is None:
        raise StereocalError("distance A-B is missing: give --distance D in metres.")
    keys = sorted(images)
    frame, camera, target = np.array(keys, dtype=np.int64).T
    recording = Recording(
        name,
        {number: cameras[number] for number in numbers},
        RigidObject.bar(distance_m),
        frame,
        camera,
        target,
        np.array([images[key] for key in keys]),
        np.full(len(keys), np.nan),
    )
    lines = [each for each in taken.values() if "point" not in each.what]
    lines.insert(0, Taken("points", f"{len(keys)} of {count} cameras", ", ".join(files)))
    return EveryCamera(recording, tuple(lines), (*remarks, *failed))


def targets_in(content: bytes, source: str) -> tuple[str, ...]:
    """The targets of a table of format 2, sorted; `ENDS` for one of another program."""
    if not _is_of_points(content, source):
        return ENDS
    found = tuple(sorted({*_column(content, source, "target")}))
    if len(found) > MOST_TARGETS:
        raise StereocalError(
            f"{source}: it has {len(found)} targets. Say where they are on the object in a "
            "dataset.json, and give it with the other files."
        )
    return found


def _is_of_points(content: bytes, source: str) -> bool:
    """Whether it is a table of format 2."""
    head, _ = first_rows(content, source)
    return {*REQUIRED} <= {cell.strip().lower() for cell in head[0]}


def _is_single(name: str, content: bytes) -> bool:
    """Whether a file has one camera."""
    found = format_of(name, content)
    return found is not None and READ[found].one_camera


def _of_points(
    files: Mapping[str, bytes],
    table: str,
    options: ExchangeOptions,
    name: str,
    lengths: Mapping[str, float],
) -> EveryCamera:
    """The recording of a table of format 2."""
    first, *others = targets = targets_in(files[table], table)
    if not {*others} & {*lengths}:
        raise StereocalError(
            f"{table}: the distance from {first} to {(*others, 'another target')[0]} is missing: "
            "state it in metres."
        )
    rest = {each: content for each, content in files.items() if each != table}
    cameras = _named_as(cameras_in(rest, options), _column(files[table], table, "camera"), table)
    # Those without a length are read too, so that their rows are no errors.
    along = np.array([lengths.get(target, -1.0 - k) for k, target in enumerate(targets)])
    along[0] = 0.0
    check_length(f"longest distance from {first}", float(along.max()))
    whole = RigidObject(targets, np.column_stack([along, np.zeros((len(along), 2))]))
    read = read_points(files[table], cameras, whole, table)
    used = np.flatnonzero(along >= 0.0)
    rows = np.isin(read.target, used)
    recording = replace(
        read,
        name=name,
        object=RigidObject(tuple(targets[k] for k in used), whole.points[used]),
        target=np.searchsorted(used, read.target[rows]),
        **{each: getattr(read, each)[rows] for each in ("frame", "camera", "points", "sigma_px")},
    )
    taken = [Taken("points", f"{rows.sum()} of {len(cameras)} cameras", table)]
    taken += [Taken("lens", f"of camera {each}", ", ".join(rest)) for each in cameras]
    remarks = [
        f"The camera {each} has no points in {table}."
        for number, each in enumerate(cameras)
        if number not in recording.camera
    ]
    remarks += [
        f"The target {each} has no length, and is not used."
        for each in targets
        if each not in recording.object.names
    ]
    return EveryCamera(recording, tuple(taken), tuple(remarks))


def _column(content: bytes, source: str, name: str) -> list[str]:
    """The values of a column of a table of format 2, in the order of their first rows."""
    raw = read_rows(content, source, REQUIRED, NUMBERS, (), EMPTY).raw[name]
    return [str(each) for each in raw.str.strip().unique()]


def cameras_in(files: Mapping[str, bytes], options: ExchangeOptions) -> dict[str, Camera]:
    """The cameras by the name in a file of several, or of the file of one."""
    found: dict[str, Camera] = {}
    for name, content in files.items():
        names = camera_names(name, content)
        of_file = {PurePath(name).stem: None} if len(names) < 2 else dict.fromkeys(names)
        for number, camera in enumerate(of_file):
            if camera in found:
                raise StereocalError(f"{name}: there is a camera {camera} already.")
            chosen = None if len(names) < 2 else (str(1 + (number == 0)), str(number + 1))
            pair = read_camera_pair({name: content}, replace(options, cameras=chosen))
            found[camera] = pair.secondary
    return found


def _named_as(
    cameras: Mapping[str, Camera], wanted: Iterable[str], source: str
) -> dict[str, Camera]:
    """The cameras by their names in a table, in their own order."""
    plain = {_PREFIX.sub("", name, count=1).lower(): name for name in cameras}
    if len(plain) < len(cameras):
        plain = {}
    found, order = dict[str, str](), {name: number for number, name in enumerate(cameras)}
    for name in wanted:
        own = name if name in cameras else plain.get(_PREFIX.sub("", name, count=1).lower())
        if own is None:
            raise StereocalError(
                f"{source}: it has points of a camera {name[:40]}, and no camera file is named so "
                f"(there are {', '.join(cameras)[:200] or 'none'}): give {name[:40]}.json, or name "
                "its file so."
            )
        found[name] = own
    pairs = [*found.items(), *((name, name) for name in cameras if name not in found.values())]
    return {name: cameras[own] for name, own in sorted(pairs, key=lambda each: order[each[1]])}


def _count(files: Mapping[str, bytes]) -> int:
    """How many cameras the files name."""
    found = 0
    for name, content in files.items():
        opened = open_easywand(content, name) if is_matlab(content) else None
        named = opened.cameras if opened is not None else camera_names(name, content)
        found = max(found, len(named))
    return found
