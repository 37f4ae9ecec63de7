"""The data of a project: what was given, stated and corrected, of two cameras or more."""

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.errors import damaged, naming
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.readings.outside import causes_named
from stereocal.fit.rig_file import RIG, RigFile
from stereocal.fit.start.pairs import pair_name
from stereocal.fit.timing.to_calibrate import in_step
from stereocal.formats.camera_file import read_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_description import DESCRIPTION, find_description
from stereocal.formats.dataset_files import parse_recording
from stereocal.projects.contents import BAR, INPUT, RECORDING, RIG_FILES, VALIDATION, VALUES
from stereocal.projects.database import DamagedError
from stereocal.projects.files import Store, StoredFile
from stereocal.projects.inputs import LENGTHS, Inputs, Slot, inputs_of
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import Correspondences, refuse_points_outside
from stereocal.rig.measured_lengths import check_length
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.window import StatedWindow
from stereocal.system import latest
from stereocal.system.latest import once
from stereocal.system.made_from import Parts, digest_of
from stereocal.system.names import label_of
from stereocal.workflow.pair_of_rig import data_of_pair, settings_of_pair

OF_TABLE = ("exchanged", "put_back", "left_out", "start_frame", "step_notes")
"""Inputs that are valid for one table of points."""
LENGTHS_OF_ALL = (
    *("baselines_m", "baseline_sigma_m", "baseline_free", "target_distance_sigma_m"),
    "windows",
)
"""What is stated of the lengths and windows of three cameras and more."""
RESULTS = ("calibration", "recommended", "evaluation", VALIDATION)
"""What is computed of the data of two cameras."""
SOURCE = "the recording of this project"
MADE_FROM = "made_from"
PAIRS = "pairs.zip"
"""The parameter files of all pairs of a rig."""


