"""A data set in a folder or a zip: `dataset.json`, camera files, points or photographs.

Format 1 has two cameras, a bar and `correspondences.csv`; format 2 any number of cameras, any rigid
object and `points.csv`. Both are read as a `Recording`, and nothing is fitted while they are read.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from stereocal.errors import PointsOutsideError, StereocalError, disk_errors, naming
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.dataset_description import (
    BOARD,
    DATASET_FORMAT,
    DESCRIPTION,
    FREE,
    HOW_MADE,
    LARGEST_DESCRIPTION,
    POINTS,
    RECORDING_FORMAT,
    STARTS,
    TABLE,
    Description,
    find_description,
)
from stereocal.formats.points_csv import read_points_csv, write_points
from stereocal.formats.window_entry import WINDOW, windows_entry
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.frame_rates import RATES, at_stated_rates
from stereocal.rig.pair import Pair
from stereocal.rig.recording import COLUMNS, Recording
from stereocal.system.arguments import checked
from stereocal.system.limits import Limits
from stereocal.system.photograph_files import is_photograph
from stereocal.system.records import plain
from stereocal.system.zip_files import open_zip, unzip

TEXTS = frozenset((".json", ".csv", ".yaml", ".yml", ".xml"))
NAMED = frozenset((".ini", ".conf", ".mat"))
"""Read if small, for a helpful error message where `dataset.json` names them as cameras."""


@checked
def read_dataset(
    path: str | Path, lens_model: LensModel | None = None, pair: str | None = None
) -> Pair:
    """Read a data set of two cameras, or two of more, from a folder or a zip.

    A baseline that was not measured is still to be found, as `stereocal.calibrate` does.

    Args:
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
        pair: such as `left-right`, of a data set with more than two cameras.
    """
    recording = read_recording(path, lens_model)
    with naming(str(path)):
        return recording.pair(*recording.chosen_pair(pair))


def read_recording(
    path: str | Path,
    lens_model: LensModel | None = None,
    *,
    as_counted: bool = False,
    with_points: bool = True,
) -> Recording:
    """Read a data set of any number of cameras from a folder or a zip.

    Args:
        lens_model, as_counted, with_points: as for `parse_recording`.
    """
    files, photographs = read_texts(Path(path))
    return parse_recording(
        files, str(path), photographs, lens_model, as_counted=as_counted, with_points=with_points
    )


def parse_zip(content: bytes, source: str, lens_model: LensModel | None = None) -> Recording:
    """The data set in a zip's content; photographs are not unpacked."""
    with open_zip(content, source) as opened:
        photographs = any(map(is_photograph, opened.names))
    files = unzip(content, source, lambda name: not is_photograph(name))
    return parse_recording(files, source, photographs, lens_model)


def read_texts(path: Path) -> tuple[dict[str, bytes], bool]:
    """The text files in a folder or a zip by name, and whether there are photographs too."""
    with disk_errors(f"{path} cannot be read"):
        if path.is_dir():
            below = [file for pattern in ("*", "*/*") for file in sorted(path.glob(pattern))]
            sizes = {
                file: file.stat().st_size
                for file in below
                if file.suffix.lower() in TEXTS | NAMED and file.is_file()
            }
            small = {
                file: size
                for file, size in sizes.items()
                if file.suffix.lower() in TEXTS or size <= LARGEST_DESCRIPTION
            }
            limits = Limits.from_environment()
            limits.check_count(len(small), str(path))
            limits.check_size(sum(small.values()), str(path))
            texts = {
                str(PurePosixPath(file.relative_to(path))): file.read_bytes() for file in small
            }
            return texts, any(is_photograph(file.name) and file.is_file() for file in below)
        if path.suffix.lower() in TEXTS and path.is_file():
            raise StereocalError(
                f"a data set is a folder or a zip with {DESCRIPTION}.{HOW_MADE}", str(path)
            )
        if path.is_file():
            with open_zip(path, path.name) as opened:
                photographs = any(map(is_photograph, opened.names))
            return unzip(path, path.name, lambda name: not is_photograph(name)), photographs
    raise StereocalError(f"{path}: there is no such folder or file.")


def parse_recording(
    files: Mapping[str, bytes],
    source: str,
    photographs: bool = False,
    lens_model: LensModel | None = None,
    *,
    as_counted: bool = False,
    with_points: bool = True,
) -> Recording:
    """The recording from files by name, which may all be in one subfolder.

    Args:
        photographs: whether there are photographs too, in which targets can be detected.
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
        as_counted: the frames as each camera counted them itself, whatever is known of its start.
        with_points: whether to read its points; else it has none.
    """
    description = find_description(files, source)
    if as_counted and not description.is_recording:
        raise StereocalError(
            f"{source}: a row of {TABLE} has the points of both cameras at one moment, so their "
            "frames are in step already. Give the points of each camera by its own count: a data "
            'set of format 2 with "frames": "own".'
        )
    own_frames = as_counted or (description.is_recording and description.counts_own_frames)
    recording = description.recording(lens_model)
    if not with_points:
        return recording
    if not description.is_recording:
        return _with_pairs(description, recording, photographs)
    recording = _with_points(description, recording, photographs, own_frames)
    if not own_frames:
        return recording
    with naming(source):
        counted = at_stated_rates(recording, description.entries.get(RATES))
    starts = {} if as_counted else description.start_frames
    return replace(counted.counted_from(starts), start_frames=starts, own_frames=not starts)


