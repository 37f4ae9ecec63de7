"""What the Apply page stores in a project, points, parameter files and the last result, and what
the Check page does: parameters to check, and new images."""

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from stereocal.errors import StereocalError, damaged
from stereocal.field.checking.to_check import ToCheck
from stereocal.fit.rig_file import RIG, Parameters, RigFile, is_rig, read_parameters
from stereocal.formats.other_files import refuse_other_camera
from stereocal.formats.point_answers import Answers, answered, answers_alike, layout_of
from stereocal.formats.point_files import read_points
from stereocal.formats.point_layouts import OURS
from stereocal.formats.point_text import point_text
from stereocal.formats.world_file import check_world
from stereocal.matching.application import POINTS, Application, Outcome, Points, apply_sets
from stereocal.matching.point_table import POINT, PointTable, is_parquet
from stereocal.projects.contents import APPLIED, ASKING, CHECK, POINT_FILES, SETS, TABLES, WORLD
from stereocal.projects.database import DamagedError
from stereocal.projects.files import StoredFile, loaded
from stereocal.projects.project import Project, ProjectPart
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system import latest
from stereocal.system.csv_text import csv_text
from stereocal.system.latest import once_or_refused
from stereocal.system.names import can_be_shown, label_of
from stereocal.system.records import of_plain, pack, plain
from stereocal.system.zip_files import pack_zip, unzip
from stereocal.workflow.given import to_check

Use = Literal["matching", "measuring"]
USES: tuple[Use, Use] = ("matching", "measuring")
Asked = str
"""What a file with open questions is for: a camera's points (`slot_of`), `bars`, `archive`,
`matching` or `measuring`."""
SUFFIXES = (".csv", ".parquet")
PARAMETERS, IMAGES = "parameters", "images"
"""The files of the Check page."""
CLICKED_IN = "points clicked in the"
"""How the labels of points begin that were clicked on the page."""
EARLIER = "image_sizes"
"""Key that only results of earlier versions have, which had no cameras."""


def slot_of(camera: str) -> Asked:
    """Where the points of a camera are: a name of its own alone could be that of another file."""
    return camera if camera in CAMERAS else f"camera {camera}"


def is_of_clicks(outcome: Outcome) -> bool:
    """Whether a result is of points that were clicked on the page."""
    return any(str(label).startswith(CLICKED_IN) for label in outcome.used.get("points", ()))


@dataclass(frozen=True)
class PointFile:
    """A point file and the table that was read from it."""

    label: str
    suffix: str
    rows: int
    frames: int
    answers: Answers | None = None
    """None if the file itself is `frame,u,v`."""

    def __post_init__(self) -> None:
        if not can_be_shown(self.label) or self.suffix not in SUFFIXES:
            raise ValueError(self)


