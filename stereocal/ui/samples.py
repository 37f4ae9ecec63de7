"""The sample data: a real recording, simulated points, or photographs of bar and boards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path

from stereocal.errors import StereocalError, disk_errors
from stereocal.formats.dataset_files import TABLE
from stereocal.formats.recording_files import POINTS
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
RECORDING, FIELD, PHOTOGRAPHS, RIG = (
    SAMPLES / name for name in ("recording", "field", "photographs", "rig")
)
DESCRIPTION = ("dataset.json", "primary.json", "secondary.json")


def has_sample_photographs() -> bool:
    """Whether they are installed; they are optional, 11 MB."""
    return PHOTOGRAPHS.is_dir()


def begin_sample(making: list[Future[Project]], make: Callable[[], Project]) -> None:
    """Create a sample's project, which the next run of any page opens (a callback)."""
    making.append(pool().submit(make))


def real_recording() -> Project:
    """A project with the real recording; its middle marker is the points to match and measure."""
    project = Project.create(default_home())
    give_dataset(project, _files(RECORDING, (*DESCRIPTION, TABLE)), "real recording")
    store = ProjectApplication(project)
    for which in CAMERAS:
        name = f"points_{which}.csv"
        store.offer_points(which, name, (RECORDING / name).read_bytes())
    return project


def three_cameras() -> Project:
    """A project with the real recording of three cameras."""
    project = Project.create(default_home())
    cameras = [path.name for path in sorted(RIG.glob("*.yaml"))]
    names = [DESCRIPTION[0], POINTS, *cameras]
    give_dataset(project, _files(RIG, names), "three cameras")
    return project


def sample_points() -> Project:
    """A project with the simulated data set of points."""
    project = Project.create(default_home())
    give_dataset(project, _files(FIELD, (*DESCRIPTION, TABLE)), "sample data")
    return project


def sample_photographs() -> Project:
    """A project with photographs of the bar and of the boards, the lenses and the lengths."""
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
    with disk_errors(f"{folder} cannot be read"):
        return {name: (folder / name).read_bytes() for name in names}


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
