"""A recording of three cameras and more in a project, and the rig that was found from it."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

from stereocal.errors import StereocalError, naming
from stereocal.fit.rig_file import RIG, RigFile
from stereocal.fit.start.pairs import pair_name
from stereocal.fit.timing.to_calibrate import in_step
from stereocal.formats.archives.all_cameras import cameras_in
from stereocal.formats.archives.gather import is_table
from stereocal.formats.dataset_description import DESCRIPTION, find_description
from stereocal.formats.dataset_files import parse_recording
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.projects.contents import INPUT, PARTS, RECORDING, REPLACED, RIG_FILES
from stereocal.projects.files import StoredFile
from stereocal.projects.inputs import Slot
from stereocal.projects.project import KEPT, Project, ProjectPart, once, packed_files, stated_in
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.workflow.pair_of_rig import data_of_pair, settings_of_pair

PAIRS, SOURCE = "pairs.zip", "the recording of this project"
OF_RIG, REFINED = "of_rig", "refined_of_rig"
"""Settings of a pair: the digests of the recording and of the rig that it is of, and with which its
refined set is the rig's."""
OBJECT_SIGMA = "object_sigma_m"
"""Setting: how well the lengths of the object are known, m."""
VERSION = 3
"""The version of what a pair is given; one of another is given again."""


