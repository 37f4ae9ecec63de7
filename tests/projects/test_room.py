"""The size of a project has a limit where the server sets one, and what is removed makes room."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from stereocal.projects.unused import free_unused

from stereocal.errors import StereocalError
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.files import size_of
from stereocal.projects.home import duplicate, sweep
from stereocal.projects.jobs import begin
from stereocal.projects.lens import ProjectLens
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.photograph_files import keep_photograph, unpack_photographs
from stereocal.system.zip_files import pack_zip
from tests.store_actions import check_whole, more_data, placed_full, state_of


def limited(patch: pytest.MonkeyPatch, megabytes: float) -> None:
    patch.setenv("STEREOCAL_PROJECT_MB", str(megabytes))


LARGE = bytes(300_000)
REFUSED: dict[str, Callable[[Project], object]] = {
    "file": lambda project: project.give({"correspondences": ("p.csv", LARGE)}),
    "data set": lambda project: project.add_dataset("more.zip", more_data() + LARGE),
    "photographs": lambda project: unpack_photographs(
        pack_zip({"a.jpg": LARGE}), "a.zip", ProjectPhotographs(project).files
    ),
    "boards": lambda project: unpack_photographs(
        pack_zip({"a.jpg": LARGE}), "a.zip", ProjectLens(project, "primary").files
    ),
    "points": lambda project: ProjectApplication(project).ask("primary", "p.txt", LARGE),
    "copy": lambda project: duplicate(project.folder.parents[1], project.id),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_too_much_is_refused_before_it_is_stored(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed_full(tmp_path)
    size, before = size_of(project.folder), state_of(project.folder)
    limited(monkeypatch, 0.1 if what == "copy" else 0.3)
    with pytest.raises(StereocalError, match=r"may take 0\.[13] MB on this server.*0\.2 MB"):
        REFUSED[what](project)
    assert size_of(project.folder) == size and state_of(project.folder) == before
    limited(monkeypatch, 1)
    if what in ("photographs", "boards", "points", "copy"):
        REFUSED[what](project)


def test_a_zip_from_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = placed_full(tmp_path)
    pack_project(project, tmp_path / "p.zip")
    limited(monkeypatch, 0.1)
    with pytest.raises(StereocalError, match=r"may take 0\.1 MB"):
        unpack_project(tmp_path / "p.zip", "p.zip", tmp_path / "there")
    assert list((tmp_path / "there" / "projects").iterdir()) == []


def test_results_are_kept_whatever_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed_full(tmp_path)
    found = project.calibration
    assert found is not None
    limited(monkeypatch, 0.001)
    project.keep_calibration(found, project.inputs)
    project.keep_settings({"seed": 4})
    frames = ProjectPhotographs(project).frames
    assert frames is not None


def test_removed_photographs_make_room_at_once_and_nothing_else_goes(tmp_path: Path) -> None:
    project = placed_full(tmp_path)
    twin = duplicate(tmp_path, project.id)
    photographs = ProjectPhotographs(project)
    assert len(list(photographs.files.iterdir())) == 12
    photographs.clear()
    assert not list(photographs.files.iterdir())
    ProjectLens(project, "primary").clear()
    assert not list(ProjectLens(project, "primary").files.iterdir())
    check_whole(project.folder)
    check_whole(twin.folder)
    assert len(ProjectPhotographs(twin).photographs) == 12


def test_while_a_job_may_need_them_photographs_stay_and_go_afterwards(tmp_path: Path) -> None:
    project = placed_full(tmp_path)
    job = begin(project.folder, "photographs", ["photographs searched"], {})
    assert job is not None
    photographs = ProjectPhotographs(project)
    photographs.clear()
    assert len(list(photographs.files.iterdir())) == 12
    job.end()
    assert free_unused(project.folder, 1e12) > 50_000
    assert not list(photographs.files.iterdir())


def test_a_sweep_frees_what_nothing_names_and_what_is_not_being_stored(tmp_path: Path) -> None:
    project = placed_full(tmp_path)
    store = ProjectPhotographs(project)
    stray = keep_photograph([b"stored, and not named yet"], "a.jpg", store.files)
    count = len(list(store.files.iterdir()))
    sweep(tmp_path, 30)
    assert stray.is_file() and len(list(store.files.iterdir())) == count
    now = stray.stat().st_mtime
    sweep(tmp_path, 30, clock=lambda: now + 2 * 86_400)
    assert not stray.is_file() and len(list(store.files.iterdir())) == count - 1
    check_whole(project.folder)


def test_photographs_that_went_while_they_were_stored_are_said(tmp_path: Path) -> None:
    project = placed_full(tmp_path)
    store = ProjectPhotographs(project)
    path = keep_photograph([b"x"], "a.jpg", store.files)
    path.unlink()
    with pytest.raises(StereocalError, match=r"a\.jpg has gone .* give it again"):
        store.add({"a.jpg": path})
    assert len(store.photographs) == 12


@pytest.mark.parametrize("list_name", ["photographs.json", "project.json"])
def test_where_a_list_is_damaged_its_files_stay(list_name: str, tmp_path: Path) -> None:
    project = placed_full(tmp_path)
    path = next(project.folder.rglob(list_name))
    folder = path.parent / ("files" if list_name == "photographs.json" else "inputs")
    count = len(list(folder.iterdir()))
    for damage in (b"{", b"[]", None):
        if damage is None and list_name == "project.json":
            continue
        path.unlink() if damage is None else path.write_bytes(damage)
        free_unused(project.folder, 1e12)
        assert len(list(folder.iterdir())) == count
