"""`dataset.json`: where it is, and what its entries say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import read_camera
from stereocal.rig.camera import Camera, LensModel
from stereocal.system.json_text import read_json
from stereocal.system.records import of_plain

DATASET_FORMAT = "stereocal-dataset/1"
"""Two cameras and a bar, with `correspondences.csv`."""
RECORDING_FORMAT = "stereocal-dataset/2"
"""Any cameras and any rigid object, with `points.csv`."""
DESCRIPTION = "dataset.json"
LONGEST_NAME = 200
LARGEST_DESCRIPTION = 4_000_000


def find_description(files: Mapping[str, bytes], source: str) -> tuple[str, dict[str, Any]]:
    """The folder of `dataset.json` (with its slash, or empty), and its content."""
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
    formats = (DATASET_FORMAT, RECORDING_FORMAT)
    if not isinstance(description, dict) or description.get("format") not in formats:
        raise StereocalError(
            f'{source}: {DESCRIPTION} must be an object with "format": "{DATASET_FORMAT}", or '
            f'"{RECORDING_FORMAT}".'
        )
    return found[0][: -len(DESCRIPTION)], description


def name_of(description: Mapping[str, Any], source: str) -> str:
    """The name of a data set, as it can be displayed: not too long, valid UTF-8."""
    name = str(description.get("name") or Path(source).stem)
    return name[:LONGEST_NAME].encode("utf-8", "replace").decode()


def camera_named(
    name: Any,
    which: str,
    files: Mapping[str, bytes],
    folder: str,
    source: str,
    lens_model: LensModel | None,
) -> Camera:
    """The camera of the file that `dataset.json` names for a camera."""
    if not isinstance(name, str) or folder + name not in files:
        raise StereocalError(f"{source}: the {which}'s camera file {name!r} is missing.")
    return read_camera(files[folder + name], f"{source}: {name}", lens_model)


def length(description: Mapping[str, Any], key: str, where: str) -> float:
    """An entry in metres that must be there."""
    value = optional_length(description, key, where)
    if value is None:
        raise StereocalError(f"{where}: {key} is missing.")
    return value


def optional_length(description: Mapping[str, Any], key: str, where: str) -> float | None:
    """An entry in metres; None if there is none. Its value is not checked here."""
    value = description.get(key)
    try:
        return of_plain(value, float | None)  # type: ignore[arg-type]
    except ValueError as error:
        raise StereocalError(
            f"{where}: {key} is {str(value)[:60]!r}; it must be a number, in metres."
        ) from error