class ProjectApplication(ProjectPart):
    """The Apply page's data of one project."""

    def __init__(self, project: Project) -> None:
        super().__init__(project)
        self._own: dict[str, pd.DataFrame] = {}
        """Tables of the project's own points, stored with a result computed from them."""

    # Points

    def point_file(self, side: Asked) -> PointFile | None:
        file = self.database.file(TABLES, side)
        with damaged("The list of point files is damaged; give them again.", DamagedError):
            return None if file is None else of_plain(file.about, PointFile)

    def points(self, side: Asked) -> Points | None:
        file, stored = self.point_file(side), self.database.file(TABLES, side)
        if file is None or stored is None:
            return None
        return Points(stored.name + file.suffix, file.label, file.rows, file.frames)

    def own_points(self, table: pd.DataFrame, label: str) -> Points:
        """Points of the project itself, used like those of a file."""
        name = f"{hashlib.sha256(_written(table)).hexdigest()}.csv"
        self._own[name] = table
        return Points(name, label, len(table), int(table["frame"].nunique()))

    def table(self, name: str) -> StoredFile:
        """The stored table of `Points.name`."""
        return StoredFile(Path(name).stem, self.database)

    def whole_table(self, name: str, label: str) -> pd.DataFrame:
        """All points of the table of `Points.name`."""
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            return pd.concat(list(self._opened(name, label, Path(folder)).blocks()))

    def _opened(self, name: str, label: str, folder: Path) -> PointTable:
        """A table of `Points.name`; one that is stored is copied to a folder, since libraries read
        only files.
        """
        if name in self._own:
            return PointTable(self._own[name], label=label)
        path = folder / Path(name).name
        self.table(name).copy_to(path)
        return PointTable(path, label=label)

    def offer_points(self, side: Asked, label: str, content: bytes) -> None:
        """Store a `frame,u,v` table; keep any other point file until questions are answered."""
        parquet = is_parquet(Path(label))
        content = content if parquet else point_text(content, label)
        if not parquet and layout_of(content, label).program != OURS:
            self.ask(side, label, content)
            self._answer_alike(side)
            return
        suffix = ".parquet" if parquet else ".csv"
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            path = Path(folder) / f"table{suffix}"
            path.write_bytes(content)
            contents = PointTable(path, label=label).check()
        file = PointFile(label_of(label), suffix, contents.rows, len(contents.frames))
        self._keep_points(side, content, content, file)

    # Files with open questions

    def ask(self, side: Asked, label: str, content: bytes) -> None:
        """Keep a file until the user has answered how to read it."""
        self.database.give(ASKING, side, label, content)

    def asking(self, side: Asked) -> tuple[str, bytes] | None:
        """Name and content of a file with open questions."""
        file = self.database.file(ASKING, side)
        return None if file is None else (file.label, file.read_bytes())

    def preview(self, side: Asked, answers: Answers, first_rows: int | None) -> pd.DataFrame:
        """The points of the file with open questions, as they would be read."""
        question = self.asking(side)
        if question is None:
            return pd.DataFrame(columns=["frame", *POINT])
        label, content = question
        layout = answered(layout_of(content, label), answers, content, label)
        return read_points(content, layout, answers.camera, answers.image_height, label, first_rows)

    def answer(self, side: Asked, answers: Answers) -> None:
        """Read the file with open questions as answered, and use it."""
        if (question := self.asking(side)) is None:
            return
        label, content = question
        table = self.preview(side, answers, None)
        if table.empty:
            raise StereocalError(f"{label}: there is no point of {answers.camera} in the file.")
        file = PointFile(label, ".csv", len(table), int(table["frame"].nunique()), answers)
        self._keep_points(side, content, _written(table), file)
        for other in CAMERAS:
            self._answer_alike(other)

    def _answer_alike(self, side: Asked) -> None:
        """Read the file of one of two cameras as that of the other, if its header is the same."""
        if side not in CAMERAS:
            return
        other = CAMERAS[side == CAMERAS[0]]
        question, file = self.asking(side), self.point_file(other)
        original = self.database.file(POINT_FILES, other)
        if question is None or file is None or file.answers is None or original is None:
            return
        answers = answers_alike(file.answers, question[1], question[0], original.read_bytes())
        if answers is not None:
            self.answer(side, answers)

    def ask_again(self, side: Asked) -> None:
        """Ask about the file in use again; it stays in use until answered."""
        with self.database.transaction():
            file, original = self.point_file(side), self.database.file(POINT_FILES, side)
            if file is not None and file.answers is not None and original is not None:
                self.database.name_files(ASKING, {side: original})

    def forget_question(self, side: Asked) -> None:
        self.database.forget_files(ASKING, [side])

    def _keep_points(self, side: Asked, original: bytes, table: bytes, file: PointFile) -> None:
        with self.database.transaction():
            self.database.give(POINT_FILES, side, file.label, original)
            stored = self.database.keep_file(table, file.label)
            self.database.name_files(TABLES, {side: replace(stored, about=plain(file))})
            self.database.forget_files(ASKING, [side])

    # Parameter files and the world frame

    def forget_rig(self) -> None:
        self.database.forget_files(SETS, [RIG])

    @property
    def rig_given(self) -> tuple[str, RigFile] | None:
        """Name and content of the rig.json given here."""
        file = self.database.file(SETS, RIG)
        return None if file is None else (file.label, RigFile.loads(file.read_bytes()))

    def keep_set(self, use: Use, label: str, content: bytes) -> None:
        """Store a parameter file, or rig.json to be used in place of them; another file is refused,
        and nothing changes."""
        read_parameters(content, label)
        slot = RIG if is_rig(content) else use
        with self.database.transaction():
            self.database.give(SETS, slot, label, content)
            self.database.forget_files(ASKING, [slot])

    def offer_set(self, use: Use, files: Mapping[str, bytes]) -> None:
        """Store a parameter file, or keep another program's files until questions are answered."""
        (label, content), *more = files.items()
        if not more and label.lower().endswith(".json"):
            self.keep_set(use, label, content)
            return
        if not more:
            refuse_other_camera(content, label, may_be_toml=True)
            files = unzip(content, label) if label.lower().endswith(".zip") else files
        self.ask(use, ", ".join([label, *(name for name, _ in more)]), pack_zip(files))

    def set_of(self, use: Use) -> tuple[str, RigParameters] | None:
        file = self.database.file(SETS, use)
        if file is None:
            return None
        return file.label, RigParameters.loads(file.read_bytes(), file.label)

    def keep_world(self, label: str, content: bytes, rig: Parameters) -> None:
        """Store a world frame, or a table for one, as of `check_world`."""
        check_world(content, label, rig)
        self.database.give(WORLD, WORLD, label, content)

    def forget_world(self) -> None:
        """Go back to the primary camera's frame."""
        self.database.forget_files(WORLD)

    @property
    def world_file(self) -> StoredFile | None:
        return self.database.file(WORLD, WORLD)

    # Results

    @property
    def result(self) -> tuple[Outcome, dict[str, StoredFile]] | None:
        """The last finished result and its tables, `pairs.csv` (of a rig `tracks.csv`) and
        `points.csv`.

        None also for a result that an earlier version stored in another form.
        """
        with self.database.reading():
            packed, files = self.database.result(APPLIED), self.database.files(APPLIED)
        with damaged(
            "The last result of this page is damaged; match and measure again.", DamagedError
        ):
            stored = None if packed is None else loaded(packed.decode())
            if stored is None or EARLIER in stored:
                return None
            outcome = of_plain(stored, Outcome)
            return outcome, {name: files[name] for name in (outcome.matched, POINTS)}

    def result_of(self, is_clicked: bool) -> tuple[Outcome, dict[str, StoredFile]] | None:
        """The last result; None if it is of points that were clicked here and others are in use, or
        of others and clicked ones are."""
        result = self.result
        return result if result and is_of_clicks(result[0]) == is_clicked else None

    def forget_result(self) -> None:
        """Delete the last result, so that it can be computed again."""
        with self.database.freeing():
            self.database.forget_files(APPLIED)
            self.database.keep_result(APPLIED, None)

    def run(self, work: Application, *how: Any) -> None:
        """Match and measure as `apply_sets`, and replace the last result."""
        names = [points.name for points in work.points.values()]
        with tempfile.TemporaryDirectory(prefix="stereocal-") as temporary:
            folder = Path(temporary)
            tables = {
                camera: self._opened(points.name, points.label, folder)
                for camera, points in work.points.items()
            }
            outcome = apply_sets(work, tables, folder, *how)
            results = outcome.matched, POINTS
            files = {name: self.database.keep_file(folder / name, name) for name in results}
        for name in self._own.keys() & {*names}:
            self.database.keep_file(_written(self._own[name]), name)
        with self.database.transaction():
            files |= {name: self.table(name) for name in names}
            self.database.replace_files(APPLIED, files)
            self.database.keep_result(APPLIED, pack(outcome))


