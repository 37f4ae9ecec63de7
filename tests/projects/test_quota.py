"""Settings of the server, and its limit of the size of a project; what is removed makes room."""

import math
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from stereocal.matching.application import POINTS
from stereocal.matching.views import PAIRS
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import unpack_project
from stereocal.projects.contents import APPLIED
from stereocal.projects.home import duplicate
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from tests.pages.stored_projects import FULL, placed
from tests.refused import refused

LARGE = random.Random(1).randbytes(300_000)
ROWS = [f"{frame},A,1.5,2.5,3.5,4.5\n" for frame in range(12_000)]
TABLE = "".join(["frame,target,u_primary,v_primary,u_secondary,v_secondary\n", *ROWS]).encode()
REFUSED: dict[str, Callable[[Project], object]] = {
    "file": lambda project: project.give({"correspondences": ("p.csv", TABLE)}),
    "photographs": lambda project: ProjectPhotographs(project).keep("a.jpg", LARGE),
    "boards": lambda project: ProjectLens(project, "primary").keep("a.jpg", LARGE),
    "points": lambda project: ProjectApplication(project).ask("primary", "p.txt", LARGE),
    "copy": lambda project: duplicate(project.database.path.parents[1], project.id),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_too_much_is_refused_before_it_is_stored(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed(FULL, tmp_path)
    size = project.database.size
    limit = 0.1 if what == "copy" else 0.4
    monkeypatch.setenv("STEREOCAL_PROJECT_MB", str(limit))
    with refused(f"{limit} MB", f"{size / 1e6:.1f} MB"):
        REFUSED[what](project)
    assert project.database.size == size
    monkeypatch.setenv("STEREOCAL_PROJECT_MB", str(1))
    if what != "file":
        REFUSED[what](project)


def test_a_zip_from_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STEREOCAL_PROJECT_MB", str(0.1))
    with refused("0.1 MB"):
        unpack_project(FULL, "p.zip", tmp_path)
    assert list((tmp_path / "projects").iterdir()) == []


def test_results_are_kept_whatever_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed(FULL, tmp_path)
    found = project.calibration
    assert found is not None
    monkeypatch.setenv("STEREOCAL_PROJECT_MB", str(0.001))
    project.keep_calibration(found, project.inputs)
    project.keep_settings({"seed": 4})


def test_removed_photographs_make_room_at_once_and_nothing_else_goes(tmp_path: Path) -> None:
    project = placed(FULL, tmp_path)
    twin = duplicate(tmp_path, project.id)
    path = project.database.path
    before = path.stat().st_size
    ProjectPhotographs(project).clear()
    ProjectLens(project, "primary").clear()
    assert path.stat().st_size < before - 140_000
    assert project.dataset is not None and project.calibration is not None
    assert {PAIRS, POINTS} <= project.database.files(APPLIED).keys()
    assert len(ProjectPhotographs(twin).photographs) == 12


def test_what_is_given_holds_and_the_rest_is_as_on_a_persons_own_computer() -> None:
    read = ServerSettings.from_environment
    assert read({"STEREOCAL_SHARED": " "}) == ServerSettings(False, math.inf, 30.0)
    given = {"STEREOCAL_SHARED": "1", "STEREOCAL_KEEP_DAYS": "90", "STEREOCAL_UNDO_DAYS": "0"}
    assert read(given) == ServerSettings(True, 90.0, 0.0)


@pytest.mark.parametrize(("value", "workers"), [("1", 1), ("3.9", 3), ("inf", 1000)])
def test_workers(value: str, workers: int) -> None:
    assert ServerSettings.from_environment({"STEREOCAL_WORKERS": value}).workers == workers
