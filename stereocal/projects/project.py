"""One project on disk: inputs, settings, results.

The id is unguessable and is the only key to the project. Files and results are kept in memory as
objects by the digests of their content: what was read at the door, or has just been computed, is
not read again.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from stereocal.calibration.methods import Method
from stereocal.errors import DAMAGED, StereocalError, damaged
from stereocal.fit.results import Calibration
from stereocal.formats.camera_file import read_camera, write_camera
from stereocal.formats.correspondences_csv import Table, read_table, write_table
from stereocal.formats.dataset_description import TABLE
from stereocal.formats.evaluation_files import Evaluation, pack_evaluation, unpack_evaluation
from stereocal.projects.calibration_files import as_stored, pack_calibration, unpack_calibration
from stereocal.projects.contents import CALIBRATED, FURTHER, INPUT, SETTING, VALIDATION, VALUES
from stereocal.projects.database import NOT_THERE, DamagedError
from stereocal.projects.files import PAIR, Store, StoredFile, new_database, store_of
from stereocal.projects.inputs import LENGTHS, Inputs, Slot
from stereocal.rig.camera import Camera
from stereocal.rig.correspondences import Correspondences, refuse_points_outside
from stereocal.rig.measured_lengths import check_length
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.latest import Latest
from stereocal.system.names import label_of
from stereocal.system.records import of_plain, unpack
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.given import pair_in_zip
from stereocal.workflow.pair_run import PairRun

T = TypeVar("T")
NAMES: dict[Slot, str] = {
    "primary": "primary.json",
    "secondary": "secondary.json",
    "correspondences": TABLE,
}
"""Slots, and the names of their files."""
OF_TABLE = ("exchanged", "put_back", "left_out")
"""Corrections of frames, valid for one table of points."""
KEPT: dict[type, Latest[Any]] = {
    kind: Latest(most)
    for kind, most in (
        *((Camera, 64), (Table, 8), (Pair, 32), (Recording, 8)),
        *((PairRun, 64), (PairAnswer, 64), (Evaluation, 8)),
    )
}
"""In memory, by the digests of the contents."""


def as_read(content: bytes, read: Camera | Table) -> bytes:
    """The content of a file from which `read` was read: no project reads it again."""
    KEPT[type(read)].keep(hashlib.sha256(content).hexdigest(), read)
    return content


def packed_table(rows: Correspondences) -> bytes:
    """The file of a table of points, which is not read again."""
    return as_read(write_table(rows), Table(rows, []))


def packed_files(dataset: Pair) -> dict[Slot, bytes]:
    """The files of a data set, which are not read again."""
    return {
        "primary": as_read(write_camera(dataset.primary), dataset.primary),
        "secondary": as_read(write_camera(dataset.secondary), dataset.secondary),
        "correspondences": packed_table(dataset.correspondences),
    }


def stated_in(dataset: Pair) -> dict[str, Any]:
    """What a data set states beside its files, as values of the inputs."""
    free = dataset.baseline_is_free
    return {
        "name": dataset.name,
        "baseline_m": None if dataset.baseline_is_to_be_found else dataset.baseline_m,
        "baseline_free": free,
        "baseline_sigma_m": None if free else dataset.baseline_sigma_m,
        "target_distance_m": dataset.target_distance_m,
        "target_distance_sigma_m": dataset.target_distance_sigma_m,
        "start_frame": dataset.start_frame,
        "step_notes": [*dataset.recording.step_notes],
    }


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
    def whole(self) -> "Project":
        """The project itself; of a pair, that of its rig."""
        return Project(dataclasses.replace(self.database, scope=""))

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

    # Inputs

    @property
    def inputs(self) -> Inputs:
        """The inputs so far."""
        with self.database.reading():
            values, files = self.database.values(INPUT), self.database.files(INPUT)
        stored = {name: values[name] for name in VALUES if name in values}
        stored["files"] = {slot: file.sha256 for slot, file in files.items()}
        stored["labels"] = {slot: file.label for slot, file in files.items()}
        with damaged("What was given to the project is damaged.", DamagedError):
            return of_plain(stored, Inputs)

    def give(
        self, files: Mapping[Slot, tuple[str, bytes]], drop: Sequence[Slot] = (), **values: Any
    ) -> None:
        """Store files (slot to name and content) and values in one transaction; inputs that would
        be invalid are refused, and the project is unchanged.

        Args:
            drop: slots to empty first.
        """
        stored: dict[str, StoredFile] = {}
        for slot, (label, content) in files.items():  # before the transaction: others wait for it
            digest = hashlib.sha256(content).hexdigest()
            if slot == "correspondences":
                once(Table, digest, partial(read_table, content, label))
            else:
                once(Camera, digest, partial(read_camera, content, label, "brown"))
            stored[slot] = self.database.keep_file(content, label)
        with self.database.transaction():
            before = self.inputs
            self.database.forget_files(INPUT, [slot for slot in drop if slot not in files])
            self.database.name_files(INPUT, stored)
            # A new camera file replaces the stated uncertainty of its lens.
            known = {slot: v for slot, v in before.lens_known.items() if slot not in files}
            kept = {name: getattr(before, name) for name in VALUES} | {"lens_known": known}
            kept["planned"] = [name for name in before.planned if name not in values]
            if "correspondences" in files or "correspondences" in drop:
                kept |= {name: [] for name in OF_TABLE} | {"start_frame": 0, "step_notes": []}
            self.database.keep_values(INPUT, kept | values)
            self._check(self.inputs)

    def _check(self, inputs: Inputs) -> None:
        """Check the inputs as far as they are complete."""
        for name, words in LENGTHS.items():
            if (metres := getattr(inputs, name)) is not None:
                check_length(words.removeprefix("the "), metres)
        cameras = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
        file = self._file(inputs, "correspondences")
        if file:
            refuse_points_outside(f"{file.label}: ", _rows(file), *cameras)
        self.dataset_of(inputs)

    def exchange_targets(self, frame: int) -> None:
        """Exchange A and B of a frame in the secondary image of the table, or undo that."""
        with self.database.transaction():
            self._keep_frames(exchanged={*self.inputs.exchanged} ^ {frame})

    def put_back(self, frames: Sequence[int]) -> None:
        """Keep exactly these of the frames that contradict the others."""
        self._keep_frames(put_back=frames)

    def leave_out(self, frame: int) -> None:
        with self.database.transaction():
            back, out = {*self.inputs.put_back}, {*self.inputs.left_out}
            self._keep_frames(put_back=back - {frame}, left_out=out | {frame})

    def take_in(self, frame: int) -> None:
        """Use a frame that the user or the screening left out."""
        with self.database.transaction():
            back, out = {*self.inputs.put_back}, {*self.inputs.left_out}
            self._keep_frames(put_back=back | ({frame} - out), left_out=out - {frame})

    def _keep_frames(self, **frames: Iterable[int]) -> None:
        self.database.keep_values(INPUT, {name: sorted(own) for name, own in frames.items()})

    def take_planned(self) -> None:
        self.database.keep_values(INPUT, {"planned": []})

    def rename(self, name: str) -> None:
        """Rename the project; later calibrations use the name."""
        self.database.keep_values(INPUT, {"name": label_of(name)})

    @property
    def dataset(self) -> Pair | None:
        """The data set; None if an input is missing."""
        return self.dataset_of(self.inputs)

    def dataset_of(self, inputs: Inputs) -> Pair | None:
        """The data set of these inputs; None if one is missing."""

        def made() -> Pair:
            primary, secondary = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
            file = self._file(inputs, "correspondences")
            assert primary and secondary and file
            return inputs.dataset(Path(file.label).stem, primary, secondary, _rows(file))

        key = json.dumps(dataclasses.asdict(inputs), sort_keys=True)
        return None if inputs.missing else once(Pair, key, made)

    @property
    def table(self) -> tuple[str, bytes] | None:
        """Name and content of the table of points, if there is one."""
        file = self._file(self.inputs, "correspondences")
        return None if file is None else (file.label, file.read_bytes())

    @property
    def cameras(self) -> tuple[Camera | None, Camera | None]:
        """The primary and the secondary camera; None for a missing one."""
        inputs = self.inputs
        return self._camera(inputs, "primary"), self._camera(inputs, "secondary")

    def _file(self, inputs: Inputs, slot: Slot) -> StoredFile | None:
        if slot not in inputs.files:
            return None
        return StoredFile(inputs.files[slot], self.database, inputs.labels[slot])

    def _camera(self, inputs: Inputs, slot: Slot) -> Camera | None:
        # The lens model was settled when it was uploaded.
        file = self._file(inputs, slot)
        if file is None:
            return None
        return once(
            Camera, file.sha256, lambda: read_camera(file.read_bytes(), file.label, "brown")
        )

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
            self.database.replace_files(CALIBRATED, files)
            digest = self.database.keep_result("calibration", content)
            self.database.keep_result("recommended", None)
        KEPT[PairRun].keep(digest, PairRun.of(calibration))

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
            known = self.database.result_digest(VALIDATION) if evaluation else None
            key = f"{self.calibration_digest} {known}"
            return once(PairAnswer, key, lambda: PairAnswer(run, evaluation))

    @property
    def run(self) -> PairRun | None:
        """The run of the last finished result; None before the first."""

        def made_from(stated: Mapping[str, Any]) -> Pair:
            inputs = of_plain(stated, Inputs)
            if (dataset := self.dataset_of(inputs)) is None:
                raise ValueError(inputs)
            return dataset

        def unpacked(content: bytes) -> PairRun:
            return PairRun.of(unpack_calibration(content, made_from))

        return self._result(PairRun, "calibration", unpacked)

    @property
    def calibration(self) -> Calibration | None:
        """The sets of the last finished result, with the data they were computed from."""
        run = self.run
        return None if run is None else run.calibration

    def _result(self, kind: type[T], name: str, unpacked: Callable[[bytes], T]) -> T | None:
        with self.database.reading():
            digest = self.database.result_digest(name)
            if digest is None:
                return None
            return once(kind, digest, lambda: unpacked(self.database.result(name) or b""))

    @property
    def calibration_digest(self) -> str | None:
        """SHA-256 of the last result as stored; None before the first. It tells whether a result is
        current; the object does not, which is another one once `KEPT` has dropped it."""
        return self.database.result_digest("calibration")

    def keep_recommended(self, match_with: Method, measure_with: Method) -> None:
        """Store which sets the last result recommends."""
        self.database.keep_result("recommended", json.dumps([match_with, measure_with]).encode())

    @property
    def recommended(self) -> tuple[Method, Method] | None:
        """The sets to match and to measure with; None before the last result is validated."""
        content = self.database.result("recommended")
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
            digest = self.database.keep_result("evaluation", content)
            if of_calibration:
                self.database.keep_result(VALIDATION, content)
        KEPT[Evaluation].keep(digest, evaluation)

    @property
    def evaluation(self) -> Evaluation | None:
        return self._result(Evaluation, "evaluation", unpack_evaluation)

    @property
    def calibration_evaluation(self) -> Evaluation | None:
        """The evaluation made with the last result; None if it has none yet."""
        found = self._result(Evaluation, VALIDATION, unpack_evaluation)
        calibration = self.calibration
        if found is None or calibration is None:
            return None
        settings = dataclasses.replace(calibration.settings, calibration_frames=None)
        same = found.settings.calibration == settings
        return found if same and found.is_of([calibration.dataset]) else None

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Add a zip with a further data set."""
        dataset = pair_in_zip(content, label)
        with self.database.transaction():
            at = len(self.database.files(FURTHER))
            file = self.database.give(FURTHER, f"{at:06d}", label, content)
        KEPT[Pair].keep(_key(file), dataset)

    def drop_datasets(self) -> None:
        self.database.forget_files(FURTHER)

    @property
    def more_datasets(self) -> list[Pair]:
        files = self.database.files(FURTHER).values()
        return [once(Pair, _key(file), partial(_parse_stored, file)) for file in files]


class ProjectPart:
    """What one page stores in a project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    def keep(self, name: str, content: bytes) -> StoredFile:
        """Store a photograph; `add` or `give` makes it the project's."""
        return self.database.keep_file(content, name)


def once(kind: type[T], key: str, make: Callable[[], T]) -> T:
    found: T = KEPT[kind].once(key, make)
    return found


def _key(file: StoredFile) -> str:
    """The key of a data set, which is named after its file."""
    return f"{file.sha256} {file.label}"


def _parse_stored(file: StoredFile) -> Pair:
    return pair_in_zip(file.read_bytes(), file.label, "brown")


def _rows(file: StoredFile) -> Correspondences:
    """The rows of a table, all of which must be valid."""
    table = once(Table, file.sha256, lambda: read_table(file.read_bytes(), file.label))
    return table.strict(file.label)
