"""What the Apply page holds of a project on disk: points, parameter files, the last result.

Below the project's folder, in `apply/`:

- `files/<digest>-<what>`: point and parameter files as given, and tables read from them.
- `apply.json`: which of them are current, what was answered about them.
- `results/<name>/`: `pairs.csv` and `points.csv`; `result.json` names the folder and says what was
  done. It is replaced in one step when the folder is on the disk: what it names is complete.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from stereocal.errors import DAMAGED, StereocalError, can_be_shown
from stereocal.formats.other_files import refuse_other_camera
from stereocal.formats.point_answers import OURS, Answers, answered, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.sleap_h5 import point_text
from stereocal.locking import locked
from stereocal.matching.application import PAIRS, POINTS, Application, Outcome, Points, apply_sets
from stereocal.matching.blocks import TableBlock
from stereocal.matching.pairs import POINT
from stereocal.matching.parquet import PARQUET
from stereocal.matching.point_table import PointTable
from stereocal.project import Project
from stereocal.rig.parameters import RigParameters
from stereocal.store.folders import own_file
from stereocal.store.room import check_room
from stereocal.store.state import DamagedError, StateFile, changing, forget, read_if_there
from stereocal.system.atomic_files import flush_folder, make_folder, write_atomically
from stereocal.system.tasks import Pieces
from stereocal.system.zip_files import pack_zip, unzip

STORE_FORMAT = "stereocal-apply/1"
Side = Literal["primary", "secondary"]
SIDES: tuple[Side, Side] = ("primary", "secondary")
Asked = Literal["primary", "secondary", "bars", "matching", "measuring"]
Use = Literal["matching", "measuring"]
USES: tuple[Use, Use] = ("matching", "measuring")
_AGAIN = "give the points and the parameter files of this page again"


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
        self._file = StateFile(
            project.folder, self.folder / "apply.json", STORE_FORMAT, _check,
            {"points": {}, "asking": {}, "sets": {}}, "The list of files of this page", _AGAIN,
        )  # fmt: skip

    # Points

    def point_file(self, side: Side) -> PointFile | None:
        """The file in use."""
        found = self._file.read()["points"].get(side)
        return None if found is None else PointFile(**found)

    def points(self, side: Side) -> Points | None:
        """The points in use, with what messages call them."""
        file = self.point_file(side)
        if file is None:
            return None
        return Points(own_file(self.files, file.table), file.label, file.rows, file.frames)

    def asking(self, side: Asked) -> tuple[str, bytes] | None:
        """Name and content of a file that cannot be used before a person has answered."""
        found = self._file.read()["asking"].get(side)
        return None if found is None else (found[0], self._content(found[1], found[0]))

    def offer_points(self, side: Side, label: str, content: bytes) -> None:
        """Take over a `frame,u,v` table; ask about any other point file.

        Raises:
            StereocalError: it holds no points, or rows that cannot be used; nothing has changed.
        """
        parquet = Path(label).suffix.lower() in PARQUET
        content = content if parquet else point_text(content, label)
        if parquet or layout_of(content, label).program == OURS:
            stored = self._store(content, ".parquet" if parquet else ".csv")
            self._keep_points(side, label, stored, stored, None)
            return
        self.ask(side, label, content)

    def ask(self, side: Asked, label: str, content: bytes) -> None:
        """Keep a file until a person has said how it is to be read."""
        stored = self._store(content, ".txt")
        with self._changed() as state:
            state["asking"][side] = [label, stored]

    def answer(self, side: Side, answers: Answers) -> None:
        """Read the file that was asked about as the answers say, and use it.

        Raises:
            StereocalError: it cannot be read that way; nothing has changed.
        """
        found = self._file.read()["asking"].get(side)
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
            with self._changed() as state:
                state["asking"][side] = [file.label, file.stored]

    def forget_question(self, side: Asked) -> None:
        """Put aside the file that is asked about."""
        with self._changed() as state:
            state["asking"].pop(side, None)

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
        with self._changed() as state:
            state["sets"][use] = [label, stored]
            state["asking"].pop(use, None)

    def offer_set(self, use: Use, files: Mapping[str, bytes]) -> None:
        """Take over a parameter file; ask about the files of any other program.

        Raises:
            StereocalError: they are none; nothing has changed.
        """
        (label, content), *more = files.items()
        if not more and label.lower().endswith(".json"):
            self.keep_set(use, label, content)
            return
        if not more:
            refuse_other_camera(content, label, may_be_toml=True)
            files = unzip(content, label) if label.lower().endswith(".zip") else files
        stored = self._store(pack_zip(files), ".zip")
        with self._changed() as state:
            state["asking"][use] = [", ".join([label, *(name for name, _ in more)]), stored]

    def set_of(self, use: Use) -> tuple[str, RigParameters] | None:
        """Name and content of a parameter file."""
        found = self._file.read()["sets"].get(use)
        if found is None:
            return None
        label, stored = found
        content = self._content(stored, label)
        try:
            return label, RigParameters.loads(content.decode("utf-8-sig"), label)
        except UnicodeDecodeError as error:
            raise StereocalError(f"{label} is damaged; give it again.") from error

    # Results

    @property
    def result(self) -> tuple[Outcome, Path] | None:
        """The last finished result and the folder with its tables; None before the first."""
        again = "match and measure again"
        packed = read_if_there(self.folder / "result.json", again)
        if packed is None:
            return None
        try:
            content = json.loads(packed)
            folder = own_file(self.folder / "results", content["folder"])
            outcome = Outcome(**content["outcome"])
        except DAMAGED as error:
            raise StereocalError(f"The last result of this page is damaged; {again}.") from error
        for name in (PAIRS, POINTS):
            if not (folder / name).is_file():
                raise StereocalError(f"{name} of the last result has gone; {again}.")
        return outcome, folder

    def forget_result(self) -> None:
        """Forget the last result, so that it can be made anew."""
        with changing(self.project.folder):
            forget(self.folder / "result.json")

    def run(
        self,
        work: Application,
        begin: Callable[[str], None] | None = None,
        progress: Callable[[int, int], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        executor: Executor | None = None,
        pieces: Pieces[TableBlock] | None = None,
    ) -> bool:
        """Match and measure, and keep the result in place of the last; False if cancelled.

        Args as for `apply_sets`.

        Raises:
            StereocalError: it cannot be done; the last result stays.
        """
        folder = self._new_result()
        kept = False
        try:
            with locked(folder):  # so that nobody sweeps it
                outcome = apply_sets(work, folder, begin, progress, cancelled, executor, pieces)
                if outcome is not None:
                    self._keep_result(outcome, folder)
                    kept = True
        finally:
            if not kept and self._result_name() != folder.name:
                shutil.rmtree(folder, ignore_errors=True)
        return kept

    def _result_name(self) -> str | None:
        """The folder that `result.json` names; "" where that cannot be told."""
        try:
            name = json.loads((self.folder / "result.json").read_bytes())["folder"]
        except FileNotFoundError:
            return None
        except DAMAGED:
            return ""
        return str(name)

    def _new_result(self) -> Path:
        results = self.folder / "results"
        try:
            make_folder(results)
            folder = Path(tempfile.mkdtemp(dir=results))
            flush_folder(results)
        except OSError as error:
            raise StereocalError(
                f"The result cannot be stored: {error.strerror or error}."
            ) from error
        return folder

    def _keep_result(self, outcome: Outcome, folder: Path) -> None:
        content = {"outcome": outcome.to_json(), "folder": folder.name}
        text = json.dumps(content, indent=1)
        with changing(self.project.folder):
            try:
                before = self.result
            except StereocalError:  # damaged: this one takes its place
                before = None
            write_atomically(self.folder / "result.json", text.encode())
        if before is not None:
            shutil.rmtree(before[1], ignore_errors=True)

    # On disk

    def _keep_points(
        self, side: Side, label: str, stored: str, table: str, answers: Answers | None
    ) -> None:
        contents = PointTable(self.files / table, POINT, label).check()
        file = PointFile(
            label, stored, table, contents.rows, len(contents.frames),
            None if answers is None else answers.to_json(),
        )  # fmt: skip

        with self._changed() as state:
            state["points"][side] = asdict(file)
            state["asking"].pop(side, None)

    def _store(self, content: bytes, suffix: str) -> str:
        name = f"{hashlib.sha256(content).hexdigest()[:20]}{suffix}"
        path = self.files / name
        if not path.is_file() or path.read_bytes() != content:
            check_room(path, len(content))
            write_atomically(path, content)
        with suppress(OSError):
            os.utime(path)  # the sweep takes what nothing names only when it is a day old
        return name

    def _content(self, stored: str, label: str) -> bytes:
        try:
            return own_file(self.files, stored).read_bytes()
        except OSError as error:
            raise StereocalError(f"{label} has gone from the project; give it again.") from error

    @contextmanager
    def _changed(self) -> Iterator[dict[str, Any]]:
        """The list of files, to be edited; one that is damaged is begun anew."""
        with changing(self.project.folder):
            try:
                state = self._file.read()
            except DamagedError:
                state = self._file.blank()
            yield state
            self._file.write(state)


def _check(state: dict[str, Any]) -> None:
    for found in state["points"].values():
        file = PointFile(**found)
        texts = can_be_shown(file.label), can_be_shown(file.stored), can_be_shown(file.table)
        if not all(texts) or not isinstance(file.rows, int) or not isinstance(file.frames, int):
            raise TypeError(file)
    for kind in ("asking", "sets"):
        for label, stored in state[kind].values():
            if not can_be_shown(label) or not isinstance(stored, str):
                raise TypeError(label)
