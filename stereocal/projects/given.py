"""Which camera the files of a project belong to, as far as it is known, and what is to be asked.

Photographs whose names do not tell are put into the folder of their camera. Camera files that are
of no camera yet are kept as parts, with which the files of three cameras and more stay.
"""

from collections.abc import Mapping
from pathlib import PurePosixPath

from stereocal.errors import StereocalError
from stereocal.formats.archives.all_cameras import cameras_in, names_cameras
from stereocal.formats.archives.easywand import open_easywand
from stereocal.formats.archives.gather import is_table, nominal_baseline
from stereocal.formats.camera_file import write_camera
from stereocal.formats.exchange.exchange import camera_names
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.other_files import is_matlab
from stereocal.formats.recognition import recognise
from stereocal.frames.all_cameras import by_folder
from stereocal.frames.which_camera import (
    Series,
    WhichCamera,
    numbered_cameras,
    series_of,
    which_camera,
    which_of,
)
from stereocal.intrinsics.proposed_board import split_of
from stereocal.projects.contents import INPUT, PARTS, REPLACED
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project, ProjectPart
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.system.latest import once, read_once
from stereocal.system.numbers import plural
from stereocal.system.photograph import photograph_size
from stereocal.system.split_photographs import Split, split_by_shape, split_photographs


