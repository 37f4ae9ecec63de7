"""The board photographs of one camera of a project, and the lens calibrated from them."""

from __future__ import annotations

from collections.abc import Mapping

from stereocal.formats.camera_file import write_camera
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.files import about, pack_lens, pack_search, unpack_lens, unpack_search
from stereocal.projects.files import (
    StoredFile,
    files_of,
    forget_files,
    keep_file,
    keep_result,
    name_files,
    result_of,
)
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName


class ProjectLens:
    """One camera's board photographs. Every change is on disk when its method returns."""

    def __init__(self, project: Project, which: CameraName) -> None:
        self.project = project
        self.database = project.database
        self.which = which
        self._part = self._boards = f"boards_{which}"
        self._lens = f"lens_{which}"

    def keep(self, name: str, content: bytes) -> StoredFile:
        """Store a photograph; `add` makes it the project's."""
        return keep_file(self.database, content, name)

    @property
    def photographs(self) -> dict[str, StoredFile]:
        """Files by their uploaded names."""
        return files_of(self.database, self._part)

    def add(self, found: Mapping[str, StoredFile]) -> None:
        """Add stored photographs; a repeated name is replaced."""
        with self.database.transaction():
            before = self.photographs
            name_files(self.database, self._part, found)
            if any(before.get(name, file) != file for name, file in found.items()):
                # New names need no reset: `search` compares the names.
                keep_result(self.database, self._boards, None)

    def clear(self) -> None:
        """Delete the photographs, the boards found and the lens."""

        def forget(_database: object) -> None:
            forget_files(self.database, self._part)
            for kind in (self._boards, self._lens):
                keep_result(self.database, kind, None)

        self.database.free(forget)

    @property
    def search(self) -> BoardSearch | None:
        """The boards found in the present photographs; None before the search."""
        content = result_of(self.database, self._boards)
        if content is None:
            return None
        search = unpack_search(content)
        names = [view.name for view in search.views] + [item.name for item in search.refused]
        return search if set(names) == set(self.photographs) else None

    def keep_search(self, search: BoardSearch) -> None:
        keep_result(self.database, self._boards, pack_search(search))

    @property
    def calibration(self) -> LensCalibration | None:
        """The last finished calibration; None before the first."""
        content = result_of(self.database, self._lens)
        return None if content is None else unpack_lens(content)

    def keep_calibration(self, lens: LensCalibration) -> None:
        """Replace the last calibration."""
        keep_result(self.database, self._lens, pack_lens(lens))

    def use(self) -> None:
        """Make the lens the project's camera.

        Raises:
            StereocalError: the project's points do not fit its image; nothing has changed.
        """
        lens = self.calibration
        if lens is not None:
            content = write_camera(lens.camera, about(lens))
            self.project.give({self.which: (label_of(lens), content)})

    @property
    def is_used(self) -> bool:
        """Whether the project uses this lens."""
        lens, at = self.calibration, CAMERAS.index(self.which)
        camera = self.project.cameras[at]
        return (
            lens is not None and camera is not None and (camera.to_json() == lens.camera.to_json())
        )


def label_of(lens: LensCalibration) -> str:
    """The project's name for a lens from photographs."""
    return f"lens from {len(lens.search.views)} board photographs"
