"""One piece of work on disk: inputs, settings, results. Knows no screen.

A project is a folder `<home>/projects/<32 hex digits>`:

- `project.json`: which input files are current, the measured lengths, the settings. It is replaced
  in one step, so that what it names is always a complete state.
- `inputs/<digest>-<name>`: the files as given, never changed once written.
- `calibration.json`: the last finished result with its settings and the inputs it was made from.
- `evaluation.npz`: what the last finished validation counted, with its settings.
- `photographs/`: see `project_photographs`; `lens/`: see `project_lens`.

The id is unguessable and is the only key to the folder.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from stereocal.calibrate import Calibration
from stereocal.calibration_files import pack_calibration, unpack_calibration
from stereocal.camera import Camera
from stereocal.dataset import Dataset, check_length, points_outside
from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.evaluation_files import Evaluation, pack_evaluation, unpack_evaluation
from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import parse_zip
from stereocal.store.folders import is_id, new_id, own_file, private_folder
from stereocal.writing import write_atomically

PROJECT_FORMAT = "stereocal-project/1"
Slot = Literal["primary", "secondary", "correspondences"]
SLOTS: tuple[Slot, ...] = ("primary", "secondary", "correspondences")
_WRITING = threading.Lock()
"""One change of a project at a time in this server; a change reads, edits and replaces."""


@dataclass(frozen=True)
class Inputs:
    """What a person has given so far; None where nothing was."""

    name: str = ""
    baseline_m: float | None = None
    target_distance_m: float | None = None
    baseline_sigma_m: float | None = None
    """As a data set states it; None where it states none."""
    target_distance_sigma_m: float | None = None
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Slot to the file's name below `inputs/`."""
    labels: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Slot to the name that the person's file had."""

    @property
    def missing(self) -> list[str]:
        """What is still needed, in words."""
        named = {
            "correspondences": "the table of points",
            "primary": "the primary camera's file",
            "secondary": "the secondary camera's file",
        }
        lacking = [words for slot, words in named.items() if slot not in self.files]
        lacking += ["the baseline"] * (self.baseline_m is None)
        lacking += ["the distance between the targets"] * (self.target_distance_m is None)
        return lacking


