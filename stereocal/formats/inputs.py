"""What a person may give for data: a data set, or a project's zip."""

import zipfile
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import parse_recording, read_recording
from stereocal.rig.camera import LensModel
from stereocal.rig.recording import Recording
from stereocal.system.zip_files import open_zip, unzip

MANIFEST = "project.json"
"""In a project's zip."""
STORED_PROJECT = ".sqlite"


def read_input(path: Path, lens_model: LensModel | None = None) -> Recording:
    """The data set of a folder or zip with `dataset.json`, or of a project's zip.

    Args:
        lens_model: as for `read_recording`; a project already holds it.
    """
    if path.suffix == STORED_PROJECT:
        raise StereocalError(
            f"{path} is a project of the dashboard: export it there as a zip, and give that."
        )
    if path.is_file() and zipfile.is_zipfile(path):
        with open_zip(path, path.name) as opened:
            holds_project = MANIFEST in opened.names
        if holds_project:
            files = unzip(path, path.name, lambda member: "/" not in member)
            if "dataset.json" not in files:
                raise StereocalError(
                    f"{path}: the project is incomplete: open it on the dashboard, and give what "
                    "the Data page asks for."
                )
            return parse_recording(files, str(path), lens_model="brown")
    return read_recording(path, lens_model)
