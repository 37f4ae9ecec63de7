"""Photographs that are given again, or replaced, after targets were found in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stereocal.camera import Camera
from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera
from stereocal.formats.photograph_files import keep_photograph
from stereocal.frames.review import choose
from stereocal.inputs import Slot
from stereocal.project import Project
from stereocal.store.photographs import ProjectPhotographs
from stereocal.store.review import change_review, read_review
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
    table = store.project.table
    with pytest.raises(StereocalError, match="changed while the targets were looked for"):
        store.keep_found([frame.swapped(0) for frame in found], searched)
    assert store.frames == found and store.project.table == table


def test_a_photograph_that_was_replaced_is_told_and_its_corrections_go(
    store: ProjectPhotographs,
) -> None:
    review = change_review(store, lambda now: choose(now, 4, False))
    frames = review.frames
    store.keep_found(frames, store.photographs)
    corrected = next(frame for frame in frames if frame.reviewed)
    replaced(store, corrected.files[1])
    assert [frame.frame for frame in frames if store.is_outdated(frame)] == [corrected.frame]
    fresh = [replace(frame.swapped(0).swapped(1), reviewed=False) for frame in frames]
    store.keep_found(fresh, store.photographs)
    assert not any(map(store.is_outdated, fresh))
    kept = {frame.frame: frame for frame in store.frames or []}
    assert kept[corrected.frame] == fresh[frames.index(corrected)]
    others = [frame for frame in frames if frame.reviewed and frame is not corrected]
    assert others and all(kept[frame.frame] == frame for frame in others)


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
