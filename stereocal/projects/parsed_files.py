"""The files and results of a project as objects, kept in memory by the digests of their content.

What was read at the door, or has just been computed, is kept too, so that it is not read again.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import Table, read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, unpack_evaluation
from stereocal.projects.calibration_files import unpack_calibration
from stereocal.projects.database import Database
from stereocal.projects.files import StoredFile, result_digest, result_of
from stereocal.projects.inputs import Inputs, Slot, checked_inputs
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset
from stereocal.system.latest import Latest

CAMERAS: Latest[Camera] = Latest(64)
TABLES: Latest[Table] = Latest(8)
DATASETS: Latest[Dataset] = Latest(16)
FURTHER: Latest[Dataset] = Latest(16)
CALIBRATIONS: Latest[Calibration] = Latest(8)
EVALUATIONS: Latest[Evaluation] = Latest(8)


@dataclass(frozen=True)
class LabelledFile:
    """A file and its name in messages."""

    file: StoredFile
    label: str

    @property
    def key(self) -> str:
        """Of what was read from it."""
        return f"{self.file.sha256} {self.label}"

    def keep(self, read: Camera | Table) -> None:
        """Keep what was read from it already."""
        if isinstance(read, Camera):
            CAMERAS.keep(self.key, read)
        else:
            TABLES.keep(self.key, read)


def file_of(inputs: Inputs, slot: Slot, database: Database) -> LabelledFile:
    """The file of a slot, which must not be empty."""
    return LabelledFile(StoredFile(inputs.files[slot], database), inputs.labels[slot])


def camera_of(given: LabelledFile) -> Camera:
    """The camera of a file; the lens model was settled when it was uploaded."""
    return CAMERAS.once(
        given.key, lambda: read_camera(given.file.read_bytes(), given.label, "brown")
    )


def table_of(given: LabelledFile) -> Table:
    """All rows of a table, invalid ones included."""
    return TABLES.once(given.key, lambda: read_table(given.file.read_bytes(), given.label))


def further_of(given: LabelledFile) -> Dataset:
    """The data set of a zip."""
    return FURTHER.once(given.key, lambda: parse_zip(given.file.read_bytes(), given.label, "brown"))


def dataset_of(inputs: Inputs, database: Database) -> Dataset:
    """The data set of complete inputs."""
    key = json.dumps(dataclasses.asdict(inputs), sort_keys=True)
    return DATASETS.once(key, lambda: _dataset_of(inputs, database))


def _dataset_of(inputs: Inputs, database: Database) -> Dataset:
    primary, secondary, table = (
        file_of(inputs, slot, database) for slot in ("primary", "secondary", "correspondences")
    )
    dataset = Dataset(
        name=inputs.name or Path(table.label).stem,
        primary=inputs.known("primary", camera_of(primary)),
        secondary=inputs.known("secondary", camera_of(secondary)),
        correspondences=table_of(table).strict(table.label),
        baseline_m=float(inputs.baseline_m or (inputs.baseline_free and 1.0) or 0.0),
        target_distance_m=float(inputs.target_distance_m or 0.0),
        baseline_sigma_m=np.inf if inputs.baseline_free else inputs.baseline_sigma_m,
        target_distance_sigma_m=inputs.target_distance_sigma_m,
    )
    if inputs.exchanged:
        dataset = dataset.with_targets_exchanged(inputs.exchanged)
    return with_baseline_found(dataset)


def calibration_of(database: Database) -> Calibration | None:
    """The stored calibration, with the data that it was computed from; None without one."""

    def made_from(stated: Mapping[str, Any]) -> Dataset:
        return dataset_of(checked_inputs(stated), database)

    with database.reading():
        digest = result_digest(database, "calibration")
        if digest is None:
            return None
        return CALIBRATIONS.once(
            digest,
            lambda: unpack_calibration(result_of(database, "calibration") or b"", made_from),
        )


def evaluation_of(database: Database, kind: str) -> Evaluation | None:
    """The stored evaluation of a kind; None without one."""
    with database.reading():
        digest = result_digest(database, kind)
        if digest is None:
            return None
        return EVALUATIONS.once(digest, lambda: unpack_evaluation(result_of(database, kind) or b""))