class ProjectGiven(ProjectPart):
    """The files of one project and their cameras."""

    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self.photographs = ProjectPhotographs(project)

    @property
    def parts(self) -> dict[str, StoredFile]:
        """Files of cameras and a table by name, to be put together."""
        return self.database.files(PARTS)

    def add_parts(self, files: Mapping[str, bytes]) -> None:
        """Add files; one of the same name is replaced, which `undo_part` takes back."""
        for name, content in files.items():
            file = self.database.keep_file(content, name)
            with self.database.transaction():
                present = self.parts.get(name)
                if present is not None and present != file:
                    self.database.name_files(REPLACED, {name: present})
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

    @property
    def cameras(self) -> dict[str, Camera]:
        """The cameras of three and more, of the recording or of files that are none yet."""
        if (recording := self.project.recording_as_given) is not None:
            return dict(recording.cameras)
        files = {name: file.read_bytes() for name, file in self.parts.items()}
        cameras = {name: content for name, content in files.items() if not is_table(name, content)}
        return cameras_in(cameras, ExchangeOptions())

    @property
    def is_of_rig(self) -> bool:
        """Whether the files are of three cameras and more, or their table names cameras."""
        return bool(self.rig_cameras) or self._has_points

    @property
    def of_more_than_two(self) -> bool:
        """Whether the data, or the files, are of three cameras and more."""
        return self.project.holds_recording or self.is_of_rig

    @property
    def rig_cameras(self) -> tuple[str, ...]:
        """Names of the cameras of files that are of three or more; empty for two."""
        names = [name for cameras in self._parts.values() for name in cameras]
        return tuple(names) if len(names) > 2 or self._has_points else ()

    @property
    def open_files(self) -> tuple[str, ...]:
        """Camera files of which it is to be asked whose they are."""
        return () if self.is_of_rig else tuple(self._parts)

    def cameras_in(self, name: str, content: bytes) -> tuple[str, ...]:
        """Names of the cameras of a file; empty for a table."""
        return read_once(_cameras_in, content, name)

    @property
    def _parts(self) -> dict[str, tuple[str, ...]]:
        """Names of the cameras in each part that has some."""
        parts = self.parts.items()
        cameras_of = {name: self.cameras_in(name, file.read_bytes()) for name, file in parts}
        return {name: cameras for name, cameras in cameras_of.items() if cameras}

    @property
    def _has_points(self) -> bool:
        """Whether a part is a table that names cameras."""
        parts = self.parts.items()
        return any(read_once(names_cameras, file.read_bytes(), name) for name, file in parts)

    @property
    def sides(self) -> WhichCamera:
        """The cameras of the photographs, of two."""
        files = self.photographs.photographs
        key = repr([(name, file.about) for name, file in files.items()])
        return once(
            "whose photographs", key, lambda: which_camera(files, taken=self.photographs.taken)
        )

    @property
    def numbered_cameras(self) -> tuple[str, ...]:
        """The cameras that photographs of three and more name, while no camera files are there."""
        if self.is_of_rig or not self.sides.open:
            return ()
        return tuple(numbered_cameras(self.photographs.photographs))

    @property
    def is_undivided(self) -> bool:
        """Whether it is to be settled first which camera took which photographs."""
        undivided = len(self.open_series) > 0 and not self.sides.known
        return undivided or len(self.numbered_cameras) > 0

    @property
    def photographs_in_words(self) -> str:
        """`25 + 25 photographs`, of two cameras; empty if there are none."""
        total, known = len(self.photographs.photographs), [*self.sides.known.values()]
        counts = [known.count(side) for side in CAMERAS]
        split = " + ".join(map(str, counts)) if sum(counts) == total > 0 and all(counts) else ""
        return f"{split or total} {plural(total, 'photograph')}" if total else ""

    @property
    def open_series(self) -> tuple[Series, ...]:
        """Photographs of which it is to be asked which camera took them."""
        if not self.is_of_rig:
            return self.sides.open
        return series_of(self._unplaced)

    @property
    def _unplaced(self) -> list[str]:
        """Photographs that are in no folder of a camera of three and more."""
        names = self.photographs.photographs
        folders = by_folder(names, self.rig_cameras)
        placed = {name for of_camera in folders.values() for name in of_camera}
        return [name for name in names if name not in placed]

    @property
    def nominal_baseline(self) -> tuple[float, float] | None:
        """The baseline of the camera files in use and its standard error, in metres, as another
        program found it; None if they have none."""
        files, labels = self.database.files(INPUT), self.project.inputs.labels
        if not {*CAMERAS} <= {*files}:
            return None
        primary, secondary = (files[which].read_bytes() for which in CAMERAS)
        names = labels["primary"], labels["secondary"]
        return read_once(nominal_baseline, primary, secondary, names)

    def add_photographs(self, stored: Mapping[str, StoredFile]) -> None:
        """Add stored photographs. Those that are there already stay as they are; others with the
        same names are the second camera's."""
        if not stored:
            return
        present = self.photographs.photographs
        # A folder may have been put before the name.
        known = {(name.partition("/")[2], file) for name, file in present.items()}
        known |= {*present.items()}
        new = {name: file for name, file in stored.items() if (name, file) not in known}
        again = [name for name in new if name in present]
        if 2 * len(again) > len(new) and {*again} <= {n for s in self.sides.open for n in s.names}:
            self.photographs.rename({name: f"primary/{name}" for name in present})
            new = {f"secondary/{name}": file for name, file in new.items()}
        self.photographs.add(new)
        self.settle()

    @property
    def split(self) -> Split | None:
        """How the images of two cameras may lie in each photograph whose camera is asked for: by
        the shape, if it is that of images side by side, else if a board is in both halves."""
        files = self.photographs.photographs
        names = [name for series in self.open_series for name in series.names]
        if not names or self.sides.known:
            return None
        key = repr([files[name].name for name in names])

        def look() -> Split | None:
            by_shape = split_by_shape(photograph_size(files[names[0]], names[0]))
            return by_shape if by_shape != "top-bottom" else split_of(files)

        return once("images in a photograph", key, look)

    def divide(self, split: Split) -> None:
        """Put both halves of each photograph in its place."""
        store = self.photographs
        store.clear(split_photographs(store.photographs, split, store.keep))

    def settle(self) -> None:
        """Put photographs into the folders of their cameras, where the names do not say so."""
        if self.is_of_rig:
            cameras = which_of(self._unplaced, self.rig_cameras)
            self.photographs.rename({n: f"{camera}/{n}" for n, camera in cameras.items()})
        else:
            self.photographs.rename(self.sides.folders)

    def name_cameras(self, cameras: Mapping[str, Camera]) -> None:
        """Name the cameras of a rig, to tell whose photographs are given; of two, forget them."""
        lenses = {f"{name}.json": write_camera(camera) for name, camera in cameras.items()}
        if len(cameras) <= len(CAMERAS):
            lenses = {}
        for name in self.parts.keys() - lenses.keys():
            self.drop_part(name)
        self.add_parts(lenses)

    def answer(self, series: Series, camera: str) -> None:
        """Keep which camera took photographs; of two, another series is the other camera's."""
        moved = {name: f"{camera}/{name}" for name in series.names}
        if not self.is_of_rig and len(self.open_series) == 2:
            (other,) = (candidate for candidate in self.open_series if candidate != series)
            side = CAMERAS[1 - CAMERAS.index("primary" if camera == "primary" else "secondary")]
            moved |= {name: f"{side}/{name}" for name in other.names}
        self.photographs.rename(moved)
        self.settle()

    def place_cameras(self, new: Mapping[str, bytes]) -> dict[CameraName, str]:
        """The camera files, new or kept, whose cameras are known. The others are kept: of three
        cameras and more all, and of two those that are to be asked about.

        Args:
            new: camera files by name, of one camera each or of three and more.
        """
        labels = self.project.inputs.labels
        used = {labels[slot]: slot for slot in CAMERAS if slot in labels}
        self.add_parts(new)
        if self.is_of_rig:
            self.settle()
            return {}
        pending = self.open_files
        sides = which_camera(pending, {**used, **self.sides.known}, one_by_one=True)
        placed = {side: name for name, side in sides.known.items()}
        if len(placed) < len(sides.known):
            raise StereocalError(
                f"{', '.join(sides.known)}: two of these are the same camera's. Give one for each."
            )
        free = [slot for slot in CAMERAS if slot not in used.values() and slot not in placed]
        if len(sides.open) == len(free) == 1 and (used or placed):
            placed[free[0]] = sides.open[0].names[0]
        return placed

    def more_cameras(self, more: Mapping[str, bytes]) -> None:
        """The camera files in use and the kept ones are those of three cameras and more.

        Args:
            more: further files, of cameras or a table that names them.
        """
        used, labels = self.database.files(INPUT), self.project.inputs.labels
        files = {labels[slot]: used[slot].read_bytes() for slot in CAMERAS if slot in labels}
        self.add_parts({**files, **more})
        self.project.give({}, CAMERAS)
        self.settle()


def _cameras_in(content: bytes, name: str) -> tuple[str, ...]:
    """Names of the cameras of a file; empty for a table."""
    kind = recognise(name, content).kind
    if kind == "cameras" and is_matlab(content):
        opened = open_easywand(content, name)
        return () if opened is None else opened.cameras
    if kind == "cameras":
        return camera_names(name, content)
    return (PurePosixPath(name).stem,) if kind == "camera" else ()
