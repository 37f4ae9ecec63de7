"""What the Apply page stores in a project: points, parameter files, the last result."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Literal

from stereocal.errors import DAMAGED, StereocalError
from stereocal.formats.other_files import refuse_other_camera
from stereocal.formats.world_tables import check_world
from stereocal.matching.application import PAIRS, POINTS, Application, Outcome, apply_sets
from stereocal.projects.files import StoredFile, loaded
from stereocal.projects.point_files import ASKING, ProjectPoints
from stereocal.projects.sqlite_errors import DamagedError
from stereocal.rig.parameters import RigParameters
from stereocal.system.records import of_plain, pack
from stereocal.system.zip_files import pack_zip, unzip

Use = Literal["matching", "measuring"]
USES: tuple[Use, Use] = ("matching", "measuring")
SETS, APPLIED, WORLD = "sets", "applied", "world"
EARLIER = "image_sizes"
"""Of the results of earlier versions, which had no cameras."""
"""Parts of a project: parameter files, tables of the last result, and the world frame's file."""


class ProjectApplication(ProjectPoints):
    """The Apply page's data of one project."""

    # Parameter files

    def keep_set(self, use: Use, label: str, content: bytes) -> None:
        """Store a parameter file.

        Raises:
            StereocalError: it is not a parameter file; nothing has changed.
        """
        parameters_in(content, label)
        with self.database.transaction():
            self.database.give(SETS, use, label, content)
            self.database.forget_files(ASKING, [use])

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
        """Name and content of a parameter file."""
        found = self.database.file(SETS, use)
        if found is None:
            return None
        return found.label, parameters_in(found.read_bytes(), found.label)

    # World frame

    def keep_world(self, label: str, content: bytes) -> None:
        """Store a file that says where the world frame is.

        Raises:
            StereocalError: it is neither a world frame nor a table for one; nothing has changed.
        """
        check_world(content, label)
        self.database.give(WORLD, WORLD, label, content)

    def forget_world(self) -> None:
        """Go back to the primary camera's frame."""
        with self.database.freeing():
            self.database.forget_files(WORLD)

    @property
    def world_file(self) -> StoredFile | None:
        """That file; None if not given."""
        return self.database.file(WORLD, WORLD)

    # Results

    @property
    def result(self) -> tuple[Outcome, dict[str, StoredFile]] | None:
        """The last finished result and its tables, `pairs.csv` and `points.csv`.

        None also for a result that an earlier version stored in another form.
        """
        with self.database.reading():
            packed = self.database.result(APPLIED)
            files = self.database.files(APPLIED)
        if packed is None:
            return None
        try:
            stored = loaded(packed.decode())
            if EARLIER in stored:
                return None
            return of_plain(stored, Outcome), {name: files[name] for name in (PAIRS, POINTS)}
        except DAMAGED as error:
            raise DamagedError(
                "The last result of this page is damaged; match and measure again."
            ) from error

    def forget_result(self) -> None:
        """Delete the last result, so that it can be computed again."""
        with self.database.freeing():
            self.database.forget_files(APPLIED)
            self.database.keep_result(APPLIED, None)

    def run(
        self,
        work: Application,
        begin: Callable[[str], None] | None = None,
        progress: Callable[[int, int], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        executor: Executor | None = None,
    ) -> bool:
        """Match and measure, and replace the last result; False if cancelled.

        Args as for `apply_sets`.

        Raises:
            StereocalError: as `apply_sets`; the last result stays.
        """
        with tempfile.TemporaryDirectory(prefix="stereocal-") as temporary:
            folder = Path(temporary)
            names = work.primary.name, work.secondary.name
            tables = self._copied(names[0], folder), self._copied(names[1], folder)
            outcome = apply_sets(work, tables, folder, begin, progress, cancelled, executor)
            if outcome is None:
                return False
            files = {name: self.database.keep_file(folder / name, name) for name in (PAIRS, POINTS)}
            for name in names:
                if name in self._own:
                    self.database.keep_file(self._own[name], name)
        files |= {name: self.table(name) for name in names}
        with self.database.transaction():
            self.database.replace_files(APPLIED, files)
            self.database.keep_result(APPLIED, pack(outcome))
        return True


def parameters_in(content: bytes, label: str) -> RigParameters:
    """The parameter set of an uploaded file."""
    try:
        return RigParameters.loads(content.decode("utf-8-sig"), label)
    except UnicodeDecodeError as error:
        raise StereocalError(f"{label}: this is not a text file (JSON in UTF-8).") from error
