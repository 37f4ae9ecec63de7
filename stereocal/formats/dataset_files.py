"""A data set as a folder or a zip: `dataset.json`, two camera files, `correspondences.csv`."""

from __future__ import annotations

import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from stereocal.dataset import Dataset
from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import read_table, write_table

DATASET_FORMAT = "stereocal-dataset/1"
DESCRIPTION = "dataset.json"
TABLE = "correspondences.csv"
MOST_FILES = 20_000
MOST_BYTES = 2_000_000_000
MOST_SWELLING = 200
"""A table of numbers packs to a fifth; a file that swells two hundredfold is a trap."""

DAMAGED_ZIP = (
    zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, OSError,
    OverflowError, IndexError, struct.error, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""All that `zipfile` and its decompressors raise on damaged content."""


def read_dataset(path: str | Path) -> Dataset:
    """Read a data set, a folder or a zip, and refuse it if any row cannot be used.

    Raises:
        StereocalError: one sentence that says what is wrong, and where.
    """
    path = Path(path)
    try:
        if path.is_dir():
            files = {
                str(PurePosixPath(file.relative_to(path))): file.read_bytes()
                for file in _small_files(path)
            }
        elif path.is_file():
            files = unzip(path.read_bytes(), path.name)
        else:
            raise StereocalError(f"{path}: there is no such folder or file.")
    except OSError as error:
        raise StereocalError(f"{path} cannot be read: {error.strerror or error}.") from error
    return parse_dataset(files, str(path))


def parse_dataset(files: Mapping[str, bytes], source: str) -> Dataset:
    """The data set of files by name; they may all lie in one folder further down.

    Raises:
        StereocalError: as `read_dataset`.
    """
    folder, description = find_description(files, source)
    where = f"{source}: {DESCRIPTION}"

    def content_of(name: Any, what: str) -> tuple[str, bytes]:
        if not isinstance(name, str) or folder + name not in files:
            raise StereocalError(f"{source}: {what} {name!r} is missing.")
        return f"{source}: {name}", files[folder + name]

    cameras = description.get("cameras")
    if not isinstance(cameras, dict) or not {"primary", "secondary"} <= cameras.keys():
        raise StereocalError(f'{where}: "cameras" must name a primary and a secondary camera file.')
    name, content = content_of(cameras["primary"], "the primary's camera file")
    primary = read_camera(content, name)
    name, content = content_of(cameras["secondary"], "the secondary's camera file")
    secondary = read_camera(content, name)
    name, content = content_of(TABLE, "the table of points")
    rows = read_table(content, name).strict(name)
    try:
        return Dataset(
            name=str(description.get("name") or Path(source).stem),
            primary=primary,
            secondary=secondary,
            correspondences=rows,
            baseline_m=_length(description, "baseline_m", where),
            target_distance_m=_length(description, "target_distance_m", where),
            baseline_sigma_m=_optional(description, "baseline_sigma_m", where),
            target_distance_sigma_m=_optional(description, "target_distance_sigma_m", where),
            notes=str(description.get("notes", "")),
        )
    except RefusedRowsError as error:
        raise RefusedRowsError(
            f"{source}: {TABLE}: ", error.problems, "with a point outside its image"
        ) from error
    except StereocalError as error:
        text = str(error)
        raise StereocalError(text if text.startswith(source) else f"{source}: {text}") from error


def find_description(files: Mapping[str, bytes], source: str) -> tuple[str, dict[str, Any]]:
    """The folder that holds `dataset.json` (with its slash, or nothing), and what it says.

    Raises:
        StereocalError: none or several, or it is not the JSON that it should be.
    """
    found = [
        name
        for name in files
        if PurePosixPath(name).name == DESCRIPTION and not name.startswith("__MACOSX/")
    ]
    if not found:
        held = ", ".join(sorted(files)[:5]) or "nothing"
        raise StereocalError(f"{source}: there is no {DESCRIPTION} in it (it holds: {held}).")
    if len(found) > 1:
        raise StereocalError(
            f"{source}: it holds {len(found)} data sets ({', '.join(sorted(found)[:3])}); "
            "give one at a time."
        )
    try:
        description = json.loads(files[found[0]].decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise StereocalError(f"{source}: {DESCRIPTION} is not valid JSON ({error}).") from error
    if not isinstance(description, dict) or description.get("format") != DATASET_FORMAT:
        raise StereocalError(
            f'{source}: {DESCRIPTION} must be an object with "format": "{DATASET_FORMAT}".'
        )
    return found[0][: -len(DESCRIPTION)], description


def unzip(content: bytes, source: str) -> dict[str, bytes]:
    """The files of a zip by name, in memory; no path of the zip is ever written to.

    Raises:
        StereocalError: not a zip, empty, damaged, or suspiciously large inside.
    """
    if not content:
        raise StereocalError(f"{source}: the file is empty (0 bytes).")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [item for item in archive.infolist() if not item.is_dir()]
            total = sum(item.file_size for item in members)
            if len(members) > MOST_FILES or total > MOST_BYTES:
                raise StereocalError(
                    f"{source}: {len(members)} files of {total} bytes inside are too many."
                )
            if total > MOST_SWELLING * len(content) + 10_000_000:
                raise StereocalError(
                    f"{source}: {len(content)} bytes would swell to {total}; it is not unpacked."
                )
            files = {}
            for item in members:
                with archive.open(item) as member:
                    files[item.filename] = member.read(item.file_size)
    except DAMAGED_ZIP as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this is not a sound zip file ({error}).") from error
    if not files:
        raise StereocalError(f"{source}: the zip is empty.")
    return files


def pack_dataset(dataset: Dataset) -> dict[str, bytes]:
    """The files of a data set by name, which `parse_dataset` reads back to the same numbers."""
    description = {
        "format": DATASET_FORMAT,
        "name": dataset.name,
        "baseline_m": dataset.baseline_m,
        "target_distance_m": dataset.target_distance_m,
        "baseline_sigma_m": dataset.baseline_sigma_m,
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


def _small_files(folder: Path) -> list[Path]:
    """The text files of a folder and of its direct subfolders; photographs are not read here."""
    wanted = {".json", ".csv", ".yaml", ".yml", ".xml"}
    return [
        file
        for pattern in ("*", "*/*")
        for file in sorted(folder.glob(pattern))
        if file.is_file() and file.suffix.lower() in wanted
    ]


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
        raise StereocalError(f"{where}: {key} is far too large; give it in metres.") from error
