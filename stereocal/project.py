"""One piece of work on disk: inputs, settings, results. Knows no screen.

A project is a folder `<home>/projects/<32 hex digits>`:

- `project.json`: which input files are current, the measured lengths, the settings. It is replaced
  in one step, so that what it names is always a complete state.
- `inputs/<digest>-<name>`: the files as given, never changed once written.
- `calibration.json`: the last finished result with its settings and the inputs it was made from.
- `evaluation.npz`: what the last finished validation counted, with its settings.
- `photographs/`: see `store.photographs`; `lens/`: see `store.lens`; `apply/`: `store.application`.

Each file is readable without the others. A change has the project for itself (`store.state`), also
among threads and processes: what two tabs change is both there.

The id is unguessable and is the only key to the folder.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Literal

from stereocal.calibration_files import pack_calibration, unpack_calibration
from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.evaluation_files import Evaluation, pack_evaluation, unpack_evaluation
from stereocal.inputs import Inputs, Slot, check_inputs, checked_inputs
from stereocal.refined.results import Calibration
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset, check_length, points_outside
from stereocal.store.folders import is_id, new_project_folder, own_file
from stereocal.store.room import check_room
from stereocal.store.state import PROJECT_FILE, StateFile, changing, read_if_there
from stereocal.store.unused import forget_files
from stereocal.system.atomic_files import write_all, write_atomically

PROJECT_FORMAT = "stereocal-project/1"
PATIENCE = 3
"""So often what is given is checked while others may change the project; then they wait."""
Beside = Callable[[dict[str, Any]], AbstractContextManager[object]]
_NO_FILES: Mapping[str, bytes] = {}


class Project:
    """An open project. Every change is on disk when its method returns.

    Raises:
        StereocalError: on `open`, an id that is none, or no such project.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._file = StateFile(
            folder, folder / PROJECT_FILE, PROJECT_FORMAT, _check, None, "The project's file",
            "what else it holds is still in its folder: put a copy of this file back, or give the "
            "inputs again in a new project",
        )  # fmt: skip

    @property
    def id(self) -> str:
        """32 hexadecimal digits."""
        return self.folder.name

    @classmethod
    def create(cls, home: Path) -> Project:
        """A new, empty project below `home`."""
        state = {"format": PROJECT_FORMAT, "inputs": {}, "settings": {}}
        return cls(new_project_folder(home, lambda folder: cls(folder)._file.write(state)))

    @classmethod
    def open(cls, home: Path, project_id: str) -> Project:
        """The project of this id."""
        if not is_id(project_id):
            raise StereocalError("The address does not name a project.")
        project = cls(home / "projects" / project_id)
        if not (project.folder / PROJECT_FILE).is_file():
            raise StereocalError("There is no project at this address, or it was removed.")
        project._file.read()
        return project

    # Inputs

    @property
    def inputs(self) -> Inputs:
        """What has been given so far."""
        return Inputs(**self._file.read()["inputs"])

    @property
    def times_given(self) -> int:
        """How often it was given a data set with photographs; `store.photographs` counts it."""
        return int(self._file.read().get("times_given", 0))

    def give(
        self,
        files: Mapping[Slot, tuple[str, bytes]],
        drop: Sequence[Slot] = (),
        beside: Beside = nullcontext,
        **values: Any,
    ) -> None:
        """Take over files (slot to name and content) and values in one step, or nothing.

        The state that results is checked as far as it is complete.

        Args:
            drop: slots to empty before.
            beside: entered with the content of `project.json`, which it may add to, before that is
                written, and left after; nobody else changes the project meanwhile.

        Raises:
            StereocalError: what was given cannot be used; the project is as it was.
        """
        if "correspondences" in files or "correspondences" in drop:
            values = {"exchanged": [], **values}
        named = {
            slot: f"{hashlib.sha256(content).hexdigest()[:20]}-{slot}"
            for slot, (_, content) in files.items()
        }
        fresh = {named[slot]: content for slot, (_, content) in files.items()}
        for patience in range(PATIENCE + 1):
            # Parsing takes long; so others may change the project meanwhile, and it is done again.
            with changing(self.folder) if patience == PATIENCE else nullcontext():
                before = self.inputs
                given: dict[str, str] = dict(before.files)
                labels = dict(before.labels)
                for slot in drop:
                    given.pop(slot, None)
                    labels.pop(slot, None)
                given.update({str(slot): name for slot, name in named.items()})
                labels.update({slot: label for slot, (label, _) in files.items()})
                # A new file's own statement counts, not what was stated of the lens before.
                known = {slot: v for slot, v in before.lens_known.items() if slot not in files}
                given_now = {"lens_known": known, **values}
                new = dataclasses.replace(before, files=given, labels=labels, **given_now)
                check_room(self.folder, sum(map(len, fresh.values())))
                self._check_inputs(new, fresh)
                if self._replace_inputs(before, new, fresh, beside):
                    return

    def _check_inputs(self, inputs: Inputs, fresh: Mapping[str, bytes]) -> None:
        """Refuse inputs that cannot be used, as far as they are complete."""
        for what, value in (
            ("baseline", inputs.baseline_m),
            ("distance between the targets", inputs.target_distance_m),
        ):
            if value is not None:
                check_length(what, value)
        cameras = self._camera(inputs, "primary", fresh), self._camera(inputs, "secondary", fresh)
        if "correspondences" in inputs.files:
            label = inputs.labels["correspondences"]
            rows = read_table(self._content(inputs, "correspondences", fresh), label).strict(label)
            if outside := points_outside(rows, *cameras):
                raise RefusedRowsError(f"{label}: ", outside, "with a point outside its image")
        if not inputs.missing:
            self._dataset(inputs, fresh)

    def _replace_inputs(
        self, before: Inputs, new: Inputs, fresh: Mapping[str, bytes], beside: Beside
    ) -> bool:
        """Put inputs and the files that they name on the disk; False if they are not as before."""
        with changing(self.folder):
            state = self._file.read()
            if Inputs(**state["inputs"]) != before:
                return False
            state["inputs"] = dataclasses.asdict(new)
            stored = {self.folder / "inputs" / name: content for name, content in fresh.items()}
            with beside(state):
                write_all({**stored, self._file.path: self._file.pack(state)})
            return True

    def exchange_targets(self, frame: int) -> None:
        """Exchange A and B of a frame in the secondary image of the table, or take it back.

        Raises:
            StereocalError: the project's folder cannot be used.
        """
        with self._file.change() as state:
            inputs = state["inputs"]
            inputs["exchanged"] = sorted({*inputs.get("exchanged", [])} ^ {frame})

    def rename(self, name: str) -> None:
        """Call the project, and what is calibrated from now on, by this name."""
        with self._file.change() as state:
            state["inputs"]["name"] = name

    @property
    def dataset(self) -> Dataset | None:
        """The data set, once everything has been given."""
        return self.dataset_of(self.inputs)

    def dataset_of(self, inputs: Inputs) -> Dataset | None:
        """The data set of a state of the inputs; None if something is missing."""
        return None if inputs.missing else self._dataset(inputs)

    @property
    def table(self) -> tuple[str, bytes] | None:
        """Name and content of the table of points, once given."""
        inputs = self.inputs
        if "correspondences" not in inputs.files:
            return None
        return inputs.labels["correspondences"], self._content(inputs, "correspondences")

    @property
    def cameras(self) -> tuple[Camera | None, Camera | None]:
        """The primary and the secondary camera, as far as they were given."""
        inputs = self.inputs
        return self._camera(inputs, "primary"), self._camera(inputs, "secondary")

    # Settings and results

    @property
    def settings(self) -> dict[str, Any]:
        """Values of the forms by name."""
        return dict(self._file.read()["settings"])

    def keep_settings(self, values: Mapping[str, Any]) -> None:
        """Remember values of forms."""
        with self._file.change() as state:
            state["settings"].update(values)

    def keep_calibration(self, calibration: Calibration, inputs: Inputs) -> None:
        """Keep a finished result, made from `inputs`, in place of the last one.

        The inputs may have changed since, in another tab.
        """
        content = pack_calibration(calibration, dataclasses.asdict(inputs))
        with changing(self.folder):
            write_atomically(self.folder / "calibration.json", content)

    @property
    def calibration(self) -> Calibration | None:
        """The last finished result, with the data it was made from; None before the first."""
        content = read_if_there(self.folder / "calibration.json", "calibrate again")
        if content is None:
            return None
        return unpack_calibration(content, lambda given: self._dataset(checked_inputs(given)))

    def keep_evaluation(self, evaluation: Evaluation) -> None:
        """Keep a finished evaluation in place of the last one."""
        content = pack_evaluation(evaluation)
        with changing(self.folder):
            write_atomically(self.folder / "evaluation.npz", content)

    @property
    def evaluation(self) -> Evaluation | None:
        """The last finished evaluation; None before the first."""
        content = read_if_there(self.folder / "evaluation.npz", "validate again")
        return None if content is None else unpack_evaluation(content)

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Take over a zip with a further data set.

        Raises:
            StereocalError: it cannot be used; the project is as it was.
        """
        check_room(self.folder, len(content))
        parse_zip(content, label)
        stored = f"{hashlib.sha256(content).hexdigest()[:20]}-dataset.zip"
        with changing(self.folder):
            state = self._file.read()
            state.setdefault("more", []).append([label, stored])
            file = self.folder / "inputs" / stored
            write_all({file: content, self._file.path: self._file.pack(state)})

    def drop_datasets(self) -> None:
        """Forget the further data sets, and free their room."""
        with self._file.change() as state:
            more = state.pop("more", [])
        forget_files(self.folder, [self.folder / "inputs" / file for _, file in more])

    @property
    def more_datasets(self) -> list[Dataset]:
        """The further data sets."""
        return [
            parse_zip(self._input(file, label), label, "brown")
            for label, file in self._file.read().get("more", [])
        ]

    # On disk

    def _content(self, inputs: Inputs, slot: Slot, fresh: Mapping[str, bytes] = _NO_FILES) -> bytes:
        stored = inputs.files[slot]
        return fresh[stored] if stored in fresh else self._input(stored, inputs.labels[slot])

    def _input(self, stored: str, label: str) -> bytes:
        try:
            return own_file(self.folder / "inputs", stored).read_bytes()
        except OSError as error:
            raise StereocalError(
                f"{label} has gone from the project's folder; give it again."
            ) from error

    def _camera(
        self,
        inputs: Inputs,
        slot: Literal["primary", "secondary"],
        fresh: Mapping[str, bytes] = _NO_FILES,
    ) -> Camera | None:
        if slot not in inputs.files:
            return None
        # A person was asked when the file was given.
        return read_camera(self._content(inputs, slot, fresh), inputs.labels[slot], "brown")

    def _dataset(self, inputs: Inputs, fresh: Mapping[str, bytes] = _NO_FILES) -> Dataset:
        primary = self._camera(inputs, "primary", fresh)
        secondary = self._camera(inputs, "secondary", fresh)
        if primary is None or secondary is None:
            raise StereocalError(f"Still missing: {', '.join(inputs.missing)}.")
        label = inputs.labels["correspondences"]
        table = read_table(self._content(inputs, "correspondences", fresh), label)
        dataset = Dataset(
            name=inputs.name or Path(label).stem,
            primary=inputs.known("primary", primary),
            secondary=inputs.known("secondary", secondary),
            correspondences=table.strict(label),
            baseline_m=float(inputs.baseline_m or 0.0),
            target_distance_m=float(inputs.target_distance_m or 0.0),
            baseline_sigma_m=inputs.baseline_sigma_m,
            target_distance_sigma_m=inputs.target_distance_sigma_m,
        )
        return dataset.with_targets_exchanged(inputs.exchanged) if inputs.exchanged else dataset


def _check(state: dict[str, Any]) -> None:
    """Look at all that is read of `project.json`."""
    check_inputs(Inputs(**state["inputs"]))
    dict(state["settings"])
    if not isinstance(state.get("times_given", 0), int):
        raise TypeError(state["times_given"])
    for label, file in state.get("more", []):
        if not isinstance(label, str) or not isinstance(file, str):
            raise TypeError(label)
