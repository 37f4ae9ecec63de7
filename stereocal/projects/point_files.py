"""The points of both cameras in a project, to be matched and measured."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import pandas as pd

from stereocal.errors import DAMAGED, StereocalError, can_be_shown
from stereocal.formats.point_answers import OURS, Answers, answered, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.sleap_h5 import point_text
from stereocal.matching.application import Points
from stereocal.matching.pairs import POINT
from stereocal.matching.parquet import PARQUET
from stereocal.matching.point_table import PointTable
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project, ProjectPart
from stereocal.projects.sqlite_errors import DamagedError
from stereocal.rig.camera import CameraName
from stereocal.system.records import of_plain, plain

Asked = Literal["primary", "secondary", "bars", "archive", "matching", "measuring"]
SUFFIXES = (".csv", ".parquet")
POINT_FILES, TABLES, ASKING = "points", "tables", "asking"
"""Parts of a project: uploaded point files, the tables read from them, and files with open
questions."""


@dataclass(frozen=True)
class PointFile:
    """A point file and the table that was read from it."""

    label: str
    suffix: str
    """Of the table."""
    rows: int
    frames: int
    answers: Answers | None = None
    """None if the file itself is `frame,u,v`."""


class ProjectPoints(ProjectPart):
    """The point files of one project."""

    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self._own: dict[str, bytes] = {}
        """Tables of the project's own points, stored with a result computed from them."""

    def point_file(self, side: CameraName) -> PointFile | None:
        """The file in use."""
        found = self.database.file(TABLES, side)
        try:
            return None if found is None else _checked(of_plain(found.about, PointFile))
        except DAMAGED as error:
            raise DamagedError("The list of point files is damaged; give them again.") from error

    def points(self, side: CameraName) -> Points | None:
        """The points in use."""
        file = self.point_file(side)
        if file is None:
            return None
        stored = self.database.files(TABLES)[side]
        return Points(stored.name + file.suffix, file.label, file.rows, file.frames)

    @contextmanager
    def opened(self, name: str) -> Iterator[Path]:
        """A temporary file with a table of points, for libraries that read only files.

        Args:
            name: as in `Points.name`.
        """
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            yield self._copied(name, Path(folder))

    def table(self, name: str) -> StoredFile:
        """The stored table of points of this name."""
        return StoredFile(Path(name).stem, self.database)

    def _copied(self, name: str, folder: Path) -> Path:
        if name not in self._own:
            return self.table(name).copy_to(folder / Path(name).name)
        (folder / name).write_bytes(self._own[name])
        return folder / name

    def asking(self, side: Asked) -> tuple[str, bytes] | None:
        """Name and content of a file with open questions."""
        found = self.database.file(ASKING, side)
        return None if found is None else (found.label, found.read_bytes())

    def offer_points(self, side: CameraName, label: str, content: bytes) -> None:
        """Store a `frame,u,v` table; keep any other point file until questions are answered.

        Raises:
            StereocalError: no points, or invalid rows; nothing has changed.
        """
        parquet = Path(label).suffix.lower() in PARQUET
        content = content if parquet else point_text(content, label)
        if parquet or layout_of(content, label).program == OURS:
            suffix = ".parquet" if parquet else ".csv"
            with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
                path = Path(folder) / f"table{suffix}"
                path.write_bytes(content)
                contents = PointTable(path, POINT, label).check()
            file = PointFile(label, suffix, contents.rows, len(contents.frames))
            self._keep_points(side, content, content, file)
            return
        self.ask(side, label, content)

    def ask(self, side: Asked, label: str, content: bytes) -> None:
        """Keep a file until the user has answered how to read it."""
        self.database.give(ASKING, side, label, content)

    def answer(self, side: CameraName, answers: Answers) -> None:
        """Read the file with open questions as answered, and use it."""
        found = self.asking(side)
        if found is None:
            return
        label, content = found
        table = self.preview(side, answers, None)
        if table.empty:
            raise StereocalError(f"{label}: there is no point of {answers.camera} in the file.")
        file = PointFile(label, ".csv", len(table), int(table["frame"].nunique()), answers)
        self._keep_points(side, content, written(table), file)

    def preview(self, side: CameraName, answers: Answers, first_rows: int | None) -> pd.DataFrame:
        """The points of the file with open questions, as they would be read."""
        found = self.asking(side)
        if found is None:
            return pd.DataFrame(columns=["frame", *POINT])
        label, content = found
        layout = answered(layout_of(content, label), answers, content, label)
        return read_points(content, layout, answers.camera, answers.image_height, label, first_rows)

    def ask_again(self, side: CameraName) -> None:
        """Ask about the file in use again; it stays in use until answered."""
        with self.database.transaction():
            file = self.point_file(side)
            if file is not None and file.answers is not None:
                given = self.database.files(POINT_FILES)[side]
                self.database.name_files(ASKING, {side: given})

    def forget_question(self, side: Asked) -> None:
        """Delete the file with open questions."""
        with self.database.freeing():
            self.database.forget_files(ASKING, [side])

    def own_points(self, table: pd.DataFrame, label: str) -> Points:
        """Points of the project itself, used like those of a file."""
        content = written(table)
        name = f"{hashlib.sha256(content).hexdigest()}.csv"
        self._own[name] = content
        return Points(name, label, len(table), int(table["frame"].nunique()))

    def _keep_points(self, side: CameraName, given: bytes, table: bytes, file: PointFile) -> None:
        with self.database.transaction():
            self.database.give(POINT_FILES, side, file.label, given)
            stored = self.database.keep_file(table, file.label)
            self.database.name_files(TABLES, {side: replace(stored, about=plain(file))})
            self.database.forget_files(ASKING, [side])


def written(table: pd.DataFrame) -> bytes:
    """A table of points as CSV."""
    return table.to_csv(index=False, lineterminator="\n").encode()


def _checked(file: PointFile) -> PointFile:
    if not can_be_shown(file.label) or file.suffix not in SUFFIXES:
        raise ValueError(file)
    return file
