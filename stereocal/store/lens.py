"""The board photographs of one camera of a project on disk, and the lens made of them.

Below the project's folder, in `lens/primary/` and `lens/secondary/`:

- `files/<digest>.<suffix>`: the photographs as given, never changed once written.
- `photographs.json`: their names.
- `boards.npz`: the boards found in them; `lens.npz`: the last finished calibration.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from stereocal.errors import StereocalError, can_be_shown
from stereocal.formats.camera_file import write_camera
from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.files import about, pack_lens, pack_search, unpack_lens, unpack_search
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.store.state import StateFile, changing, flush_stored, forget, read_if_there
from stereocal.store.unused import forget_files
from stereocal.system.atomic_files import write_atomically

STORE_FORMAT = "stereocal-boards/1"
Which = Literal["primary", "secondary"]
WHICH: tuple[Which, Which] = ("primary", "secondary")


class ProjectLens:
    """One camera's boards. Every change is on disk when its method returns."""

    def __init__(self, project: Project, which: Which) -> None:
        self.project = project
        self.which = which
        self.folder = project.folder / "lens" / which
        self.files = self.folder / "files"
        """Where `photograph_files` stores what comes from a zip or an upload."""
        self._file = StateFile(
            project.folder, self.folder / "photographs.json", STORE_FORMAT, _check, {"files": {}},
            "The list of board photographs", "remove them, and give them again",
            ("boards.npz", "lens.npz"),
        )  # fmt: skip

    @property
    def photographs(self) -> dict[str, Path]:
        """Files on disk by the person's names."""
        stored: Mapping[str, str] = self._file.read()["files"]
        return {name: own_file(self.files, file) for name, file in stored.items()}

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced."""
        with self._file.change() as state:
            flush_stored(found, self.files)
            files = {name: path.name for name, path in found.items()}
            if any(state["files"].get(name, file) != file for name, file in files.items()):
                # Else the names tell that the boards are not those of these photographs.
                forget(self.folder / "boards.npz")
            state["files"].update(files)

    def clear(self) -> None:
        """Forget the photographs and what was made of them, and free their room."""
        with changing(self.project.folder):
            if not self.folder.exists():
                return
            files: Collection[Path] = ()
            with suppress(StereocalError):  # a list that is damaged is begun anew
                files = self.photographs.values()
            self._file.write(self._file.blank())
            for name in ("boards.npz", "lens.npz"):
                forget(self.folder / name)
            forget_files(self.project.folder, files)

    @property
    def search(self) -> BoardSearch | None:
        """The boards that were found in the photographs that are there now; None if not yet."""
        content = read_if_there(self.folder / "boards.npz", "find the boards again")
        if content is None:
            return None
        search = unpack_search(content)
        names = [view.name for view in search.views] + [item.name for item in search.refused]
        return search if set(names) == set(self._file.read()["files"]) else None

    def keep_search(self, search: BoardSearch) -> None:
        """Keep the boards that were found."""
        content = pack_search(search)
        with changing(self.project.folder):
            write_atomically(self.folder / "boards.npz", content)

    @property
    def calibration(self) -> LensCalibration | None:
        """The last finished calibration; None before the first."""
        content = read_if_there(self.folder / "lens.npz", "calibrate the lens again")
        return None if content is None else unpack_lens(content)

    def keep_calibration(self, lens: LensCalibration) -> None:
        """Keep a finished calibration in place of the last one."""
        content = pack_lens(lens)
        with changing(self.project.folder):
            write_atomically(self.folder / "lens.npz", content)

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
        """Whether the project's camera is this lens."""
        lens, at = self.calibration, WHICH.index(self.which)
        camera = self.project.cameras[at]
        return (
            lens is not None and camera is not None and (camera.to_json() == lens.camera.to_json())
        )


def label_of(lens: LensCalibration) -> str:
    """What the project calls a camera made of photographs."""
    return f"lens from {len(lens.search.views)} board photographs"


def _check(state: dict[str, Any]) -> None:
    for name, file in state["files"].items():
        if not can_be_shown(name) or not isinstance(file, str):
            raise TypeError(name)
