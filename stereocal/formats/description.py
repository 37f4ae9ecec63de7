"""`dataset.json`: where it is, and what its entries say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import read_camera
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.system.json_text import read_json
from stereocal.system.records import of_plain

DATASET_FORMAT = "stereocal-dataset/1"
"""Two cameras and a bar, with `correspondences.csv`."""
RECORDING_FORMAT = "stereocal-dataset/2"
"""Any cameras and any rigid object, with `points.csv`."""
DESCRIPTION = "dataset.json"
LONGEST_NAME = 200
LARGEST_DESCRIPTION = 4_000_000


@dataclass(frozen=True)
class Description:
    """The `dataset.json` among files by name."""

    files: Mapping[str, bytes]
    source: str
    folder: str
    """Of the file, with its slash, or empty."""
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
        """The name of the data set, as it can be displayed: not too long, valid UTF-8."""
        name = str(self.entries.get("name") or Path(self.source).stem)
        return name[:LONGEST_NAME].encode("utf-8", "replace").decode()

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
        held = ", ".join(sorted(files)[:5]) or "nothing"
        raise StereocalError(f"{source}: there is no {DESCRIPTION} in it (it contains: {held}).")
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
    return Description(files, source, found[0][: -len(DESCRIPTION)], entries)