def _with_pairs(description: Description, recording: Recording, photographs: bool) -> Recording:
    """The recording with the points of `correspondences.csv`."""
    source, content = description.source, description.files.get(description.folder + TABLE)
    if content is None:
        if photographs or any(map(is_photograph, description.files)):
            raise StereocalError(
                f"{source}: it contains photographs and no {TABLE} yet; find the targets first, "
                "with `python -m stereocal detect` or on the Data page."
            )
        raise StereocalError(f"{source}: the table of points {TABLE!r} is missing.")
    name = f"{source}: {TABLE}"
    rows = read_table(content, name).strict(name)
    try:
        return recording.with_pairs(rows)
    except PointsOutsideError as error:
        raise PointsOutsideError(
            f"{name}: ", error.problems, error.what, error.recording
        ) from error
    except StereocalError as error:
        raise StereocalError(str(error), source) from error


def _with_points(
    description: Description, recording: Recording, photographs: bool, own_frames: bool
) -> Recording:
    """The recording with the points of one table, or of a table for each camera."""
    tables, cameras = description.entries.get("points", POINTS), recording.cameras
    by_camera = dict(tables) if isinstance(tables, dict) else {None: tables}
    if by_camera.keys() not in ({None}, cameras.keys()):
        raise StereocalError(
            f'{description.where}: "points" must name a table for each of the cameras.'
        )
    parts = []
    for camera, name in by_camera.items():
        content = description.files.get(f"{description.folder}{name}")
        if content is None:
            how = "; find the targets first, with `stereocal detect`" if photographs else ""
            raise StereocalError(
                f"{description.source}: the table of points {str(name)[:60]!r} is missing{how}."
            )
        table = f"{description.source}: {name}"
        parts.append(read_points_csv(content, cameras, recording.object, table, camera, own_frames))
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
    beyond = {name: sum(part.beyond_view.get(name, 0) for part in parts) for name in cameras}
    return replace(recording, **columns, beyond_view=beyond if any(beyond.values()) else {})


def pack_dataset(dataset: Pair) -> dict[str, bytes]:
    """The files of a data set by name, read back exactly by `parse_recording`: of format 1, and of
    an object that is no bar of format 2."""
    if dataset.correspondences.rigid_object is not None:
        return pack_recording(dataset.recording)
    entries = {
        "format": DATASET_FORMAT,
        "name": dataset.name,
        "baseline_m": dataset.baseline_m,
        "target_distance_m": dataset.target_distance_m,
        "baseline_sigma_m": FREE if dataset.baseline_is_free else dataset.baseline_sigma_m,
        "target_distance_sigma_m": dataset.target_distance_sigma_m,
        "notes": dataset.notes or None,
        STARTS: {"secondary": dataset.start_frame} if dataset.start_frame else None,
        "cameras": {which: f"{which}.json" for which in CAMERAS},
        WINDOW: windows_entry(dataset.recording, CAMERAS),
    }
    cameras = dict(zip(CAMERAS, (dataset.primary, dataset.secondary), strict=True))
    return _packed(entries, cameras, {TABLE: write_table(dataset.correspondences)})


def pack_recording(recording: Recording) -> dict[str, bytes]:
    """The files of a recording by name, read back exactly by `parse_recording`: of format 2."""
    if recording.baseline_sigma_m == np.inf:  # the file states what was measured
        recording = replace(recording, baselines_m={}, baseline_sigma_m=None)
    rigid_object, board = recording.object, recording.object.board
    points: Any = dict(zip(rigid_object.names, rigid_object.points.tolist(), strict=True))
    if board is not None:
        points = {BOARD: {k: v for k, v in plain(board).items() if v is not None}}
    entries = {
        "format": RECORDING_FORMAT,
        "name": recording.name,
        "cameras": {which: f"camera_{i + 1}.json" for i, which in enumerate(recording.cameras)},
        "object": points,
        "object_sigma_m": rigid_object.sigma_m,
        "baselines_m": {f"{a}-{b}": m for (a, b), m in recording.baselines_m.items()} or None,
        "baseline_sigma_m": recording.baseline_sigma_m,
        "notes": recording.notes or None,
        "frames": "own" if recording.own_frames or recording.start_frames else None,
        STARTS: dict(recording.start_frames) or None,
        WINDOW: windows_entry(recording),
    }
    return _packed(entries, recording.cameras, {POINTS: write_points(recording)})


def _packed(
    entries: Mapping[str, Any], cameras: Mapping[Any, Camera], table: Mapping[str, bytes]
) -> dict[str, bytes]:
    """The files of `dataset.json` with these entries, without those that are None, of cameras, and
    the table."""
    stated = {key: value for key, value in entries.items() if value is not None}
    return {
        DESCRIPTION: (json.dumps(stated, indent=2) + "\n").encode(),
        **{entries["cameras"][which]: write_camera(lens) for which, lens in cameras.items()},
        **table,
    }
