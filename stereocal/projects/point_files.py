"""The points of both cameras that a project holds, to be matched and measured."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from stereocal.errors import DAMAGED, StereocalError, can_be_shown
from stereocal.formats.point_answers import OURS, Answers, answered, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.sleap_h5 import point_text
from stereocal.matching.application import Points
from stereocal.matching.pairs import POINT
from stereocal.matching.parquet import PARQUET
from stereocal.matching.point_table import PointTable
from stereocal.projects.files import (
    StoredFile,
    about_files,
    files_of,
    forget_files,
    keep_file,
    name_files,
)
from stereocal.projects.project import Project
from stereocal.projects.refusals import DamagedError

Side = Literal["primary", "secondary"]
SIDES: tuple[Side, Side] = ("primary", "secondary")
Asked = Literal["primary", "secondary", "bars", "matching", "measuring"]
SUFFIXES = (".csv", ".parquet")
POINT_FILES, TABLES, ASKING = "points", "tables", "asking"
"""Parts of a project: point files as given, the tables read from them, and files that wait for an
answer."""


@dataclass(frozen=True)
class PointFile:
    """What is known of a point file and of the table that was read from it."""

    label: str
    suffix: str
    """Of the table."""
    rows: int
    frames: int
    answers: Mapping[str, Any] | None = None
    """None where the file is `frame,u,v` itself."""


class ProjectPoints:
    """The point files of one project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database
        self._own: dict[str, bytes] = {}
        """Tables of the project's own points, which are stored with a result made of them."""

    def point_file(self, side: Side) -> PointFile | None:
        """The file in use."""
        found = about_files(self.database, TABLES).get(side)
        try:
            return None if found is None else _checked(PointFile(**found))
        except DAMAGED as error:
            raise DamagedError("The list of point files is damaged; give them again.") from error

    def points(self, side: Side) -> Points | None:
        """The points in use, with what messages call them."""
        file = self.point_file(side)
        if file is None:
            return None
        stored = files_of(self.database, TABLES)[side]
        return Points(stored.name + file.suffix, file.label, file.rows, file.frames)

    @contextmanager
    def opened(self, name: str) -> Iterator[Path]:
        """A temporary file with a table of points, for what reads only files.

        Args:
            name: as in `Points.name`.

        Raises:
            StereocalError: it has gone, or the disk is full.
        """
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            yield self._copied(name, Path(folder))

    def table(self, name: str) -> StoredFile:
        """A table of points, as the file that was given or was read from it."""
        return StoredFile(Path(name).stem, self.database)

    def _copied(self, name: str, folder: Path) -> Path:
        if name not in self._own:
            return self.table(name).copy_to(folder / Path(name).name)
        (folder / name).write_bytes(self._own[name])
        return folder / name

    def asking(self, side: Asked) -> tuple[str, bytes] | None:
        """Name and content of a file that cannot be used before a person has answered."""
        with self.database.reading():
            file = files_of(self.database, ASKING).get(side)
            label = about_files(self.database, ASKING).get(side)
        return None if file is None else (str(label), file.read_bytes())

    def offer_points(self, side: Side, label: str, content: bytes) -> None:
        """Take over a `frame,u,v` table; ask about any other point file.

        Raises:
            StereocalError: it holds no points, or rows that cannot be used; nothing has changed.
        """
        parquet = Path(label).suffix.lower() in PARQUET
        content = content if parquet else point_text(content, label)
        if parquet or layout_of(content, label).program == OURS:
            self._keep_points(side, label, content, content, ".parquet" if parquet else ".csv")
            return
        self.ask(side, label, content)

    def ask(self, side: Asked, label: str, content: bytes) -> None:
        """Keep a file until a person has said how it is to be read."""
        with self.database.act():
            self._name(ASKING, side, content, label, label)

    def answer(self, side: Side, answers: Answers) -> None:
        """Read the file that was asked about as the answers say, and use it.

        Raises:
            StereocalError: it cannot be read that way; nothing has changed.
        """
        found = self.asking(side)
        if found is None:
            return
        label, content = found
        table = self.preview(side, answers, None)
        if table.empty:
            raise StereocalError(f"{label}: there is no point of {answers.camera} in the file.")
        written = table.to_csv(index=False, lineterminator="\n").encode()
        self._keep_points(side, label, content, written, ".csv", answers)

    def preview(self, side: Side, answers: Answers, first_rows: int | None) -> pd.DataFrame:
        """The points of the file that is asked about, as they would be read.

        Raises:
            StereocalError: it cannot be read that way.
        """
        found = self.asking(side)
        if found is None:
            return pd.DataFrame(columns=["frame", *POINT])
        label, content = found
        layout = answered(layout_of(content, label), answers, content, label)
        return read_points(content, layout, answers.camera, answers.image_height, label, first_rows)

    def ask_again(self, side: Side) -> None:
        """Ask about the file in use once more; it stays in use until then."""
        with self.database.act():
            file = self.point_file(side)
            if file is not None and file.answers is not None:
                given = files_of(self.database, POINT_FILES)[side]
                name_files(self.database, ASKING, {side: given}, file.label)

    def forget_question(self, side: Asked) -> None:
        """Put aside the file that is asked about."""
        self.database.free(lambda _db: forget_files(self.database, ASKING, [side]))

    def own_points(self, table: pd.DataFrame, label: str) -> Points:
        """Points of the project itself, so that they are applied like others."""
        content = table.to_csv(index=False, lineterminator="\n").encode()
        name = f"{hashlib.sha256(content).hexdigest()}.csv"
        self._own[name] = content
        return Points(name, label, len(table), int(table["frame"].nunique()))

    def _keep_points(
        self, side: Side, label: str, given: bytes, table: bytes, suffix: str,
        answers: Answers | None = None,
    ) -> None:  # fmt: skip
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            path = Path(folder) / f"table{suffix}"
            path.write_bytes(table)
            contents = PointTable(path, POINT, label).check()
        file = PointFile(
            label, suffix, contents.rows, len(contents.frames),
            None if answers is None else answers.to_json(),
        )  # fmt: skip
        with self.database.act():
            self._name(POINT_FILES, side, given, label, label)
            self._name(TABLES, side, table, label, asdict(file))
            forget_files(self.database, ASKING, [side])

    def _name(self, part: str, name: str, content: bytes, label: str, about: Any) -> None:
        name_files(self.database, part, {name: keep_file(self.database, content, label)}, about)


def _checked(file: PointFile) -> PointFile:
    if (
        not can_be_shown(file.label)
        or file.suffix not in (".csv", ".parquet")
        or not isinstance(file.rows, int)
        or not isinstance(file.frames, int)
    ):
        raise TypeError(file)
    return file