class ProjectData:
    """What was given. Every change is on disk when its method returns.

    Two cameras are given as three files (`Slot`), three and more as the files of one data set. What
    is about two images of these asks for a pair of them: then `dataset` is that pair's.
    """

    def __init__(self, database: Store, pair: str | None = None) -> None:
        self.database = database
        self.pair = pair
        """The name of the pair, such as `left-right`; None: of all cameras, or of the only two."""

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
            return inputs_of(stored)

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
                once("table", digest, partial(read_table, content, label))
            else:
                once("camera", digest, partial(read_camera, content, label, "brown"))
            stored[slot] = self.database.keep_file(content, label)
        with self.database.transaction():
            present = self.inputs
            self.database.forget_files(INPUT, [slot for slot in drop if slot not in files])
            self.database.name_files(INPUT, stored)
            # A new camera file replaces the stated uncertainty of its lens.
            known = {slot: v for slot, v in present.lens_known.items() if slot not in files}
            kept = {name: getattr(present, name) for name in VALUES} | {"lens_known": known}
            kept["planned"] = [name for name in present.planned if name not in values]
            if "correspondences" in files or "correspondences" in drop:
                kept |= _unstated(*OF_TABLE)
            self.database.keep_values(INPUT, kept | values)
            self._check(self.inputs)

    @property
    def holds_recording(self) -> bool:
        """Whether the data are those of three cameras and more."""
        return bool(self.database.files(RECORDING))

    @property
    def is_rig(self) -> bool:
        """Whether all cameras are calibrated together: three and more, or two behind a window whose
        data are complete."""
        return self.holds_recording or self._are_two_behind_windows(self.inputs)

    def _are_two_behind_windows(self, inputs: Inputs) -> bool:
        if self.holds_recording or inputs.missing:
            return False
        known = (self._camera(inputs, "primary"), self._camera(inputs, "secondary"))
        return bool(inputs.windows) or any(it is not None and it.window for it in known)

    @property
    def windows(self) -> tuple[StatedWindow, ...]:
        """The windows that were stated, here or by the files of three cameras and more."""
        inputs, as_given = self.inputs, self.recording_as_given
        if inputs.windows is None and as_given is not None:
            return as_given.windows
        return inputs.stated_windows

    def is_given(self, files: Mapping[str, bytes]) -> bool:
        """Whether the data of three cameras and more are those of these files."""
        digests = sorted(hashlib.sha256(content).hexdigest() for content in files.values())
        return digests == sorted(self._given_digest.split())

    def give_recording(
        self, recording: Recording, files: Mapping[str, bytes], same_lengths: bool = False
    ) -> None:
        """Store a recording of three cameras and more, and its files, instead of what was there;
        corrections and results go.

        Args:
            same_lengths: whether what is stated of the lengths is of this one too.
        """
        stored = {name: self.database.keep_file(content, name) for name, content in files.items()}
        if stored == self.database.files(RECORDING):
            return
        inputs = self.inputs
        values = _unstated(*LENGTHS_OF_ALL, *OF_TABLE)
        if same_lengths:
            values |= {name: getattr(inputs, name) for name in LENGTHS_OF_ALL}
            pairs = {pair_name(pair) for pair in permutations(recording.cameras, 2)}
            values["baselines_m"] = {n: m for n, m in inputs.baselines_m.items() if n in pairs}
        with self.database.transaction():
            self.database.forget_files(INPUT)
            self.database.replace_files(RECORDING, stored)
            self._forget_results()
            self.database.keep_values(INPUT, {**values, "name": recording.name})
        latest.keep("recording", self._given_digest, recording)

    def forget_recording(self) -> None:
        """Delete the data of three cameras and more, for those of two."""
        with self.database.transaction():
            if self.holds_recording:
                self.database.forget_files(RECORDING)
                self._forget_results()
                self.database.keep_values(INPUT, _unstated(*LENGTHS_OF_ALL))

    def _forget_results(self) -> None:
        self.database.forget_files(RIG_FILES)
        self.database.forget_pairs()
        for kind in RESULTS:
            self.database.keep_result(kind, None)

    def _check(self, inputs: Inputs) -> None:
        """Check the inputs as far as they are complete."""
        for name, words in LENGTHS.items():
            if (metres := getattr(inputs, name)) is not None:
                check_length(words.removeprefix("the "), metres)
        cameras = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
        file = self._file(inputs, "correspondences")
        if file:
            _refuse_points_outside(file, inputs, *cameras)
        self.dataset_of(inputs)

    def exchange_targets(self, frame: int, camera: str = CAMERAS[1]) -> None:
        """Exchange A and B of a frame in the image of a camera, or undo that."""
        with self.database.transaction():
            by_camera = self.inputs.exchanged
            changed = {**by_camera, camera: sorted({*by_camera.get(camera, ())} ^ {frame})}
            exchanged = {name: frames for name, frames in changed.items() if frames}
            self.database.keep_values(INPUT, {"exchanged": exchanged})

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
        self.database.keep_values(INPUT, {name: sorted(group) for name, group in frames.items()})

    def take_planned(self) -> None:
        self.database.keep_values(INPUT, {"planned": []})

    def rename(self, name: str) -> None:
        """Rename the project; later calibrations use the name."""
        self.database.keep_values(INPUT, {"name": label_of(name)})

    @property
    def dataset(self) -> Pair | None:
        """The data of the pair, or of two cameras; None if an input is missing."""
        return self.dataset_of(self.inputs)

    def dataset_of(self, inputs: Inputs) -> Pair | None:
        """The data of these inputs; None if one is missing."""
        of_pair = self.pair is not None and self._are_two_behind_windows(inputs)
        if self.holds_recording or of_pair:
            return self._dataset_of_pair(inputs)
        return self._dataset_of_two(inputs)

    def _dataset_of_two(self, inputs: Inputs) -> Pair | None:
        def made() -> Pair:
            primary, secondary = self._camera(inputs, "primary"), self._camera(inputs, "secondary")
            file = self._file(inputs, "correspondences")
            assert primary and secondary and file
            return inputs.dataset(Path(file.label).stem, primary, secondary, _rows(file))

        key = json.dumps(dataclasses.asdict(inputs), sort_keys=True)
        return None if inputs.missing else once("data set", key, made)

    @property
    def given_digest(self) -> str:
        """Identifies what was given, stated and corrected, settings apart."""
        named: dict[str, dict[str, str]] = {}
        for part in (RECORDING, BAR):
            files = self.database.files(part)
            named[part] = {name: file.sha256 for name, file in files.items()}
        return digest_of([dataclasses.asdict(self.inputs), named])

    # Three cameras and more

    @property
    def recording(self) -> Recording | None:
        """The data of all cameras, with what was stated and corrected; None if some are missing."""
        return self.recording_of(self.inputs)

    def recording_of(self, inputs: Inputs) -> Recording | None:
        """The data of all cameras with these inputs; None if some are missing."""
        if (recording := self.recording_as_given) is None:
            dataset = self._dataset_of_two(inputs)
            return None if dataset is None else dataset.recording
        return once("recording", self._key_of(inputs), lambda: inputs.applied_to(recording))

    @property
    def recording_in_use(self) -> Recording | None:
        """The data of all cameras without the frames that the user leaves out."""
        inputs = self.inputs
        if (recording := self.recording_of(inputs)) is None or not inputs.left_out:
            return recording
        whole, key = recording, f"without {inputs.left_out} {self._key_of(inputs)}"
        return once("recording", key, lambda: whole.where(~np.isin(whole.frame, inputs.left_out)))

    @property
    def recording_as_given(self) -> Recording | None:
        """The data of three cameras and more as their files say; None of two."""

        def parsed() -> Recording:
            files = self.database.files(RECORDING).items()
            contents = {name: file.read_bytes() for name, file in files}
            # The lens models were settled when it was given.
            recording = parse_recording(contents, SOURCE, lens_model="brown")
            with naming(SOURCE):
                return in_step(recording)

        return once("recording", self._given_digest, parsed) if self.holds_recording else None

    @property
    def _given_digest(self) -> str:
        return " ".join(file.sha256 for file in self.database.files(RECORDING).values())

    def _key_of(self, inputs: Inputs) -> str:
        """Identifies the data of three cameras and more."""
        return f"{self._given_digest} {json.dumps(dataclasses.asdict(inputs), sort_keys=True)}"

    @property
    def camera_count(self) -> int:
        """How many cameras the data have, without reading their points."""
        files = self.database.files(RECORDING).items()
        described = {name: file.read_bytes() for name, file in files if name.endswith(DESCRIPTION)}
        return len(find_description(described, SOURCE).entries["cameras"]) if described else 2

    def keep_rig(self, rig: str, pairs: bytes, made_from: Parts) -> None:
        """Store `rig.json` and the zip of its pairs' files; what its pairs had before goes.

        Args:
            made_from: as of the run.
        """
        files = {RIG: rig.encode(), PAIRS: pairs}
        kept = {
            name: dataclasses.replace(
                self.database.keep_file(content, name),
                about={"label": name, MADE_FROM: {**made_from}},
            )
            for name, content in files.items()
        }
        with self.database.transaction():
            self.database.replace_files(RIG_FILES, kept)
            self.database.forget_pairs()

    @property
    def rig(self) -> RigFile | None:
        """All cameras, calibrated together; None before that."""
        if (file := self.rig_file) is None:
            return None
        return once("rig", file.sha256, lambda: RigFile.loads(file.read_bytes().decode()))

    @property
    def rig_file(self) -> StoredFile | None:
        """The stored `rig.json`."""
        return self.database.file(RIG_FILES, RIG)

    @property
    def rig_made_from(self) -> Parts:
        """What the rig was made from; empty of one that an earlier version stored."""
        about = None if (file := self.rig_file) is None else file.about
        parts = about.get(MADE_FROM) if isinstance(about, dict) else None
        return parts if isinstance(parts, dict) else {}

    @property
    def pair_files(self) -> bytes | None:
        """The zip of the parameter files of all pairs."""
        file = self.database.file(RIG_FILES, PAIRS)
        return None if file is None else file.read_bytes()

    @property
    def pair_names(self) -> list[str]:
        """The pairs of the rig, such as `left-right`, that see bars together; none before it."""
        if (rig := self.rig) is None:
            return []
        named = {pair_name(pair): pair for pair in combinations(rig.names, 2)}
        return [name for name in named if (quality := rig.about.pairs.get(name)) and quality.bars]

    def _dataset_of_pair(self, inputs: Inputs) -> Pair | None:
        """The points that both cameras of `pair` see; once the rig is calibrated, those that it was
        fitted to, with its lenses and baseline. None without a pair or a recording."""
        recording, rig_file = self.recording_of(inputs), self.rig_file
        if self.pair is None or recording is None:
            return None
        cameras = recording.pair_named(self.pair)
        rig_digest = None if rig_file is None else rig_file.sha256
        key = f"{self.pair} {rig_digest} {self._key_of(inputs)}"
        return once("data set", key, lambda: data_of_pair(recording, cameras, self.rig))

    @property
    def rig_settings(self) -> RefineSettings | None:
        """The settings with which the refined set of `pair` is the rig's, with its covariance; None
        without a pair, its data or a calibrated rig."""
        if self.pair is None:
            return None
        dataset, recording, rig = self.dataset, self.recording, self.rig
        if dataset is None or recording is None or rig is None:
            return None
        return settings_of_pair(dataset, recording.pair_named(self.pair), rig)

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
            "camera", file.sha256, lambda: read_camera(file.read_bytes(), file.label, "brown")
        )


def _unstated(*names: str) -> dict[str, Any]:
    """Inputs as they are before anything is stated of them."""
    fresh = Inputs()
    return {name: getattr(fresh, name) for name in names}


def _refuse_points_outside(
    file: StoredFile, inputs: Inputs, primary: Camera | None, secondary: Camera | None
) -> None:
    """Raise an error if points are outside their image; of two known cameras with the cause.

    The bar may be of any length there: the baseline is free.
    """
    rows, recording = _rows(file), None
    if primary is not None and secondary is not None:
        length_m = inputs.target_distance_m or 1.0
        recording = Recording.of_two("", primary, secondary, None, length_m).holding(rows)
    with causes_named():
        refuse_points_outside(f"{file.label}: ", rows, primary, secondary, recording)


def _rows(file: StoredFile) -> Correspondences:
    """The rows of a table, all of which must be valid."""
    table = once("table", file.sha256, lambda: read_table(file.read_bytes(), file.label))
    return table.strict(file.label)
