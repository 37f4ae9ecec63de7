"""Photographs that are given again, or replaced, after targets were found in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.frames.review import choose
from stereocal.projects.inputs import Slot
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review
from stereocal.rig.camera import Camera
from tests.pages.stored_projects import FULL, placed


@pytest.fixture
def store(tmp_path: Path) -> ProjectPhotographs:
    """Of a project in whose photographs targets were found and corrected."""
    return ProjectPhotographs(placed(FULL, tmp_path))


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
    store.add({name: store.keep(name, b"another")})


def test_what_was_corrected_stays_with_the_same_photographs(store: ProjectPhotographs) -> None:
    project, frames, edits = store.project, store.frames, read_review(store).edits
    table = project.table
    assert edits and table is not None
    store.give(camera_files(project), store.photographs, baseline_m=7.5)
    assert project.inputs.baseline_m == 7.5
    assert store.frames == frames and read_review(store).edits == edits
    assert project.table == table


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
