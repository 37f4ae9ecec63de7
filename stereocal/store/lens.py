"""The board photographs of one camera of a project on disk, and the lens made of them.

Below the project's folder, in `lens/primary/` and `lens/secondary/`:

- `files/<digest>.<suffix>`: the photographs as given, never changed once written.
- `photographs.json`: their names.
- `boards.npz`: the boards found in them; `lens.npz`: the last finished calibration.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera
from stereocal.intrinsics import LensCalibration
from stereocal.lens.boards import BoardSearch
from stereocal.lens.files import about, pack_lens, pack_search, unpack_lens, unpack_search
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.writing import write_atomically

STORE_FORMAT = "stereocal-boards/1"
Which = Literal["primary", "secondary"]
WHICH: tuple[Which, Which] = ("primary", "secondary")
_WRITING = threading.Lock()


class ProjectLens:
    """One camera's boards. Every change is on disk when its method returns."""

    def __init__(self, project: Project, which: Which) -> None:
        self.project = project
        self.which = which
        self.folder = project.folder / "lens" / which
        self.files = self.folder / "files"
        """Where `photograph_files` stores what comes from a zip or an upload."""

    @property
    def photographs(self) -> dict[str, Path]:
        """Files on disk by the person's names."""
        stored: Mapping[str, str] = self._read()["files"]
        return {name: own_file(self.files, file) for name, file in stored.items()}

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced."""
        with _WRITING:
            state = self._read()
            state["files"].update({name: path.name for name, path in found.items()})
            self._write(state)
            (self.folder / "boards.npz").unlink(missing_ok=True)

    def clear(self) -> None:
        """Forget the photographs and what was made of them; the files stay on disk."""
        with _WRITING:
            self._write(_empty())
            for name in ("boards.npz", "lens.npz"):
                (self.folder / name).unlink(missing_ok=True)

    @property
    def search(self) -> BoardSearch | None:
        """The boards that were found in the photographs that are there now; None if not yet."""
        path = self.folder / "boards.npz"
        if not path.is_file():
            return None
        search = unpack_search(path.read_bytes())
        names = [view.name for view in search.views] + [item.name for item in search.refused]
        return search if set(names) == set(self._read()["files"]) else None

    def keep_search(self, search: BoardSearch) -> None:
        """Keep the boards that were found."""
        write_atomically(self.folder / "boards.npz", pack_search(search))

    @property
    def calibration(self) -> LensCalibration | None:
        """The last finished calibration; None before the first."""
        path = self.folder / "lens.npz"
        return unpack_lens(path.read_bytes()) if path.is_file() else None

    def keep_calibration(self, lens: LensCalibration) -> None:
        """Keep a finished calibration in place of the last one."""
        write_atomically(self.folder / "lens.npz", pack_lens(lens))

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

    def _read(self) -> dict[str, Any]:
        path = self.folder / "photographs.json"
        if not path.is_file():
            return _empty()
        try:
            state: dict[str, Any] = json.loads(path.read_bytes())
        except (OSError, ValueError) as error:
            raise StereocalError(
                f"The list of board photographs cannot be read ({error})."
            ) from error
        if state.get("format") != STORE_FORMAT:
            raise StereocalError("The board photographs were stored by another version.")
        return state

    def _write(self, state: Mapping[str, Any]) -> None:
        write_atomically(self.folder / "photographs.json", json.dumps(state, indent=1).encode())


def label_of(lens: LensCalibration) -> str:
    """What the project calls a camera made of photographs."""
    return f"lens from {len(lens.search.views)} board photographs"


def _empty() -> dict[str, Any]:
    return {"format": STORE_FORMAT, "files": {}}
