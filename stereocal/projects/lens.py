"""The board photographs of one camera of a project, and the lens calibrated from them."""

from collections.abc import Mapping

from stereocal.formats.camera_file import write_camera
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.files import about, pack_lens, pack_search, unpack_lens, unpack_search
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project, ProjectPart
from stereocal.rig.camera import CAMERAS, CameraName


class ProjectLens(ProjectPart):
    """One camera's board photographs."""

    def __init__(self, project: Project, which: CameraName) -> None:
        super().__init__(project)
        self.which = which
        self._boards, self._lens = f"boards_{which}", f"lens_{which}"

    @property
    def photographs(self) -> dict[str, StoredFile]:
        return self.database.files(self._boards)

    def add(self, photographs: Mapping[str, StoredFile]) -> None:
        """Add stored photographs; a repeated name is replaced."""
        with self.database.transaction():
            present = self.photographs
            self.database.name_files(self._boards, photographs)
            if any(present.get(name, file) != file for name, file in photographs.items()):
                # New names need no reset: `search` compares the names.
                self.database.keep_result(self._boards, None)

    def replace(self, folder: str, new: Mapping[str, StoredFile]) -> None:
        """Add stored photographs of a folder, in the place of those that it had."""
        with self.database.transaction():
            gone = [name for name in self.photographs if name.startswith(f"{folder}/")]
            self.database.forget_files(self._boards, [name for name in gone if name not in new])
            self.add(new)

    def clear(self) -> None:
        """Delete the photographs, the boards found and the lens."""
        with self.database.freeing():
            self.database.forget_files(self._boards)
            for kind in (self._boards, self._lens):
                self.database.keep_result(kind, None)

    @property
    def search(self) -> BoardSearch | None:
        """The boards found in the present photographs; None before the search."""
        content = self.database.result(self._boards)
        if content is None:
            return None
        search = unpack_search(content)
        names = [view.name for view in search.views] + [item.name for item in search.refused]
        return search if set(names) == set(self.photographs) else None

    def keep_search(self, search: BoardSearch) -> None:
        self.database.keep_result(self._boards, pack_search(search))

    @property
    def calibration(self) -> LensCalibration | None:
        """The last finished calibration; None before the first."""
        content = self.database.result(self._lens)
        return None if content is None else unpack_lens(content)

    def keep_calibration(self, lens: LensCalibration) -> None:
        self.database.keep_result(self._lens, pack_lens(lens))

    def use(self) -> None:
        """Make the lens the project's camera; refused if the points do not fit its image."""
        lens = self.calibration
        if lens is not None:
            label = f"lens from {len(lens.search.views)} board photographs"
            self.project.give({self.which: (label, write_camera(lens.camera, about(lens)))})

    @property
    def is_used(self) -> bool:
        """Whether the project uses this lens."""
        lens, camera = self.calibration, self.project.cameras[CAMERAS.index(self.which)]
        return bool(lens and camera and camera.to_json() == lens.camera.to_json())
