"""Photographs that are given again, or replaced, after targets were found in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stereocal.formats.camera_file import write_camera
from stereocal.projects.inputs import Slot
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import read_review
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