class Project:
    """An open project. Every change is on disk when its method returns.

    Raises:
        StereocalError: on `open`, an id that is none, or no such project.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def id(self) -> str:
        """32 hexadecimal digits."""
        return self.folder.name

    @classmethod
    def create(cls, home: Path) -> Project:
        """A new, empty project below `home`."""
        project = cls(private_folder(home / "projects") / new_id())
        project._write_state({"format": PROJECT_FORMAT, "inputs": {}, "settings": {}})
        return project

    @classmethod
    def open(cls, home: Path, project_id: str) -> Project:
        """The project of this id."""
        if not is_id(project_id):
            raise StereocalError("The address does not name a project.")
        project = cls(home / "projects" / project_id)
        if not (project.folder / "project.json").is_file():
            raise StereocalError("There is no project at this address, or it was removed.")
        project._read_state()
        return project

    # Inputs

    @property
    def inputs(self) -> Inputs:
        """What has been given so far."""
        try:
            return Inputs(**self._read_state()["inputs"])
        except (KeyError, TypeError) as error:
            raise StereocalError(f"The project's file is damaged ({error!r}).") from error

    def give(
        self, files: Mapping[Slot, tuple[str, bytes]], drop: Sequence[Slot] = (), **values: Any
    ) -> None:
        """Take over files (slot to name and content) and values in one step, or nothing.

        The state that results is checked as far as it is complete.

        Args:
            drop: slots to empty before.

        Raises:
            StereocalError: what was given cannot be used; the project is as it was.
        """
        with _WRITING:
            state = self._read_state()
            new = json.loads(json.dumps(state["inputs"]))
            new.update(values)
            for slot in drop:
                for kept in ("files", "labels"):
                    new.get(kept, {}).pop(slot, None)
            for slot, (label, content) in files.items():
                stored = f"{hashlib.sha256(content).hexdigest()[:20]}-{slot}"
                write_atomically(self.folder / "inputs" / stored, content)
                new.setdefault("files", {})[slot] = stored
                new.setdefault("labels", {})[slot] = label
            inputs = Inputs(**new)
            for what, value in (
                ("baseline", inputs.baseline_m),
                ("distance between the targets", inputs.target_distance_m),
            ):
                if value is not None:
                    check_length(what, value)
            cameras = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
            if "correspondences" in inputs.files:
                label = inputs.labels["correspondences"]
                rows = read_table(self._content(inputs, "correspondences"), label).strict(label)
                if outside := points_outside(rows, *cameras):
                    raise RefusedRowsError(f"{label}: ", outside, "with a point outside its image")
            if not inputs.missing:
                self._dataset(inputs)
            state["inputs"] = new
            self._write_state(state)

    def rename(self, name: str) -> None:
        """Call the project, and what is calibrated from now on, by this name."""
        self._change(lambda state: state["inputs"].update(name=name))

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
        return dict(self._read_state()["settings"])

    def keep_settings(self, values: Mapping[str, Any]) -> None:
        """Remember values of forms."""
        self._change(lambda state: state["settings"].update(values))

    def keep_calibration(self, calibration: Calibration, inputs: Inputs) -> None:
        """Keep a finished result, made from `inputs`, in place of the last one.

        The inputs may have changed since, in another tab.
        """
        content = pack_calibration(calibration, dataclasses.asdict(inputs))
        write_atomically(self.folder / "calibration.json", content)

    @property
    def calibration(self) -> Calibration | None:
        """The last finished result, with the data it was made from; None before the first."""
        path = self.folder / "calibration.json"
        if not path.is_file():
            return None
        return unpack_calibration(path.read_bytes(), lambda given: self._dataset(Inputs(**given)))

    def keep_evaluation(self, evaluation: Evaluation) -> None:
        """Keep a finished evaluation in place of the last one."""
        write_atomically(self.folder / "evaluation.npz", pack_evaluation(evaluation))

    @property
    def evaluation(self) -> Evaluation | None:
        """The last finished evaluation; None before the first."""
        path = self.folder / "evaluation.npz"
        return unpack_evaluation(path.read_bytes()) if path.is_file() else None

    # Further data sets, to validate on together

    def add_dataset(self, label: str, content: bytes) -> None:
        """Take over a zip with a further data set.

        Raises:
            StereocalError: it cannot be used; the project is as it was.
        """
        parse_zip(content, label)
        stored = f"{hashlib.sha256(content).hexdigest()[:20]}-dataset.zip"
        write_atomically(self.folder / "inputs" / stored, content)
        self._change(lambda state: state.setdefault("more", []).append([label, stored]))

    def drop_datasets(self) -> None:
        """Forget the further data sets."""
        self._change(lambda state: state.pop("more", None))

    @property
    def more_datasets(self) -> list[Dataset]:
        """The further data sets."""
        return [
            parse_zip(own_file(self.folder / "inputs", file).read_bytes(), label)
            for label, file in self._read_state().get("more", [])
        ]

    # On disk

    def _content(self, inputs: Inputs, slot: Slot) -> bytes:
        try:
            return own_file(self.folder / "inputs", inputs.files[slot]).read_bytes()
        except OSError as error:
            raise StereocalError(
                f"{inputs.labels[slot]} has gone from the project's folder; give it again."
            ) from error

    def _camera(self, inputs: Inputs, slot: Literal["primary", "secondary"]) -> Camera | None:
        if slot not in inputs.files:
            return None
        return read_camera(self._content(inputs, slot), inputs.labels[slot])

    def _dataset(self, inputs: Inputs) -> Dataset:
        primary, secondary = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
        if primary is None or secondary is None:
            raise StereocalError(f"Still missing: {', '.join(inputs.missing)}.")
        label = inputs.labels["correspondences"]
        table = read_table(self._content(inputs, "correspondences"), label)
        return Dataset(
            name=inputs.name or Path(label).stem,
            primary=primary,
            secondary=secondary,
            correspondences=table.strict(label),
            baseline_m=float(inputs.baseline_m or 0.0),
            target_distance_m=float(inputs.target_distance_m or 0.0),
            baseline_sigma_m=inputs.baseline_sigma_m,
            target_distance_sigma_m=inputs.target_distance_sigma_m,
        )

    def _read_state(self) -> dict[str, Any]:
        try:
            state = json.loads((self.folder / "project.json").read_bytes())
        except (OSError, ValueError) as error:
            raise StereocalError(f"The project's file cannot be read ({error}).") from error
        if not isinstance(state, dict) or state.get("format") != PROJECT_FORMAT:
            raise StereocalError("The project was written by another version of stereocal.")
        return state

    def _write_state(self, state: Mapping[str, Any]) -> None:
        text = json.dumps(state, indent=1, allow_nan=False)
        write_atomically(self.folder / "project.json", text.encode())

    def _change(self, edit: Callable[[dict[str, Any]], None]) -> None:
        with _WRITING:
            state = self._read_state()
            edit(state)
            self._write_state(state)
