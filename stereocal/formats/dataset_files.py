"""A data set in a folder or a zip: `dataset.json`, two camera files, points or photographs."""

import json
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from stereocal.errors import RefusedRowsError, StereocalError, disk_errors, naming
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.recording_files import (
    DATASET_FORMAT,
    DESCRIPTION,
    HOW_MADE,
    LARGEST_DESCRIPTION,
    STARTS,
    find_description,
    pack_recording,
    parse_recording,
)
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.rig.camera import LensModel
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import Recording
from stereocal.system.limits import Limits
from stereocal.system.photograph_files import is_photograph
from stereocal.system.zip_files import open_zip, unzip

TABLE = "correspondences.csv"
FREE = "free"
"""`baseline_sigma_m` of a baseline that is not measured, but found from the lengths."""
TEXTS = frozenset((".json", ".csv", ".yaml", ".yml", ".xml"))
NAMED = frozenset((".ini", ".conf", ".mat"))
"""Read if small, for a helpful error message where `dataset.json` names them as cameras."""


def read_dataset(
    path: str | Path, lens_model: LensModel | None = None, pair: str | None = None
) -> Dataset:
    """Read a data set from a folder or a zip.

    Args:
        lens_model: meaning of four distortion coefficients if a camera file does not state it.
        pair: such as `left-right`, of a data set with more than two cameras.
    """
    files, photographs = read_texts(Path(path))
    return parse_dataset(files, str(path), photographs, lens_model, pair)


def read_recording(path: str | Path, lens_model: LensModel | None = None) -> Recording:
    """Read a data set of any number of cameras (format 2) from a folder or a zip."""
    files, photographs = read_texts(Path(path))
    return parse_recording(files, str(path), photographs, lens_model)


def read_as_counted(path: str | Path, lens_model: LensModel | None = None) -> Recording:
    """As `read_recording`, with the frames of each camera as it counted them itself."""
    files, photographs = read_texts(Path(path))
    found = find_description(files, str(path))
    if not found.is_recording:
        raise StereocalError(
            f"{path}: a row of {TABLE} has the points of both cameras at one moment, so their "
            "frames are in step already. Give the points of each camera by its own count: a data "
            'set of format 2 with "frames": "own".'
        )
    known = {STARTS: dict.fromkeys(found.entries["cameras"], 0)}
    described = json.dumps({**found.entries, "frames": "own", **known}).encode()
    files = {**files, f"{found.folder}{DESCRIPTION}": described}
    return parse_recording(files, str(path), photographs, lens_model)


def read_cameras(path: str | Path, lens_model: LensModel | None = None) -> Recording:
    """The cameras and lengths of a data set of either format, without its points."""
    files, _ = read_texts(Path(path))
    if find_description(files, str(path)).is_recording:
        return parse_recording(files, str(path), False, lens_model, with_points=False)
    return Recording.of_pair(parse_survey(files, str(path), lens_model))


