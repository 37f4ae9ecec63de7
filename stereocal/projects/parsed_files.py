"""The files and results of a project as objects, kept in memory by the digests of their content.

What was read at the door, or has just been computed, is kept too, so that it is not read again.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import Table, read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, unpack_evaluation
from stereocal.projects.calibration_files import unpack_calibration
from stereocal.projects.files import Store, StoredFile
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


def keep(file: StoredFile, read: Camera | Table | Dataset) -> None:
    """Keep what was read from a file already."""
    kept: Mapping[type, Latest[Any]] = {Camera: CAMERAS, Table: TABLES, Dataset: FURTHER}
    kept[type(read)].keep(_key(file), read)


def _key(file: StoredFile) -> str:
    """Of what was read from a file: messages about it name its label."""
    return f"{file.sha256} {file.label}"


def file_of(inputs: Inputs, slot: Slot, database: Store) -> StoredFile:
    """The file of a slot, which must not be empty."""
    return StoredFile(inputs.files[slot], database, inputs.labels[slot])


def camera_of(file: StoredFile) -> Camera:
    """The camera of a file; the lens model was settled when it was uploaded."""
    return CAMERAS.once(_key(file), lambda: read_camera(file.read_bytes(), file.label, "brown"))


def table_of(file: StoredFile) -> Table:
    """All rows of a table, invalid ones included."""
    return TABLES.once(_key(file), lambda: read_table(file.read_bytes(), file.label))


def further_of(file: StoredFile) -> Dataset:
    """The data set of a zip."""
    return FURTHER.once(_key(file), lambda: parse_zip(file.read_bytes(), file.label, "brown"))


def dataset_of(inputs: Inputs, database: Store) -> Dataset:
    """The data set of complete inputs."""
    key = json.dumps(dataclasses.asdict(inputs), sort_keys=True)
    return DATASETS.once(key, lambda: _dataset_of(inputs, database))


def _dataset_of(inputs: Inputs, database: Store) -> Dataset:
    primary, secondary, table = (
        file_of(inputs, slot, database) for slot in ("primary", "secondary", "correspondences")
    )
    rows = table_of(table).strict(table.label)
    own = rows.rigid_object
    dataset = Dataset(
        name=inputs.name or Path(table.label).stem,
        primary=inputs.known("primary", camera_of(primary)),
        secondary=inputs.known("secondary", camera_of(secondary)),
        correspondences=rows,
        baseline_m=float(inputs.baseline_m or (inputs.baseline_free and 1.0) or 0.0),
        target_distance_m=float(own.distances.max() if own else inputs.target_distance_m or 0.0),
        baseline_sigma_m=np.inf if inputs.baseline_free else inputs.baseline_sigma_m,
        target_distance_sigma_m=inputs.target_distance_sigma_m,
    )
    if inputs.exchanged:
        dataset = dataset.with_targets_exchanged(inputs.exchanged)
    return with_baseline_found(dataset)


def calibration_of(database: Store) -> Calibration | None:
    """The stored calibration, with the data that it was computed from; None without one."""

    def made_from(stated: Mapping[str, Any]) -> Dataset:
        return dataset_of(checked_inputs(stated), database)

    with database.reading():
        digest = database.result_digest("calibration")
        if digest is None:
            return None
        return CALIBRATIONS.once(
            digest, lambda: unpack_calibration(database.result("calibration") or b"", made_from)
        )


def evaluation_of(database: Store, kind: str) -> Evaluation | None:
    """The stored evaluation of a kind; None without one."""
    with database.reading():
        digest = database.result_digest(kind)
        if digest is None:
            return None
        return EVALUATIONS.once(digest, lambda: unpack_evaluation(database.result(kind) or b""))
