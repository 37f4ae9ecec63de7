"""One project on disk: inputs, settings, results.

The id is unguessable and is the only key to the project.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.errors import DAMAGED, RefusedRowsError, StereocalError
from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import Table, read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, pack_evaluation
from stereocal.projects import parsed_files
from stereocal.projects.calibration_files import as_stored, pack_calibration
from stereocal.projects.data_folder import new_database, store_of
from stereocal.projects.database import NOT_THERE
from stereocal.projects.files import PAIR, Store, StoredFile
from stereocal.projects.inputs import Inputs, Slot, check_inputs, checked_inputs
from stereocal.projects.sqlite_errors import DamagedError
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset, check_length, points_outside

INPUT, SETTING, FURTHER, CALIBRATED = "input", "setting", "dataset", "calibrated"
"""Parts of a project: inputs, form values, further data sets, the inputs of the last result."""
VALUES = tuple(
    each.name for each in dataclasses.fields(Inputs) if each.name not in ("files", "labels")
)
METHOD_OF: Mapping[str, Method] = {method: method for method in ALL_METHODS}
OF_TABLE = ("exchanged", "put_back", "left_out")
"""Corrections of frames, valid for one table of points."""


class Project:
    """A project. Every change is on disk when its method returns."""

    def __init__(self, database: Store) -> None:
        self.database = database

    @property
    def id(self) -> str:
        """32 hexadecimal digits."""
        return self.database.path.stem

    @property
    def pair(self) -> str | None:
        """Its name, if this is a pair of a rig; None for a project of its own."""
        return self.database.scope[len(PAIR) : -1] or None

    @property
    def whole(self) -> Project:
        """The project itself; of a pair, that of its rig."""
        return Project(dataclasses.replace(self.database, scope=""))

    @classmethod
    def create(cls, home: Path) -> Project:
        """A new, empty project below `home`."""
        return cls(new_database(home, lambda _database: None))

    @classmethod
    def open(cls, home: Path, project_id: str) -> Project:
        """The project of this id."""
        project = cls(store_of(home, project_id))
        if project.database.marker.exists():
            raise StereocalError(NOT_THERE)
        with project.database.reading():
            return project

    # Inputs

    @property
    def inputs(self) -> Inputs:
        """The inputs so far."""
        with self.database.reading():
            values = self.database.values(INPUT)
            files = self.database.files(INPUT)
        try:
            return checked_inputs(
                {
                    **{name: values[name] for name in VALUES if name in values},
                    "files": {slot: file.sha256 for slot, file in files.items()},
                    "labels": {slot: file.label for slot, file in files.items()},
                }
            )
        except DAMAGED as error:
            raise DamagedError("What was given to the project is damaged.") from error

    def give(
        self,
        files: Mapping[Slot, tuple[str, bytes]],
        drop: Sequence[Slot] = (),
        read: Mapping[Slot, Camera | Table] | None = None,
        **values: Any,
    ) -> None:
        """Store files (slot to name and content) and values in one transaction.

        Args:
            drop: slots to empty first.
            read: what was read from files already.

        Raises:
            StereocalError: the resulting inputs are invalid; the project is unchanged.
        """
        objects = read or {}
        stored: dict[str, StoredFile] = {
            slot: self._stored(slot, *file, objects.get(slot)) for slot, file in files.items()
        }
        with self.database.transaction():
            before = self.inputs
            self.database.forget_files(INPUT, [slot for slot in drop if slot not in files])
            self.database.name_files(INPUT, stored)
            # A new camera file replaces the stated uncertainty of its lens.
            known = {slot: v for slot, v in before.lens_known.items() if slot not in files}
            kept = {name: getattr(before, name) for name in VALUES} | {"lens_known": known}
            kept["planned"] = [name for name in before.planned if name not in values]
            if "correspondences" in files or "correspondences" in drop:
                kept |= {name: [] for name in OF_TABLE}
            self.database.keep_values(INPUT, kept | values)
            self._check_inputs(self.inputs)

    def _stored(
        self, slot: Slot, label: str, content: bytes, read: Camera | Table | None
    ) -> StoredFile:
        """Read and store a file, before the transaction that others wait for."""
        if read is None:
            is_table = slot == "correspondences"
            read = read_table(content, label) if is_table else read_camera(content, label, "brown")
        file = self.database.keep_file(content, label)
        parsed_files.keep(file, read)
        return file

    def _check_inputs(self, inputs: Inputs) -> None:
        """Check the inputs as far as they are complete."""
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
            rows = parsed_files.table_of(file).strict(file.label)
            if outside := points_outside(rows, *cameras):
                raise RefusedRowsError(f"{file.label}: ", outside, "with a point outside its image")
        self.dataset_of(inputs)

    def exchange_targets(self, frame: int) -> None:
        """Exchange A and B of a frame in the secondary image of the table, or undo that."""
        with self.database.transaction():
            exchanged = sorted({*self.inputs.exchanged} ^ {frame})
            self.database.keep_values(INPUT, {"exchanged": exchanged})

    def put_back(self, frames: Sequence[int]) -> None:
        """Keep exactly these of the frames that contradict the others."""
        self.database.keep_values(INPUT, {"put_back": sorted(frames)})

    def leave_out(self, frame: int) -> None:
        """Leave a frame out."""
        inputs = self.inputs
        given = {"put_back": {*inputs.put_back} - {frame}, "left_out": {*inputs.left_out, frame}}
        self.database.keep_values(INPUT, {name: sorted(frames) for name, frames in given.items()})

    def take_in(self, frame: int) -> None:
        """Use a frame that the user or the screening left out."""
        inputs = self.inputs
        given: dict[str, list[int]] = {"left_out": sorted({*inputs.left_out} - {frame})}
        if frame not in inputs.left_out:
            given["put_back"] = sorted({*inputs.put_back, frame})
        self.database.keep_values(INPUT, given)

    def take_planned(self) -> None:
        """Take the planned lengths as measured."""
        self.database.keep_values(INPUT, {"planned": []})

    def rename(self, name: str) -> None:
        """Rename the project; later calibrations use the name."""
        self.database.keep_values(INPUT, {"name": name})

    @property
    def dataset(self) -> Dataset | None:
        """The data set; None if an input is missing."""
        return self.dataset_of(self.inputs)

    def dataset_of(self, inputs: Inputs) -> Dataset | None:
        """The data set of these inputs; None if one is missing."""
        if inputs.missing:
            return None
        return parsed_files.dataset_of(inputs, self.database)

    @property
    def table(self) -> tuple[str, bytes] | None:
        """Name and content of the table of points, if there is one."""
        inputs = self.inputs
        if "correspondences" not in inputs.files:
            return None
        file = self._file(inputs, "correspondences")
        return file.label, file.read_bytes()

    @property
    def cameras(self) -> tuple[Camera | None, Camera | None]:
        """The primary and the secondary camera; None for a missing one."""
        inputs = self.inputs
        return self._camera(inputs, "primary"), self._camera(inputs, "secondary")

    def _file(self, inputs: Inputs, slot: Slot) -> StoredFile:
        return parsed_files.file_of(inputs, slot, self.database)

    def _camera(self, inputs: Inputs, slot: Slot) -> Camera | None:
        return parsed_files.camera_of(self._file(inputs, slot)) if slot in inputs.files else None

    # Settings and results

    @property
    def settings(self) -> dict[str, Any]:
        """Values of forms by name."""
        return self.database.values(SETTING)

    def keep_settings(self, values: Mapping[str, Any]) -> None:
        """Store values of forms."""
        self.database.keep_values(SETTING, values)

    def keep_calibration(self, calibration: Calibration, inputs: Inputs) -> None:
        """Replace the last result by one computed from `inputs`, which may have changed since.

        Raises:
            StereocalError: a file of the inputs was deleted meanwhile.
        """
        calibration = as_stored(calibration)
        content = pack_calibration(calibration, dataclasses.asdict(inputs))
        files: dict[str, StoredFile] = {slot: self._file(inputs, slot) for slot in inputs.files}
        with self.database.transaction():
            self.database.replace_files(CALIBRATED, files)
            digest = self.database.keep_result("calibration", content)
            self.database.keep_result("recommended", None)
        parsed_files.CALIBRATIONS.keep(digest, calibration)

    @property
    def calibration(self) -> Calibration | None:
        """The last finished result, with the data it was computed from; None before the first."""
        return parsed_files.calibration_of(self.database)

    @property
    def calibration_digest(self) -> str | None:
        """SHA-256 of the last result as stored; None before the first.

        It tells whether a result is current. The object does not: the same content is another one
        once the cache of `calibration` has dropped it.
        """
        return self.database.result_digest("calibration")

    def keep_recommended(self, match_with: Method, measure_with: Method) -> None:
        """Store which sets the last result recommends."""
        content = json.dumps([match_with, measure_with]).encode()
        self.database.keep_result("recommended", content)

    @property
    def recommended(self) -> tuple[Method, Method] | None:
        """The sets to match and to measure with; None before the last result is validated."""
        content = self.database.result("recommended")
        try:
            match, measure = (METHOD_OF[name] for name in json.loads(content or b"[]"))
        except DAMAGED:  # a calibration stores it again
            return None
        return match, measure

    def keep_evaluation(self, evaluation: Evaluation, of_calibration: bool = False) -> None:
        """Replace the last evaluation.

        Args:
            of_calibration: also the one whose figures the calibration's files contain.
        """
        content = pack_evaluation(evaluation)
        with self.database.transaction():
            digest = self.database.keep_result("evaluation", content)
            if of_calibration:
                self.database.keep_result("calibration_evaluation", content)
        parsed_files.EVALUATIONS.keep(digest, evaluation)

    @property
    def evaluation(self) -> Evaluation | None:
        """The last finished evaluation; None before the first."""
        return parsed_files.evaluation_of(self.database, "evaluation")

    @property
    def calibration_evaluation(self) -> Evaluation | None:
        """The evaluation made with the last result; None if it has none yet."""
        found = parsed_files.evaluation_of(self.database, "calibration_evaluation")
        calibration = self.calibration
        if found is None or calibration is None:
            return None
        settings = dataclasses.replace(calibration.settings, calibration_frames=None)
        same = found.settings.calibration == settings
        return found if same and list(found.sha256) == [calibration.dataset.sha256] else None

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Add a zip with a further data set.

        Raises:
            StereocalError: it is invalid; the project is unchanged.
        """
        dataset = parse_zip(content, label)
        with self.database.transaction():
            at = len(self.database.files(FURTHER))
            file = self.database.keep_file(content, label)
            self.database.name_files(FURTHER, {f"{at:06d}": file})
        parsed_files.keep(file, dataset)

    def drop_datasets(self) -> None:
        """Delete the further data sets."""
        with self.database.freeing():
            self.database.forget_files(FURTHER)

    @property
    def more_datasets(self) -> list[Dataset]:
        """The further data sets."""
        return [parsed_files.further_of(file) for file in self.database.files(FURTHER).values()]


class ProjectPart:
    """What one page stores in a project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    def keep(self, name: str, content: bytes) -> StoredFile:
        """Store a photograph; `add` or `give` makes it the project's."""
        return self.database.keep_file(content, name)
