"""Photographs that are given again, or replaced, after targets were found in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.frames.review import choose
from stereocal.projects.inputs import Slot
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review
from stereocal.rig.camera import Camera
from stereocal.system.photograph_files import keep_photograph
from tests.store_actions import placed_full


@pytest.fixture
def store(tmp_path: Path) -> ProjectPhotographs:
    """Of a project in whose photographs targets were found and corrected."""
    return ProjectPhotographs(placed_full(tmp_path))


def camera_files(project: Project, change: float = 1.0) -> dict[Slot, tuple[str, bytes]]:
    """Its cameras, with images of another size."""
    primary, secondary = project.cameras
    assert primary is not None and secondary is not None

    def other(camera: Camera) -> bytes:
        width, height = camera.image_size
        return write_camera(replace(camera, image_size=(int(width * change), int(height * change))))

    return {"primary": ("p.json", other(primary)), "secondary": ("s.json", other(secondary))}


def replaced(store: ProjectPhotographs, name: str) -> None:
    """Another photograph under a name that is there already."""
    store.add({name: keep_photograph([b"another"], name, store.files)})


def test_what_was_corrected_stays_with_the_same_photographs(store: ProjectPhotographs) -> None:
    project, frames, edits = store.project, store.frames, read_review(store).edits
    table = project.table
    assert edits and table is not None
    store.give(camera_files(project), store.photographs, baseline_m=7.5)
    assert project.inputs.baseline_m == 7.5
    assert store.frames == frames and read_review(store).edits == edits
    assert project.table == table


def test_where_no_frame_is_used_the_data_set_is_taken_without_a_table(
    store: ProjectPhotographs,
) -> None:
    frames = store.frames
    assert frames is not None
    for frame in frames:
        try:
            change_review(store, lambda now, frame=frame: choose(now, frame.frame, False))  # type: ignore[misc]
        except StereocalError as error:
            assert "No target is seen by both cameras" in str(error)
    store.give(camera_files(store.project), store.photographs, baseline_m=7.5)
    assert store.project.inputs.baseline_m == 7.5 and store.project.table is None
    assert store.frames is not None and not any(frame.use for frame in store.frames)


def test_cameras_that_the_found_targets_do_not_fit_are_refused(store: ProjectPhotographs) -> None:
    before = store.project.inputs
    with pytest.raises(StereocalError, match="outside its image") as raised:
        store.give(camera_files(store.project, 0.1), store.photographs, baseline_m=7.5)
    assert raised.type is StereocalError, "a page would offer to leave out rows of the data set"
    assert store.project.inputs == before


def test_a_search_in_photographs_that_were_changed_meanwhile_is_not_kept(
    store: ProjectPhotographs,
) -> None:
    searched, found = store.photographs, store.frames
    assert found is not None
    replaced(store, found[0].files[0])
    left, table = store.frames, store.project.table
    assert left == found[1:]
    with pytest.raises(StereocalError, match="changed while the targets were looked for"):
        store.keep_found([frame.swapped(0) for frame in found], searched)
    assert store.frames == left and store.project.table == table


def table_frames(store: ProjectPhotographs) -> set[int]:
    table = store.project.table
    assert table is not None
    return set(read_table(table[1], "t").strict("t").frame.tolist())


def test_what_was_found_in_a_photograph_that_was_replaced_goes(store: ProjectPhotographs) -> None:
    review = change_review(store, lambda now: choose(now, 4, False))
    other, first = (frame for frame in review.frames if frame.reviewed)
    assert first.frame in table_frames(store)
    replaced(store, first.files[1])
    assert read_review(store).frames == tuple(f for f in review.frames if f is not first)
    assert first.frame not in table_frames(store) and len(table_frames(store)) > 2
    fresh = [replace(frame.swapped(0).swapped(1), reviewed=False) for frame in review.frames]
    store.keep_found(fresh, store.photographs)
    kept = {frame.frame: frame for frame in store.frames or []}
    assert kept[first.frame] == fresh[review.frames.index(first)]
    assert kept[other.frame] == other
    assert first.frame in table_frames(store)


def test_where_all_photographs_are_replaced_nothing_is_found(store: ProjectPhotographs) -> None:
    for name in store.photographs:
        replaced(store, name)
    assert store.frames is None and store.project.table is None


def test_a_table_of_its_own_outlives_photographs_that_are_replaced(
    store: ProjectPhotographs,
) -> None:
    assert store.project.table is not None
    content = store.project.table[1]
    store.project.give({"correspondences": ("own.csv", content)})
    for name in store.photographs:
        replaced(store, name)
    assert store.project.table == ("own.csv", content)


def test_a_table_that_is_given_after_a_removal_that_was_killed_is_the_projects(
    store: ProjectPhotographs,
) -> None:
    assert store.project.table is not None
    content = store.project.table[1]
    found = (store.folder / "frames.json").read_bytes()
    store.clear()
    (store.folder / "frames.json").write_bytes(found)  # the server died before it was removed
    assert store.frames is None
    files = camera_files(store.project) | {"correspondences": ("own.csv", content)}
    store.give(files, {}, baseline_m=7.5)
    assert store.project.table == ("own.csv", content)
    store.settle()
    assert store.project.table == ("own.csv", content)


def test_other_tabs_go_on_while_a_data_set_is_read(
    store: ProjectPhotographs, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = store.photographs
    name = next(iter(found))
    given = {**found, name: keep_photograph([b"another"], name, store.files)}
    check = Project._check_inputs
    done: list[bool] = []

    def slow(self: Project, *args: Any) -> None:
        if not done:
            thread = Thread(target=lambda: store.project.keep_settings({"seed": 7}), daemon=True)
            thread.start()
            thread.join(20)
            done.append(not thread.is_alive())
        check(self, *args)

    monkeypatch.setattr(Project, "_check_inputs", slow)
    store.give(camera_files(store.project), given, baseline_m=7.5)
    assert done == [True]
    assert store.photographs == given and store.project.settings["seed"] == 7


def test_photographs_that_another_tab_adds_meanwhile_refuse_the_data_set(
    store: ProjectPhotographs, monkeypatch: pytest.MonkeyPatch
) -> None:
    check, before = Project._check_inputs, store.project.inputs
    found = {"left9.png": keep_photograph([b"nine"], "left9.png", store.files)}
    more = {"right9.png": keep_photograph([b"other"], "right9.png", store.files)}

    def meanwhile(self: Project, *args: Any) -> None:
        store.add(more)
        check(self, *args)

    monkeypatch.setattr(Project, "_check_inputs", meanwhile)
    with pytest.raises(StereocalError, match="changed meanwhile: give the data set again"):
        store.give(camera_files(store.project), found, baseline_m=7.5)
    assert store.project.inputs == before
    assert more.keys() < store.photographs.keys() and "left9.png" not in store.photographs


@pytest.mark.parametrize("content", [None, b"{"])
def test_a_list_that_is_damaged_is_begun_anew(
    content: bytes | None, store: ProjectPhotographs
) -> None:
    path = store.folder / "photographs.json"
    path.unlink() if content is None else path.write_bytes(content)
    name = "left1.png"
    found = {name: keep_photograph([b"another"], name, store.files)}
    store.give(camera_files(store.project), found, baseline_m=7.5)
    assert store.photographs == found and store.frames is None
    assert store.project.inputs.baseline_m == 7.5
