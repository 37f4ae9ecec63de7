"""The sample data: a table of points, or photographs of bar and boards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future

from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.projects.data_folder import default_home
from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph_files import is_photograph
from stereocal.ui.intake import clear_refusal, give_dataset, refuse
from stereocal.ui.jobs import pool
from stereocal.ui.project import SAMPLE, project_to_write

PHOTOGRAPHS = SAMPLE.parent / "photographs"
DESCRIPTION = ("dataset.json", "primary.json", "secondary.json")


def has_sample_photographs() -> bool:
    """Whether they are installed; they are optional, 22 MB."""
    return PHOTOGRAPHS.is_dir()


def begin_sample(making: list[Future[Project]], make: Callable[[], Project]) -> None:
    """Create a sample's project, which the next run of any page opens (a callback)."""
    making.append(pool().submit(make))


def sample_points() -> Project:
    """A project with the sample data set of points.

    Raises:
        StereocalError: the sample cannot be read, or the disk is full.
    """
    project = Project.create(default_home())
    give_dataset(project, pack_dataset(read_dataset(SAMPLE)), "sample data")
    return project


def sample_photographs() -> Project:
    """A project with photographs of the bar and of the boards, the lenses and the lengths.

    Raises:
        StereocalError: the sample cannot be read, or the disk is full.
    """
    project = Project.create(default_home())
    files = {name: (PHOTOGRAPHS / name).read_bytes() for name in DESCRIPTION}
    give_dataset(project, files, "sample photographs", _bars)
    _give_boards(project)
    return project


def load_sample_boards() -> None:
    """Add the sample's board photographs to the open project or a new one (a callback)."""
    try:
        _give_boards(project_to_write())
        clear_refusal()
    except StereocalError as error:
        refuse(error)


def _give_boards(project: Project) -> None:
    for which in CAMERAS:
        store = ProjectLens(project, which)
        found = _photographs(f"boards_{which}")
        store.add({name: store.keep(name, content) for name, content in found})


def _bars() -> Iterator[tuple[str, bytes]]:
    for which in CAMERAS:
        for name, content in _photographs(which):
            yield f"{which}/{name}", content


def _photographs(folder: str) -> Iterator[tuple[str, bytes]]:
    for path in sorted((PHOTOGRAPHS / folder).iterdir()):
        if is_photograph(path.name):
            yield path.name, path.read_bytes()
