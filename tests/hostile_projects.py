"""A whole project on disk; one of its files becomes hostile, and all of it is read."""

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from stereocal.calibration.methods import errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import summarise
from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.application import USES, ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.home import recent_projects
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import read_review, thumbnail
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.zip_files import pack_zip, unzip
from tests.pages.stored_projects import FULL, placed
from tests.rigs.known_rig import BAR_M, BASELINE_M, PRIMARY, SECONDARY, correspondences

FRAMES = 8


@dataclass(frozen=True)
class Inner:
    """A file of a project's zip."""

    kind: str
    member: str

    def seeds(self) -> Sequence[bytes]:
        """The sound file."""
        return [_members()[self.member]]


FILES = {
    "project.json": Inner("json", "project.json"),
    "camera": Inner("json", "inputs/primary.json"),
    "points": Inner("text", "inputs/correspondences.csv"),
    "more": Inner("zip", "datasets/000000.zip"),
    "calibration.json": Inner("json", "results/calibration.json"),
    "evaluation.npz": Inner("npz", "results/evaluation.npz"),
    "frames.json": Inner("json", "results/frames.json"),
    "boards.npz": Inner("npz", "results/boards_primary.npz"),
    "lens.npz": Inner("npz", "results/lens_primary.npz"),
    "result.json": Inner("json", "results/applied.json"),
}


def dataset() -> Pair:
    """A small one."""
    rows = correspondences(FRAMES, 0.1)
    known = Recording.of_two("small", PRIMARY, SECONDARY, BASELINE_M, BAR_M)
    return known.holding(rows).pair(*CAMERAS)


def dataset_zip() -> bytes:
    """The small one as a person gives it."""
    return pack_zip(pack_dataset(dataset()))


@cache
def project_zip() -> bytes:
    """A project with all that a project can have, carried."""
    with tempfile.TemporaryDirectory() as folder:
        project, target = placed(FULL, Path(folder)), Path(folder) / "project.zip"
        project.add_dataset("more.zip", dataset_zip())
        assert project.table is not None
        # Given, it is read; what was detected is not.
        project.give({"correspondences": ("points.csv", project.table[1])})
        pack_project(project, target)
        return target.read_bytes()


def read_project_zip(content: bytes, folder: Path) -> None:
    """Open a project's zip and read all of it, as the pages would."""
    project = unpack_project(content, "p.zip", folder)
    try:
        recent_projects(folder)
        read_whole(project)
    finally:
        shutil.rmtree(folder / "projects", ignore_errors=True)


def read_inner(name: str, content: bytes) -> None:
    """Open the project's zip with another content of one of its files, and read all of it."""
    with tempfile.TemporaryDirectory() as folder:
        changed = pack_zip({**_members(), FILES[name].member: content})
        project = unpack_project(changed, "p.zip", Path(folder))
        read_whole(project)
        if name == "evaluation.npz" and (evaluation := project.evaluation):
            summarise(evaluation.runs)


def read_whole(project: Project) -> None:
    """All that pages read of a project, and the first that they do with it.

    Raises:
        StereocalError: the last of what was refused; all else has been read all the same.
    """
    refused: StereocalError | None = None
    for read in _reads(project):
        try:
            read()
        except StereocalError as error:
            refused = error
    if refused is not None:
        raise refused


def _reads(project: Project) -> Iterator[Callable[[], object]]:
    photographs, apply = ProjectPhotographs(project), ProjectApplication(project)
    yield lambda: Project.open(project.database.path.parents[1], project.id)
    yield lambda: (project.inputs.missing, project.settings, project.table, project.cameras)
    yield lambda: project.dataset
    yield lambda: project.more_datasets
    yield lambda: _use_calibration(project)
    yield lambda: project.evaluation
    yield lambda: (photographs.photographs, photographs.proposal.pairing.sentence, photographs.rows)
    yield lambda: [
        thumbnail(photographs, frame.files, frame.centres)
        for frame in (photographs.frames or [])[:1]
    ]
    yield lambda: read_review(photographs)
    for which in CAMERAS:
        lens = ProjectLens(project, which)
        yield from (
            partial(getattr, lens, name)
            for name in ("photographs", "search", "calibration", "is_used")
        )
    for side in CAMERAS:
        yield from (partial(apply.points, side), partial(apply.asking, side))
    yield from (partial(apply.set_of, use) for use in USES)
    yield lambda: apply.result


def _use_calibration(project: Project) -> None:
    calibration = project.calibration
    if calibration is not None:
        for method in ("2d", "3d"):
            calibration.parameters(method).dumps()
        for found in calibration.methods.values():
            errors_of(calibration.dataset, found.pose)


@cache
def _members() -> dict[str, bytes]:
    """The files of that zip."""
    return unzip(project_zip(), "p.zip")