def read_texts(path: Path) -> tuple[dict[str, bytes], bool]:
    """The text files in a folder or a zip by name, and whether there are photographs too."""
    with disk_errors(f"{path} cannot be read"):
        if path.is_dir():
            below = [file for each in ("*", "*/*") for file in sorted(path.glob(each))]
            sizes = {
                file: file.stat().st_size
                for file in below
                if file.suffix.lower() in TEXTS | NAMED and file.is_file()
            }
            found = {
                file: size
                for file, size in sizes.items()
                if file.suffix.lower() in TEXTS or size <= LARGEST_DESCRIPTION
            }
            limits = Limits.from_environment()
            limits.check_count(len(found), str(path))
            limits.check_size(sum(found.values()), str(path))
            texts = {
                str(PurePosixPath(file.relative_to(path))): file.read_bytes() for file in found
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


def parse_dataset(
    files: Mapping[str, bytes],
    source: str,
    photographs: bool = False,
    lens_model: LensModel | None = None,
    pair: str | None = None,
) -> Dataset:
    """The data set from files by name, which may all be in one subfolder.

    Args:
        photographs: whether there are photographs too, in which targets can be detected.
        pair: as for `read_dataset`.
    """
    found = find_description(files, source)
    if found.is_recording:
        recording = parse_recording(files, source, photographs, lens_model, pair=pair)
        with naming(source):
            if pair is None and len(recording.cameras) > 2:
                raise StereocalError(
                    f"it has {len(recording.cameras)} cameras: choose two. "
                    f"{recording.describe_pairs()}",
                    option="--pair",
                )
            chosen = recording.pair_named(pair) if pair else recording.pairs[0]
            return with_baseline_found(recording.pair(*chosen))
    if pair is not None:
        raise StereocalError(f"{source}: it has two cameras, and no pair {pair[:60]!r} to choose.")
    survey = parse_survey(files, source, lens_model)
    if found.folder + TABLE not in files:
        if photographs or any(map(is_photograph, files)):
            raise StereocalError(
                f"{source}: it contains photographs and no {TABLE} yet; find the targets first, "
                "with `python -m stereocal detect` or on the Data page."
            )
        raise StereocalError(f"{source}: the table of points {TABLE!r} is missing.")
    name = f"{source}: {TABLE}"
    rows = read_table(files[found.folder + TABLE], name).strict(name)
    try:
        return with_baseline_found(survey.with_points(rows))
    except RefusedRowsError as error:
        raise RefusedRowsError(f"{source}: {TABLE}: ", error.problems, error.what) from error
    except StereocalError as error:
        raise StereocalError(str(error), source) from error


def parse_zip(content: bytes, source: str, lens_model: LensModel | None = None) -> Dataset:
    """The data set in a zip's content; photographs are not unpacked."""
    with open_zip(content, source) as opened:
        photographs = any(map(is_photograph, opened.names))
    files = unzip(content, source, lambda name: not is_photograph(name))
    return parse_dataset(files, source, photographs, lens_model)


def parse_survey(
    files: Mapping[str, bytes], source: str, lens_model: LensModel | None = None
) -> Dataset:
    """The data set without its points, from files by name; a free baseline is still to be found."""
    found, none = find_description(files, source), np.empty((0, 2))
    is_free = found.entries.get("baseline_sigma_m") == FREE
    entries: dict[str, Any] = {
        **found.cameras(lens_model),
        "correspondences": Correspondences.from_arrays(none[:, 0], "", none, none),
        "baseline_m": found.length("baseline_m"),
        "target_distance_m": found.length("target_distance_m"),
        "baseline_sigma_m": np.inf if is_free else found.optional_length("baseline_sigma_m"),
        "target_distance_sigma_m": found.optional_length("target_distance_sigma_m"),
    }
    started = found.entries.get(STARTS)
    if isinstance(started, dict) and isinstance(started.get("secondary"), int):
        entries["start_frame"] = started["secondary"]
    with naming(source):
        return Dataset(found.name, notes=found.notes, **entries)


def pack_dataset(dataset: Dataset) -> dict[str, bytes]:
    """The files of a data set by name, read back exactly by `parse_dataset`."""
    if dataset.correspondences.rigid_object is not None:
        return pack_recording(Recording.of_pair(dataset))
    return pack_pair(dataset)


def pack_pair(dataset: Dataset) -> dict[str, bytes]:
    """The same in format 1; the table says where targets are on an object."""
    description = {
        "format": DATASET_FORMAT,
        "name": dataset.name,
        "baseline_m": dataset.baseline_m,
        "target_distance_m": dataset.target_distance_m,
        "baseline_sigma_m": FREE if dataset.baseline_is_free else dataset.baseline_sigma_m,
        "target_distance_sigma_m": dataset.target_distance_sigma_m,
        "notes": dataset.notes or None,
        STARTS: {"secondary": dataset.start_frame} if dataset.start_frame else None,
        "cameras": {"primary": "primary.json", "secondary": "secondary.json"},
    }
    kept = {key: value for key, value in description.items() if value is not None}
    return {
        DESCRIPTION: (json.dumps(kept, indent=2) + "\n").encode(),
        "primary.json": write_camera(dataset.primary),
        "secondary.json": write_camera(dataset.secondary),
        TABLE: write_table(dataset.correspondences),
    }
