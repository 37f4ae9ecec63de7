"""A data set in a folder or a zip: `dataset.json`, two camera files, points or photographs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.lens_model import LensModel
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.dataset import Correspondences, Dataset
from stereocal.system.json_text import read_json
from stereocal.system.limits import Limits
from stereocal.system.photograph_files import is_photograph
from stereocal.system.zip_files import open_zip, unzip

DATASET_FORMAT = "stereocal-dataset/1"
DESCRIPTION = "dataset.json"
TABLE = "correspondences.csv"
FREE = "free"
"""`baseline_sigma_m` of a baseline that is not measured, but found from the lengths."""
LONGEST_NAME = 200
LARGEST_DESCRIPTION = 4_000_000
TEXTS = frozenset((".json", ".csv", ".yaml", ".yml", ".xml"))
NAMED = frozenset((".ini", ".conf", ".mat"))
"""Read if small, for a helpful error message where `dataset.json` names them as cameras."""


@dataclass(frozen=True)
class Survey:
    """The contents of `dataset.json`: a data set without its points."""

    name: str
    primary: Camera
    secondary: Camera
    baseline_m: float
    target_distance_m: float
    baseline_sigma_m: float | None
    target_distance_sigma_m: float | None
    notes: str

    def with_points(self, correspondences: Correspondences) -> Dataset:
        """The data set; a free baseline is found from the lengths of its bars.

        Raises:
            StereocalError: as `Dataset`, or as `with_baseline_found`.
        """
        return with_baseline_found(Dataset(correspondences=correspondences, **vars(self)))


def read_dataset(path: str | Path, lens_model: LensModel | None = None) -> Dataset:
    """Read a data set from a folder or a zip.

    Args:
        lens_model: meaning of four distortion coefficients if a camera file does not state it.

    Raises:
        StereocalError: the data set or any of its rows is invalid.
    """
    files, photographs = read_texts(Path(path))
    return parse_dataset(files, str(path), photographs, lens_model)


def read_survey(path: str | Path, lens_model: LensModel | None = None) -> Survey:
    """Read a data set without its points, which may still be missing.

    Raises:
        StereocalError: as `read_dataset`.
    """
    files, _ = read_texts(Path(path))
    return parse_survey(files, str(path), lens_model)


def read_texts(path: Path) -> tuple[dict[str, bytes], bool]:
    """The text files in a folder or a zip by name, and whether there are photographs too.

    Raises:
        StereocalError: there is no such folder or zip, or it cannot be read.
    """
    try:
        if path.is_dir():
            known = _files_in(path, lambda name: Path(name).suffix.lower() in TEXTS | NAMED)
            found = [file for file in known if file.suffix.lower() in TEXTS or _is_small(file)]
            limits = Limits.from_environment()
            limits.check_count(len(found), str(path))
            limits.check_size(sum(file.stat().st_size for file in found), str(path))
            texts = {
                str(PurePosixPath(file.relative_to(path))): file.read_bytes() for file in found
            }
            return texts, any(True for _ in _files_in(path, is_photograph))
        if path.is_file():
            with open_zip(path, path.name) as opened:
                photographs = any(map(is_photograph, opened.names))
            return unzip(path, path.name, lambda name: not is_photograph(name)), photographs
    except OSError as error:
        raise StereocalError(f"{path} cannot be read: {error.strerror or error}.") from error
    raise StereocalError(f"{path}: there is no such folder or file.")


def parse_dataset(
    files: Mapping[str, bytes],
    source: str,
    photographs: bool = False,
    lens_model: LensModel | None = None,
) -> Dataset:
    """The data set from files by name, which may all be in one subfolder.

    Args:
        photographs: whether there are photographs too, in which targets can be detected.

    Raises:
        StereocalError: as `read_dataset`.
    """
    survey = parse_survey(files, source, lens_model)
    folder, _ = find_description(files, source)
    if folder + TABLE not in files:
        if photographs or any(map(is_photograph, files)):
            raise StereocalError(
                f"{source}: it contains photographs and no {TABLE} yet; find the targets first, "
                "with `python -m stereocal detect` or on the Data page."
            )
        raise StereocalError(f"{source}: the table of points {TABLE!r} is missing.")
    name = f"{source}: {TABLE}"
    rows = read_table(files[folder + TABLE], name).strict(name)
    try:
        return survey.with_points(rows)
    except RefusedRowsError as error:
        raise RefusedRowsError(
            f"{source}: {TABLE}: ", error.problems, "with a point outside its image"
        ) from error
    except StereocalError as error:
        raise StereocalError(str(error), source) from error


def parse_zip(content: bytes, source: str, lens_model: LensModel | None = None) -> Dataset:
    """The data set in a zip's content; photographs are not unpacked.

    Raises:
        StereocalError: as `read_dataset`.
    """
    with open_zip(content, source) as opened:
        photographs = any(map(is_photograph, opened.names))
    files = unzip(content, source, lambda name: not is_photograph(name))
    return parse_dataset(files, source, photographs, lens_model)


def parse_survey(
    files: Mapping[str, bytes], source: str, lens_model: LensModel | None = None
) -> Survey:
    """The data set without its points, from files by name.

    Raises:
        StereocalError: as `read_dataset`; the values of the lengths are not checked here.
    """
    folder, description = find_description(files, source)
    where = f"{source}: {DESCRIPTION}"
    named = description.get("cameras")
    if not isinstance(named, dict) or not set(CAMERAS) <= named.keys():
        raise StereocalError(f'{where}: "cameras" must name a primary and a secondary camera file.')

    def camera(which: str) -> Camera:
        name = named[which]
        if not isinstance(name, str) or folder + name not in files:
            raise StereocalError(f"{source}: the {which}'s camera file {name!r} is missing.")
        return read_camera(files[folder + name], f"{source}: {name}", lens_model)

    return Survey(
        name=_shown(str(description.get("name") or Path(source).stem)),
        primary=camera("primary"),
        secondary=camera("secondary"),
        baseline_m=_length(description, "baseline_m", where),
        target_distance_m=_length(description, "target_distance_m", where),
        baseline_sigma_m=np.inf
        if description.get("baseline_sigma_m") == FREE
        else _optional(description, "baseline_sigma_m", where),
        target_distance_sigma_m=_optional(description, "target_distance_sigma_m", where),
        notes=str(description.get("notes", "")),
    )


def _shown(name: str) -> str:
    """A name that can be displayed: not too long, valid UTF-8."""
    return name[:LONGEST_NAME].encode("utf-8", "replace").decode()


def find_description(files: Mapping[str, bytes], source: str) -> tuple[str, dict[str, Any]]:
    """The folder of `dataset.json` (with its slash, or empty), and its content.

    Raises:
        StereocalError: there is none or several, or it is invalid.
    """
    found = [
        name
        for name in files
        if PurePosixPath(name).name == DESCRIPTION and not name.startswith("__MACOSX/")
    ]
    if not found:
        held = ", ".join(sorted(files)[:5]) or "nothing"
        raise StereocalError(f"{source}: there is no {DESCRIPTION} in it (it contains: {held}).")
    if len(found) > 1:
        raise StereocalError(
            f"{source}: it contains {len(found)} data sets ({', '.join(sorted(found)[:3])}); "
            "use one at a time."
        )
    if len(files[found[0]]) > LARGEST_DESCRIPTION:
        raise StereocalError(
            f"{source}: {len(files[found[0]])} bytes are too many for a {DESCRIPTION}."
        )
    description = read_json(files[found[0]], f"{source}: {DESCRIPTION}")
    if not isinstance(description, dict) or description.get("format") != DATASET_FORMAT:
        raise StereocalError(
            f'{source}: {DESCRIPTION} must be an object with "format": "{DATASET_FORMAT}".'
        )
    return found[0][: -len(DESCRIPTION)], description


def pack_dataset(dataset: Dataset) -> dict[str, bytes]:
    """The files of a data set by name, read back exactly by `parse_dataset`."""
    description = {
        "format": DATASET_FORMAT,
        "name": dataset.name,
        "baseline_m": dataset.baseline_m,
        "target_distance_m": dataset.target_distance_m,
        "baseline_sigma_m": FREE if dataset.baseline_is_free else dataset.baseline_sigma_m,
        "target_distance_sigma_m": dataset.target_distance_sigma_m,
        "notes": dataset.notes or None,
        "cameras": {"primary": "primary.json", "secondary": "secondary.json"},
    }
    kept = {key: value for key, value in description.items() if value is not None}
    return {
        DESCRIPTION: (json.dumps(kept, indent=2) + "\n").encode(),
        "primary.json": write_camera(dataset.primary),
        "secondary.json": write_camera(dataset.secondary),
        TABLE: write_table(dataset.correspondences),
    }


def _is_small(file: Path) -> bool:
    return file.stat().st_size <= LARGEST_DESCRIPTION


def _files_in(folder: Path, wanted: Callable[[str], bool]) -> Iterable[Path]:
    """The files with wanted names in a folder and its direct subfolders."""
    return (
        file
        for pattern in ("*", "*/*")
        for file in sorted(folder.glob(pattern))
        if wanted(file.name) and file.is_file()
    )


def _length(description: Mapping[str, Any], key: str, where: str) -> float:
    value = _optional(description, key, where)
    if value is None:
        raise StereocalError(f"{where}: {key} is missing.")
    return value


def _optional(description: Mapping[str, Any], key: str, where: str) -> float | None:
    value = description.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise StereocalError(f"{where}: {key} is {value!r}; it must be a number, in metres.")
    try:
        return float(value)
    except OverflowError as error:
        raise StereocalError(f"{where}: {key} is far too large; state it in metres.") from error
