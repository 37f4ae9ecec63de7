"""What the Check page stores in a project: parameters to check, and new images."""

from __future__ import annotations

import tempfile
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.field.checking.new_images import NewImages, images_of_bars, images_of_pairs
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.matching.parquet import PARQUET
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction_files import PIXELS
from stereocal.projects.application import parameters_in
from stereocal.projects.files import (
    StoredFile,
    about_files,
    files_of,
    keep_file,
    name_files,
)
from stereocal.projects.project import Project
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters

CHECK = "check"
"""Part of a project."""
PARAMETERS, IMAGES = "parameters", "images"
TARGET = "target"


class ProjectCheck:
    """The Check page's files of one project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    def keep_parameters(self, label: str, content: bytes) -> None:
        """Store a parameter file.

        Raises:
            StereocalError: it is not a parameter file; nothing has changed.
        """
        parameters_in(content, label)
        self._keep(PARAMETERS, label, content)

    def keep_images(self, label: str, content: bytes, rig: RigParameters | None) -> None:
        """Store new bars or matched points.

        Args:
            rig: the parameters to be checked; None if there are none yet.

        Raises:
            StereocalError: they cannot be read, or are not of this rig; nothing has changed.
        """
        if rig is not None:
            images_in(content, label, rig)
        self._keep(IMAGES, label, content)

    def file(self, name: str) -> tuple[str, StoredFile] | None:
        """Label and content of `PARAMETERS` or `IMAGES`; None if not given."""
        with self.database.reading():
            found = files_of(self.database, CHECK).get(name)
            label = str(about_files(self.database, CHECK).get(name))
        return None if found is None else (label, found)

    def _keep(self, name: str, label: str, content: bytes) -> None:
        with self.database.transaction():
            stored = keep_file(self.database, content, label)
            name_files(self.database, CHECK, {name: stored}, label)


def images_in(content: bytes, label: str, rig: RigParameters) -> NewImages:
    """New images in an uploaded file: a zip with `dataset.json`, or a table.

    Raises:
        StereocalError: it cannot be read, or is not of this rig.
    """
    if content[:4] == b"PK\x03\x04":
        return images_of_bars(parse_zip(content, label), rig)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
        path = Path(folder) / f"table{Path(label).suffix.lower()}"
        path.write_bytes(content)
        return images_in_table(path, label, rig)


def images_in_table(path: Path, label: str, rig: RigParameters) -> NewImages:
    """New images in a table: bars if it has a column `target`, else matched points alone.

    A table does not state the length of its bars: it is taken for that of the calibration.

    Raises:
        StereocalError: it cannot be read, or is not of this rig.
    """
    table = PointTable(path, PIXELS, label)
    if TARGET not in table.names or path.suffix.lower() in PARQUET:
        return images_of_pairs(table, rig)
    length = rig.inputs.get("target_distance_m")
    if not isinstance(length, float):
        raise StereocalError(
            f"{label}: the length of the bars is unknown. Give a data set with dataset.json, or "
            "matched points without the column target."
        )
    rows = read_table(path.read_bytes(), label).strict(label)
    dataset = Dataset(label, rig.primary, rig.secondary, rows, rig.pose.baseline, length)
    return images_of_bars(dataset, rig)
