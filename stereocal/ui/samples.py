"""The sample data: a real recording, simulated points, or photographs of bar and boards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import TABLE
from stereocal.projects.application import ProjectApplication
from stereocal.projects.data_folder import default_home
from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph_files import is_photograph
from stereocal.system.resources import ROOT
from stereocal.ui.intake import clear_refusal, give_dataset, refuse
from stereocal.ui.jobs import pool
from stereocal.ui.project import project_to_write

SAMPLES = ROOT / "sample_data"
RECORDING, FIELD, PHOTOGRAPHS = (SAMPLES / name for name in ("recording", "field", "photographs"))
DESCRIPTION = ("dataset.json", "primary.json", "secondary.json")


def has_sample_photographs() -> bool:
    """Whether they are installed; they are optional, 11 MB."""
    return PHOTOGRAPHS.is_dir()


def begin_sample(making: list[Future[Project]], make: Callable[[], Project]) -> None:
    """Create a sample's project, which the next run of any page opens (a callback)."""
    making.append(pool().submit(make))


def real_recording() -> Project:
    """A project with the real recording; its middle marker is the points to match and measure.

    Raises:
        StereocalError: the sample cannot be read, or the disk is full.
    """
    project = Project.create(default_home())
    give_dataset(project, _files(RECORDING, (*DESCRIPTION, TABLE)), "real recording")
    store = ProjectApplication(project)
    for which in CAMERAS:
        name = f"points_{which}.csv"
        store.offer_points(which, name, (RECORDING / name).read_bytes())
    return project


def sample_points() -> Project:
    """A project with the simulated data set of points.

    Raises:
        StereocalError: the sample cannot be read, or the disk is full.
    """
    project = Project.create(default_home())
    give_dataset(project, _files(FIELD, (*DESCRIPTION, TABLE)), "sample data")
    return project


def sample_photographs() -> Project:
    """A project with photographs of the bar and of the boards, the lenses and the lengths.

    Raises:
        StereocalError: the sample cannot be read, or the disk is full.
    """
    project = Project.create(default_home())
    give_dataset(project, _files(PHOTOGRAPHS, DESCRIPTION), "sample photographs", _bars)
    _give_boards(project)
    return project


def load_sample_boards() -> None:
    """Add the sample's board photographs to the open project or a new one (a callback)."""
    try:
        _give_boards(project_to_write())
        clear_refusal()
    except StereocalError as error:
        refuse(error)


def _files(folder: Path, names: Sequence[str]) -> dict[str, bytes]:
    try:
        return {name: (folder / name).read_bytes() for name in names}
    except OSError as error:
        raise StereocalError(f"{folder} cannot be read: {error.strerror or error}.") from error


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