class ProjectRecording(ProjectPart):
    """The recording of one project. Every change is on disk when its method returns."""

    @property
    def is_given(self) -> bool:
        """Whether the project holds a recording."""
        return bool(self.digest)

    @property
    def digest(self) -> list[str]:
        """Identifies the recording."""
        return [file.sha256 for file in self.database.files(RECORDING).values()]

    @property
    def camera_count(self) -> int:
        """How many cameras the recording has, without reading its points."""
        files = self.database.files(RECORDING).items()
        described = {name: each.read_bytes() for name, each in files if name.endswith(DESCRIPTION)}
        return len(find_description(described, SOURCE).entries["cameras"])

    @property
    def cameras(self) -> dict[str, Camera]:
        """The cameras of the recording, or of the files that are no recording yet."""
        if (recording := self.read()) is not None:
            return dict(recording.cameras)
        files = {name: file.read_bytes() for name, file in self.parts.items()}
        cameras = {name: each for name, each in files.items() if not is_table(name, each)}
        return cameras_in(cameras, ExchangeOptions())

    @property
    def pair_names(self) -> list[str]:
        """The pairs of the rig that see bars together; before there is one, all pairs."""
        every = [pair_name(pair) for pair in combinations(self.cameras, 2)]
        return every if self.rig is None else [n for n in every if n in self.rig.about.pairs]

    @property
    def parts(self) -> dict[str, StoredFile]:
        """Files of cameras and a table by name, to be put together."""
        return self.database.files(PARTS)

    def add_parts(self, files: Mapping[str, bytes]) -> None:
        """Add files; one of the same name is replaced, which `undo_part` takes back."""
        for name, content in files.items():
            file = self.database.keep_file(content, name)
            with self.database.transaction():
                before = self.parts.get(name)
                if before is not None and before != file:
                    self.database.name_files(REPLACED, {name: before})
                self.database.name_files(PARTS, {name: file})

    def drop_part(self, name: str) -> None:
        for part in (PARTS, REPLACED):
            self.database.forget_files(part, [name])

    @property
    def replaced(self) -> list[str]:
        """The files that replaced one of the same name."""
        return list(self.database.files(REPLACED))

    def undo_part(self, name: str) -> None:
        with self.database.transaction():
            self.database.name_files(PARTS, {name: self.database.files(REPLACED)[name]})
            self.database.forget_files(REPLACED, [name])

    def give(self, recording: Recording, files: Mapping[str, bytes]) -> None:
        """Store a recording and its files instead of what was there; its rig goes."""
        kept = {name: self.database.keep_file(content, name) for name, content in files.items()}
        if kept == (before := self.database.files(RECORDING)):
            return
        with self.database.transaction():
            if before:  # what was stated is of that one
                self.project.keep_settings({OBJECT_SIGMA: None})
            self.database.replace_files(RECORDING, kept)
            self.database.forget_files(RIG_FILES)
            self.database.forget_pairs()
            self.database.keep_values(INPUT, {"name": recording.name})
        KEPT[Recording].keep(" ".join(self.digest), recording)

    @property
    def object_sigma_m(self) -> float | None:
        """Standard deviation of the object's longest length as stated on the page; None: as its
        files say."""
        stated = self.project.settings.get(OBJECT_SIGMA)
        return float(stated) if isinstance(stated, int | float) else None

    def know_object(self, sigma_m: float | None) -> None:
        """Store how well the lengths of the object are known; a rig found before goes."""
        if sigma_m != self.object_sigma_m:
            with self.database.transaction():
                self.project.keep_settings({OBJECT_SIGMA: sigma_m})
                self.database.forget_files(RIG_FILES)

    def known(self, recording: Recording) -> Recording:
        """A recording with what is stated on the page of its object."""
        if (sigma := self.object_sigma_m) is None:
            return recording
        return replace(recording, object=replace(recording.object, sigma_m=sigma))

    def read(self) -> Recording | None:
        """The recording; None if the project holds none."""
        given = self.as_given()
        if given is None or self.object_sigma_m is None:
            return given
        return once(Recording, " ".join(self._identity), lambda: self.known(given))

    def as_given(self) -> Recording | None:
        """The recording as its files say."""
        if not (digest := self.digest):
            return None

        def parsed() -> Recording:
            files = self.database.files(RECORDING).items()
            contents = {name: each.read_bytes() for name, each in files}
            # The lens models were settled when it was given.
            recording = parse_recording(contents, SOURCE, lens_model="brown")
            with naming(SOURCE):
                return in_step(recording)

        return once(Recording, " ".join(digest), parsed)

    @property
    def _identity(self) -> list[str]:
        """Identifies the recording and what is stated of its object."""
        sigma = self.object_sigma_m
        return self.digest if sigma is None else [*self.digest, f"{sigma!r}"]

    def keep_rig(self, rig: str, pairs: bytes) -> None:
        """Store rig.json and the zip of the pairs' files."""
        files = {RIG: rig.encode(), PAIRS: pairs}
        kept = {name: self.database.keep_file(content, name) for name, content in files.items()}
        self.database.replace_files(RIG_FILES, kept)

    @property
    def rig(self) -> RigFile | None:
        found = self.database.file(RIG_FILES, RIG)
        return None if found is None else RigFile.loads(found.read_bytes().decode())

    @property
    def pairs(self) -> bytes | None:
        found = self.database.file(RIG_FILES, PAIRS)
        return None if found is None else found.read_bytes()

    def pair(self, name: str) -> Project:
        """The project of a pair such as `left-right`, in the same file.

        Its points, lenses and baseline are given when it is first opened, and when the rig has
        changed since; its settings and results stay, and what was said of its frames.
        """
        project = Project(self.database.of_pair(name))
        file = self.database.file(RIG_FILES, RIG)
        about = [*self._identity, VERSION, *([] if file is None else [file.sha256])]
        if project.settings.get(OF_RIG) == about:
            return project
        if (recording := self.read()) is None:
            raise StereocalError("This project has no recording of several cameras: no pairs.")
        rig, pair = self.rig, recording.pair_named(name)
        dataset = data_of_pair(recording, pair, rig)
        inputs = project.inputs
        files: dict[Slot, tuple[str, bytes]] = {
            slot: (f"{dataset.name}, {slot}", content)
            for slot, content in packed_files(dataset).items()
            if hashlib.sha256(content).hexdigest() != inputs.files.get(slot)
        }
        with self.database.transaction():
            project.give(files, **stated_in(dataset) | {"name": inputs.name or dataset.name})
            refined = None
            if rig is not None and {*pair} <= {*rig.names}:
                refined = settings_of_pair(dataset, pair, rig).to_json()
            # The rig has left out the frames that contradict it.
            of_frames = {} if OF_RIG in project.settings else {"all_frames": refined is not None}
            project.keep_settings({OF_RIG: about, REFINED: refined, **of_frames})
        return project