class ProjectCheck(ProjectPart):
    """The Check page's files of one project: new bars or matched points, and parameters."""

    @property
    def of_images(self) -> Project:
        """What holds the new photographs: a project of its own in the same file."""
        return Project(self.database.of_page(CHECK))

    def keep_parameters(self, label: str, content: bytes) -> None:
        read_parameters(content, label)
        self.database.give(CHECK, PARAMETERS, label, content)

    def keep_images(self, label: str, content: bytes, rig: Parameters | None = None) -> None:
        """Store new images, if those of the parameters can be checked with them."""
        images = None if rig is None else to_check(content, label, rig)
        file = self.database.give(CHECK, IMAGES, label, content)
        if rig is not None and images is not None:
            latest.keep("images to check", _named(rig, file), images)

    def to_check(self, rig: Parameters, images: StoredFile) -> ToCheck:
        """Parameters with new images, which are read once."""
        return once_or_refused(
            "images to check",
            _named(rig, images),
            lambda: to_check(images.read_bytes(), images.label, rig),
        )

    def file(self, name: str) -> StoredFile | None:
        """`PARAMETERS` or `IMAGES`; None if not given."""
        return self.database.file(CHECK, name)


def _named(rig: Parameters, images: StoredFile) -> str:
    return f"{rig.digest} {images.sha256} {images.label}"


def _written(table: pd.DataFrame) -> bytes:
    return csv_text(table).encode()
