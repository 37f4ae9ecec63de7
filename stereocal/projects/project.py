"""One project on disk: data, settings, results.

The id is unguessable and is the only key to the project.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from stereocal.calibration.methods import Method
from stereocal.errors import DAMAGED, StereocalError
from stereocal.fit.results import Calibration
from stereocal.fit.start.pairs import pair_name
from stereocal.formats.evaluation_files import Evaluation, pack_evaluation, unpack_evaluation
from stereocal.projects.calibration_files import as_stored, pack_calibration, unpack_calibration
from stereocal.projects.contents import CALIBRATED, FURTHER, SETTING, VALIDATION
from stereocal.projects.data import ProjectData
from stereocal.projects.database import NOT_THERE
from stereocal.projects.files import Store, StoredFile, new_database, store_of
from stereocal.projects.inputs import Inputs, inputs_of
from stereocal.rig.pair import Pair
from stereocal.system import latest
from stereocal.system.latest import once
from stereocal.system.records import unpack
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.given import pair_in_zip
from stereocal.workflow.pair_run import PairRun

T = TypeVar("T")


class Project(ProjectData):
    """A project. Every change is on disk when its method returns."""

    @property
    def id(self) -> str:
        """32 hexadecimal digits."""
        return self.database.path.stem

    @property
    def results(self) -> Store:
        """Where the results are: those of a pair of a rig apart from those of other pairs."""
        return self.database if self.pair is None else self.database.of_pair(self.pair)

    def of_pair(self, name: str) -> "Project":
        """The project with the results of two of its cameras.

        Raises:
            StereocalError: there is no such pair.
        """
        if (recording := self.recording) is None:
            raise StereocalError("This project has no recording of several cameras: no pairs.")
        return Project(self.database, pair_name(recording.pair_named(name)))

    @property
    def whole(self) -> "Project":
        """The project with all its cameras."""
        return Project(self.database)

    @classmethod
    def create(cls, home: Path) -> "Project":
        """A new, empty project below `home`."""
        return cls(new_database(home, lambda _database: None))

    @classmethod
    def open(cls, home: Path, project_id: str) -> "Project":
        project = cls(store_of(home, project_id))
        if project.database.marker.exists():
            raise StereocalError(NOT_THERE)
        with project.database.reading():
            return project

    # Settings and results

    @property
    def settings(self) -> dict[str, Any]:
        return self.database.values(SETTING)

    def keep_settings(self, values: Mapping[str, Any]) -> None:
        self.database.keep_values(SETTING, values)

    def keep_calibration(self, calibration: Calibration, inputs: Inputs) -> None:
        """Replace the last result by one computed from `inputs`, which may have changed since."""
        calibration = as_stored(calibration)
        content = pack_calibration(calibration, dataclasses.asdict(inputs))
        files = {str(slot): file for slot in inputs.files if (file := self._file(inputs, slot))}
        with self.database.transaction():
            self.results.replace_files(CALIBRATED, files)
            digest = self.results.keep_result("calibration", content)
            self.results.keep_result("recommended", None)
        latest.keep("run", digest, PairRun.of(calibration))

    @property
    def answer(self) -> PairAnswer | None:
        """What the last finished result comes to, with its validation if it has one; None before
        the first."""
        with self.database.reading():
            run, evaluation = self.run, None
            if run is None:
                return None
            with suppress(StereocalError):  # a damaged one costs itself only
                evaluation = self.calibration_evaluation
            validation_digest = self.results.result_digest(VALIDATION) if evaluation else None
            key = f"{self.calibration_digest} {validation_digest}"
            return once("answer", key, lambda: PairAnswer(run, evaluation))

    @property
    def run(self) -> PairRun | None:
        """The run of the last finished result; None before the first."""

        def made_from(stated: Mapping[str, Any]) -> Pair:
            inputs = inputs_of(stated)
            if (dataset := self.dataset_of(inputs)) is None:
                raise ValueError(inputs)
            return dataset

        def unpacked(content: bytes) -> PairRun:
            return PairRun.of(unpack_calibration(content, made_from))

        return self._result("run", "calibration", unpacked)

    @property
    def calibration(self) -> Calibration | None:
        """The sets of the last finished result, with the data they were computed from."""
        run = self.run
        return None if run is None else run.calibration

    def _result(self, step: str, name: str, unpacked: Callable[[bytes], T]) -> T | None:
        with self.results.reading():
            digest = self.results.result_digest(name)
            if digest is None:
                return None
            return once(step, digest, lambda: unpacked(self.results.result(name) or b""))

    @property
    def calibration_digest(self) -> str | None:
        """SHA-256 of the last result as stored; None before the first. It tells whether a result is
        current; the object does not, which is another one once it is read again."""
        return self.results.result_digest("calibration")

    def keep_recommended(self, match_with: Method, measure_with: Method) -> None:
        """Store which sets the last result recommends."""
        self.results.keep_result("recommended", json.dumps([match_with, measure_with]).encode())

    @property
    def recommended(self) -> tuple[Method, Method] | None:
        """The sets to match and to measure with; None before the last result is validated."""
        content = self.results.result("recommended")
        try:
            return unpack(content or b"", tuple[Method, Method])
        except DAMAGED:  # a calibration stores it again
            return None

    def keep_evaluation(self, evaluation: Evaluation, of_calibration: bool = False) -> None:
        """Replace the last evaluation.

        Args:
            of_calibration: also the one whose figures the calibration's files contain.
        """
        content = pack_evaluation(evaluation)
        with self.database.transaction():
            digest = self.results.keep_result("evaluation", content)
            if of_calibration:
                self.results.keep_result(VALIDATION, content)
        latest.keep("validation", digest, evaluation)

    @property
    def evaluation(self) -> Evaluation | None:
        """The last evaluation, of whatever data and settings; None if there is none."""
        return self._result("validation", "evaluation", unpack_evaluation)

    @property
    def calibration_evaluation(self) -> Evaluation | None:
        """The evaluation of the last result's data with its settings, whose figures its files
        contain; None if it has none yet."""
        evaluation = self._result("validation", VALIDATION, unpack_evaluation)
        calibration = self.calibration
        if evaluation is None or calibration is None:
            return None
        # An evaluation states the number of frames to calibrate with in settings of its own.
        settings = dataclasses.replace(calibration.settings, calibration_frames=None)
        same = evaluation.settings.calibration == settings
        return evaluation if same and evaluation.is_of([calibration.dataset]) else None

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Add a zip with a further data set."""
        dataset = pair_in_zip(content, label)
        with self.database.transaction():
            number = len(self.database.files(FURTHER))
            file = self.database.give(FURTHER, f"{number:06d}", label, content)
        latest.keep("data set", _key(file), dataset)

    def drop_datasets(self) -> None:
        self.database.forget_files(FURTHER)

    @property
    def more_datasets(self) -> list[Pair]:
        files = self.database.files(FURTHER).values()
        return [once("data set", _key(file), partial(_parse_stored, file)) for file in files]


class ProjectPart:
    """What one page stores in a project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    def keep(self, name: str, content: bytes) -> StoredFile:
        """Store a photograph; `add` or `give` makes it the project's."""
        return self.database.keep_file(content, name)


def _key(file: StoredFile) -> str:
    """The key of a data set, which is named after its file."""
    return f"{file.sha256} {file.label}"


def _parse_stored(file: StoredFile) -> Pair:
    return pair_in_zip(file.read_bytes(), file.label, "brown")
