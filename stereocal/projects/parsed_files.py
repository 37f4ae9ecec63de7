"""The files of a project, parsed once per process and cached by their digests."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import Table, read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, unpack_evaluation
from stereocal.projects.calibration_files import unpack_calibration
from stereocal.projects.database import Database
from stereocal.projects.files import StoredFile
from stereocal.projects.inputs import Inputs, Slot, checked_inputs
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset


@dataclass(frozen=True)
class LabelledFile:
    """A file and its name in messages."""

    file: StoredFile
    label: str


class CompleteInputs:
    """Complete inputs, hashable by all their values, and the database of their files."""

    def __init__(self, inputs: Inputs, database: Database) -> None:
        self.inputs, self.database = inputs, database
        self._key = json.dumps(dataclasses.asdict(inputs), sort_keys=True)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CompleteInputs) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def file_of(inputs: Inputs, slot: Slot, database: Database) -> LabelledFile:
    """The file of a slot, which must not be empty."""
    return LabelledFile(StoredFile(inputs.files[slot], database), inputs.labels[slot])


@lru_cache(maxsize=64)
def camera_of(given: LabelledFile) -> Camera:
    """The camera of a file; the lens model was settled when it was uploaded."""
    return read_camera(given.file.read_bytes(), given.label, "brown")


@lru_cache(maxsize=8)
def table_of(given: LabelledFile) -> Table:
    """All rows of a table, invalid ones included."""
    return read_table(given.file.read_bytes(), given.label)


@lru_cache(maxsize=16)
def further_of(given: LabelledFile) -> Dataset:
    """The data set of a zip."""
    return parse_zip(given.file.read_bytes(), given.label, "brown")


@lru_cache(maxsize=16)
def dataset_of(given: CompleteInputs) -> Dataset:
    """The data set of complete inputs."""
    inputs = given.inputs
    primary, secondary, table = (
        file_of(inputs, slot, given.database)
        for slot in ("primary", "secondary", "correspondences")
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


@dataclass(frozen=True)
class PackedResult:
    """A result as bytes."""

    content: bytes
    database: Database = field(compare=False, repr=False)


@lru_cache(maxsize=8)
def calibration_of(packed: PackedResult) -> Calibration:
    """The unpacked calibration, with the data that it was computed from."""

    def made_from(stated: Mapping[str, Any]) -> Dataset:
        return dataset_of(CompleteInputs(checked_inputs(stated), packed.database))

    return unpack_calibration(packed.content, made_from)


@lru_cache(maxsize=8)
def evaluation_of(packed: PackedResult) -> Evaluation:
    """The unpacked evaluation."""
    return unpack_evaluation(packed.content)
