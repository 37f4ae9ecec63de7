"""One piece of work on disk: inputs, settings, results. Knows no screen.

The id is unguessable and is the only key to the project.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, RefusedRowsError, StereocalError
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, pack_evaluation
from stereocal.projects import given
from stereocal.projects.calibration_files import pack_calibration
from stereocal.projects.database import Database
from stereocal.projects.files import (
    StoredFile,
    about_files,
    files_of,
    forget_files,
    free_content,
    keep_file,
    keep_result,
    keep_values,
    name_files,
    put_files,
    result_of,
    values_of,
)
from stereocal.projects.folders import SUFFIX, is_id, new_database
from stereocal.projects.inputs import Inputs, Slot, check_inputs, checked_inputs
from stereocal.projects.refusals import DamagedError
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset, check_length, points_outside

INPUT, SETTING, FURTHER, CALIBRATED = "input", "setting", "dataset", "calibrated"
"""Parts of a project: what is given, forms, further data sets, what the result was made from."""
VALUES = tuple(
    each.name for each in dataclasses.fields(Inputs) if each.name not in ("files", "labels")
)
OF_TABLE = ("exchanged", "put_back")
"""Corrections of frames, which belong to the table that they were made for."""


class Project:
    """A project. Every change is on disk when its method returns.

    Raises:
        StereocalError: on `open`, an id that is none, or no such project.
    """

    def __init__(self, database: Database) -> None:
        self.database = database

    @property
    def id(self) -> str:
        """32 hexadecimal digits."""
        return self.database.path.stem

    @classmethod
    def create(cls, home: Path) -> Project:
        """A new, empty project below `home`."""
        return cls(new_database(home, lambda _database: None))

    @classmethod
    def open(cls, home: Path, project_id: str) -> Project:
        """The project of this id."""
        if not is_id(project_id):
            raise StereocalError("The address does not name a project.")
        project = cls(Database(home / "projects" / f"{project_id}{SUFFIX}"))
        if project.database.marker.exists():
            raise StereocalError("There is no project at this address, or it was removed.")
        with project.database.reading():
            return project

    # Inputs

    @property
    def inputs(self) -> Inputs:
        """What has been given so far.

        Raises:
            StereocalError: it is damaged.
        """
        with self.database.reading():
            values = values_of(self.database, INPUT)
            files, labels = files_of(self.database, INPUT), about_files(self.database, INPUT)
        try:
            return checked_inputs({
                **{name: values[name] for name in VALUES if name in values},
                "files": {slot: file.sha256 for slot, file in files.items()},
                "labels": labels,
            })  # fmt: skip
        except DAMAGED as error:
            raise DamagedError("What was given to the project is damaged.") from error

    def give(
        self,
        files: Mapping[Slot, tuple[str, bytes]],
        drop: Sequence[Slot] = (),
        **values: Any,
    ) -> None:
        """Take over files (slot to name and content) and values in one step, or nothing.

        The state that results is checked as far as it is complete.

        Args:
            drop: slots to empty before.

        Raises:
            StereocalError: what was given cannot be used; the project is as it was.
        """
        stored = {slot: self._stored(slot, *file) for slot, file in files.items()}
        with self.database.act():
            before = self.inputs
            forget_files(self.database, INPUT, [slot for slot in drop if slot not in files])
            for slot, file in stored.items():
                name_files(self.database, INPUT, {slot: file.file}, file.label)
            # A new file's own statement counts, not what was stated of the lens before.
            known = {slot: v for slot, v in before.lens_known.items() if slot not in files}
            kept = {name: getattr(before, name) for name in VALUES} | {"lens_known": known}
            if "correspondences" in files or "correspondences" in drop:
                kept |= {name: [] for name in OF_TABLE}
            keep_values(self.database, INPUT, kept | values)
            self._check_inputs(self.inputs)

    def _stored(self, slot: Slot, label: str, content: bytes) -> given.GivenFile:
        """A file in the project, which is parsed before others have to wait for the act."""
        file = given.GivenFile(keep_file(self.database, content, label), label)
        try:
            (given.table_of if slot == "correspondences" else given.camera_of)(file)
        except StereocalError:
            with self.database.act() as db:
                free_content(db, file.file.sha256)
            raise
        return file

    def _check_inputs(self, inputs: Inputs) -> None:
        """Refuse inputs that cannot be used, as far as they are complete."""
        for what, value in (
            ("baseline", inputs.baseline_m),
            ("distance between the targets", inputs.target_distance_m),
        ):
            if value is not None:
                check_length(what, value)
        check_inputs(inputs)
        cameras = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
        if "correspondences" in inputs.files:
            file = self._file(inputs, "correspondences")
            rows = given.table_of(file).strict(file.label)
            if outside := points_outside(rows, *cameras):
                raise RefusedRowsError(f"{file.label}: ", outside, "with a point outside its image")
        self.dataset_of(inputs)

    def exchange_targets(self, frame: int) -> None:
        """Exchange A and B of a frame in the secondary image of the table, or take it back."""
        with self.database.act():
            exchanged = sorted({*self.inputs.exchanged} ^ {frame})
            keep_values(self.database, INPUT, {"exchanged": exchanged})

    def put_back(self, frames: Sequence[int]) -> None:
        """Use these frames of the table though they contradict the others, and only these."""
        keep_values(self.database, INPUT, {"put_back": sorted(frames)})

    def rename(self, name: str) -> None:
        """Call the project, and what is calibrated from now on, by this name."""
        keep_values(self.database, INPUT, {"name": name})

    @property
    def dataset(self) -> Dataset | None:
        """The data set, once everything has been given."""
        return self.dataset_of(self.inputs)

    def dataset_of(self, inputs: Inputs) -> Dataset | None:
        """The data set of a state of the inputs; None if something is missing."""
        if inputs.missing:
            return None
        return given.dataset_of(given.Whole(inputs, self.database))

    @property
    def table(self) -> tuple[str, bytes] | None:
        """Name and content of the table of points, once given."""
        inputs = self.inputs
        if "correspondences" not in inputs.files:
            return None
        file = self._file(inputs, "correspondences")
        return file.label, file.file.read_bytes()

    @property
    def cameras(self) -> tuple[Camera | None, Camera | None]:
        """The primary and the secondary camera, as far as they were given."""
        inputs = self.inputs
        return self._camera(inputs, "primary"), self._camera(inputs, "secondary")

    def _file(self, inputs: Inputs, slot: Slot) -> given.GivenFile:
        return given.file_of(inputs, slot, self.database)

    def _camera(self, inputs: Inputs, slot: Slot) -> Camera | None:
        return given.camera_of(self._file(inputs, slot)) if slot in inputs.files else None

    # Settings and results

    @property
    def settings(self) -> dict[str, Any]:
        """Values of the forms by name."""
        return values_of(self.database, SETTING)

    def keep_settings(self, values: Mapping[str, Any]) -> None:
        """Remember values of forms."""
        keep_values(self.database, SETTING, values)

    def keep_calibration(self, calibration: Calibration, inputs: Inputs) -> None:
        """Keep a finished result, made from `inputs`, in place of the last one.

        The inputs may have changed since, in another tab.

        Raises:
            StereocalError: a file of the inputs has gone meanwhile.
        """
        content = pack_calibration(calibration, dataclasses.asdict(inputs))
        files = {
            slot: StoredFile(digest, self.database) for slot, digest in inputs.files.items()
        }  # fmt: skip
        with self.database.act():
            put_files(self.database, CALIBRATED, files)
            keep_result(self.database, "calibration", content)

    @property
    def calibration(self) -> Calibration | None:
        """The last finished result, with the data it was made from; None before the first."""
        content = result_of(self.database, "calibration")
        if content is None:
            return None
        return given.calibration_of(given.Packed(content, self.database))

    def keep_evaluation(self, evaluation: Evaluation) -> None:
        """Keep a finished evaluation in place of the last one."""
        keep_result(self.database, "evaluation", pack_evaluation(evaluation))

    @property
    def evaluation(self) -> Evaluation | None:
        """The last finished evaluation; None before the first."""
        content = result_of(self.database, "evaluation")
        return (
            None if content is None else given.evaluation_of(given.Packed(content, self.database))
        )

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Take over a zip with a further data set.

        Raises:
            StereocalError: it cannot be used; the project is as it was.
        """
        parse_zip(content, label)
        with self.database.act():
            at = len(files_of(self.database, FURTHER))
            file = keep_file(self.database, content, label)
            name_files(self.database, FURTHER, {f"{at:06d}": file}, label)

    def drop_datasets(self) -> None:
        """Forget the further data sets, and free their room."""
        self.database.free(lambda _db: forget_files(self.database, FURTHER))

    @property
    def more_datasets(self) -> list[Dataset]:
        """The further data sets."""
        with self.database.reading():
            files, labels = files_of(self.database, FURTHER), about_files(self.database, FURTHER)
        return [
            given.further_of(given.GivenFile(file, str(labels[name])))
            for name, file in files.items()
        ]
