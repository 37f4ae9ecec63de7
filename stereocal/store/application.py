"""What the Apply page holds of a project on disk: points, parameter files, the last result.

Below the project's folder, in `apply/`:

- `files/<digest>-<what>`: point and parameter files as given, and tables read from them.
- `apply.json`: which of them are current, what was answered about them.
- `results/<name>/`: `pairs.csv` and `points.csv`; `result.json` names the folder and says what was
  done. It is replaced in one step, so that what it names is always complete.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.parquet import PARQUET
from stereocal.formats.point_answers import OURS, Answers, answered, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.point_table import PointTable
from stereocal.parameters import RigParameters
from stereocal.points.application import Application, Outcome, Points, apply_sets
from stereocal.points.pairs import POINT
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.writing import write_atomically

STORE_FORMAT = "stereocal-apply/1"
Side = Literal["primary", "secondary"]
SIDES: tuple[Side, Side] = ("primary", "secondary")
Asked = Literal["primary", "secondary", "bars"]
Use = Literal["matching", "measuring"]
USES: tuple[Use, Use] = ("matching", "measuring")
_WRITING = threading.Lock()


@dataclass(frozen=True)
class PointFile:
    """A point file as given, and the table that was read from it."""

    label: str
    stored: str
    table: str
    """The same as `stored` where the file is `frame,u,v` itself."""
    rows: int
    frames: int
    answers: Mapping[str, Any] | None = None


class ProjectApplication:
    """What the Apply page knows of one project. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.folder = project.folder / "apply"
        self.files = self.folder / "files"

    # Points

    def point_file(self, side: Side) -> PointFile | None:
        """The file in use."""
        found = self._read()["points"].get(side)
        try:
            return None if found is None else PointFile(**found)
        except TypeError as error:
            raise StereocalError(f"The list of point files is damaged ({error}).") from error

    def points(self, side: Side) -> Points | None:
        """The points in use, with what messages call them."""
        file = self.point_file(side)
        if file is None:
            return None
        return Points(own_file(self.files, file.table), file.label, file.rows, file.frames)

    def asking(self, side: Asked) -> tuple[str, bytes] | None:
        """Name and content of a file that cannot be used before a person has answered."""
        found = self._read()["asking"].get(side)
        return None if found is None else (found[0], own_file(self.files, found[1]).read_bytes())

    def offer_points(self, side: Side, label: str, content: bytes) -> None:
        """Take over a `frame,u,v` table; ask about any other point file.

        Raises:
            StereocalError: it holds no points, or rows that cannot be used; nothing has changed.
        """
        parquet = Path(label).suffix.lower() in PARQUET
        if parquet or layout_of(content, label).program == OURS:
            stored = self._store(content, ".parquet" if parquet else ".csv")
            self._keep_points(side, label, stored, stored, None)
            return
        self.ask(side, label, content)

    def ask(self, side: Asked, label: str, content: bytes) -> None:
        """Keep a file until a person has said how it is to be read."""
        stored = self._store(content, ".txt")
        self._change(lambda state: state["asking"].update({side: [label, stored]}))

    def answer(self, side: Side, answers: Answers) -> None:
        """Read the file that was asked about as the answers say, and use it.

        Raises:
            StereocalError: it cannot be read that way; nothing has changed.
        """
        found = self._read()["asking"].get(side)
        if found is None:
            return
        label, stored = found
        table = self.preview(side, answers, None)
        if table.empty:
            raise StereocalError(f"{label}: there is no point of {answers.camera} in the file.")
        written = self._store(table.to_csv(index=False, lineterminator="\n").encode(), ".csv")
        self._keep_points(side, label, stored, written, answers)

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
        file = self.point_file(side)
        if file is not None and file.answers is not None:
            again = [file.label, file.stored]
            self._change(lambda state: state["asking"].update({side: again}))

    def forget_question(self, side: Asked) -> None:
        """Put aside the file that is asked about."""
        self._change(lambda state: state["asking"].pop(side, None))

    def own_points(self, table: pd.DataFrame, label: str) -> Points:
        """Points of the project itself as a table on disk, so that they are applied like others."""
        stored = self._store(table.to_csv(index=False, lineterminator="\n").encode(), ".csv")
        return Points(self.files / stored, label, len(table), int(table["frame"].nunique()))

    # Parameter files

    def keep_set(self, use: Use, label: str, content: bytes) -> None:
        """Take over a parameter file.

        Raises:
            StereocalError: it is none; nothing has changed.
        """
        try:
            RigParameters.loads(content.decode("utf-8-sig"), label)
        except UnicodeDecodeError as error:
            raise StereocalError(f"{label}: this is not a text file (JSON in UTF-8).") from error
        stored = self._store(content, ".json")
        self._change(lambda state: state["sets"].update({use: [label, stored]}))

    def set_of(self, use: Use) -> tuple[str, RigParameters] | None:
        """Name and content of a parameter file."""
        found = self._read()["sets"].get(use)
        if found is None:
            return None
        label, stored = found
        text = own_file(self.files, stored).read_text(encoding="utf-8-sig")
        return label, RigParameters.loads(text, label)

    # Results

    @property
    def result(self) -> tuple[Outcome, Path] | None:
        """The last finished result and the folder with its tables; None before the first."""
        path = self.folder / "result.json"
        if not path.is_file():
            return None
        try:
            content = json.loads(path.read_bytes())
            folder = own_file(self.folder / "results", content["folder"])
            return Outcome(**content["outcome"]), folder
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StereocalError("The last result of this page cannot be read.") from error

    def run(
        self,
        work: Application,
        begin: Callable[[str], None] | None = None,
        progress: Callable[[int, int], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> bool:
        """Match and measure, and keep the result in place of the last; False if cancelled.

        Raises:
            StereocalError: it cannot be done; the last result stays.
        """
        results = self.folder / "results"
        results.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(dir=results))
        kept = False
        try:
            outcome = apply_sets(work, folder, begin, progress, cancelled)
            if outcome is not None:
                before = self.result
                content = {"outcome": outcome.to_json(), "folder": folder.name}
                text = json.dumps(content, indent=1)
                write_atomically(self.folder / "result.json", text.encode())
                kept = True
                if before is not None:
                    shutil.rmtree(before[1], ignore_errors=True)
        finally:
            if not kept:
                shutil.rmtree(folder, ignore_errors=True)
        return kept

    # On disk

    def _keep_points(
        self, side: Side, label: str, stored: str, table: str, answers: Answers | None
    ) -> None:
        contents = PointTable(self.files / table, POINT, label).check()
        file = PointFile(
            label, stored, table, contents.rows, len(contents.frames),
            None if answers is None else answers.to_json(),
        )  # fmt: skip

        def edit(state: dict[str, Any]) -> None:
            state["points"][side] = asdict(file)
            state["asking"].pop(side, None)

        self._change(edit)

    def _store(self, content: bytes, suffix: str) -> str:
        name = f"{hashlib.sha256(content).hexdigest()[:20]}{suffix}"
        if not (self.files / name).is_file():
            write_atomically(self.files / name, content)
        return name

    def _change(self, edit: Callable[[dict[str, Any]], object]) -> None:
        with _WRITING:
            state = self._read()
            edit(state)
            text = json.dumps(state, indent=1, allow_nan=False)
            write_atomically(self.folder / "apply.json", text.encode())

    def _read(self) -> dict[str, Any]:
        path = self.folder / "apply.json"
        if not path.is_file():
            return {"format": STORE_FORMAT, "points": {}, "asking": {}, "sets": {}}
        try:
            state: dict[str, Any] = json.loads(path.read_bytes())
        except (OSError, ValueError) as error:
            raise StereocalError(f"The files of this page cannot be read ({error}).") from error
        if state.get("format") != STORE_FORMAT:
            raise StereocalError("The files of this page were stored by another version.")
        return state
