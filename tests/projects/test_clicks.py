"""Clicks on disk: each act whole, and undone one by one; their tables for other programs."""

from pathlib import Path

from stereocal.formats.point_files import read_points
from stereocal.formats.point_layouts import propose_layout
from stereocal.formats.point_text import dltdv_table, sleap_table
from stereocal.matching.clicks import Click
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.database import DamagedError
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from tests.refused import refused

HEAD = [Click(frame, camera, "head", 10.25 + frame, 20.5) for frame in (1, 3) for camera in CAMERAS]
TAIL = Click(3, "primary", "tail", 40.0, 50.125, "followed")


def test_every_act_is_on_disk_and_is_undone_whole(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    store, again = ProjectClicks(project), ProjectClicks(Project.open(tmp_path, project.id))
    store.act(Act(HEAD))
    store.act(Act([TAIL]))
    moved = Click(1, "primary", "head", 1.0, 2.0, "snapped")
    store.act(Act([moved]))
    assert again.clicks.every[moved.key] == moved and len(again.clicks.every) == 5
    again.act(Act([], [each.key for each in HEAD[:2]]))
    assert len(store.acts) == 4 and store.clicks.tracks == ["head", "tail"]
    assert [each.frame for each in store.clicks.along("head", "primary")] == [3]
    store.undo()
    assert again.clicks.every[moved.key] == moved
    store.undo()
    assert store.clicks.every[moved.key] == HEAD[0]
    store.undo()
    store.undo()
    store.undo()  # nothing is left
    assert not store.clicks.every and not store.acts
    # Those of a pair of a rig are its own.
    project.database.of_pair("left-right").keep_values("clicks", {"000000001": {}})
    assert not store.clicks.every
    project.database.keep_values("clicks", {"000000001": {"placed": [{}], "removed": []}})
    with refused("clicked", by=DamagedError):
        _ = store.clicks


def test_a_name_that_was_cut_at_a_blank_is_read(tmp_path: Path) -> None:
    """Earlier versions cut names to 40 characters, wherever that was."""
    project = Project.create(tmp_path)
    placed = [{**vars(TAIL), "track": "the left wing "}]
    removed = [[3, "secondary", "the left wing "]]
    project.database.keep_values("clicks", {"000000001": {"placed": placed, "removed": removed}})
    assert ProjectClicks(project).clicks.tracks == ["the left wing"]


def test_other_programs_tables_have_the_same_points(tmp_path: Path) -> None:
    store = ProjectClicks(Project.create(tmp_path))
    store.act(Act([*HEAD, TAIL]))
    clicks = store.clicks
    for which, camera in enumerate(CAMERAS, 1):
        own = clicks.tables(CAMERAS)[camera]
        for text, program, its_name, columns in (
            (dltdv_table(clicks, CAMERAS), "DLTdv8", f"cam{which}", ["frame", "u", "v"]),
            (sleap_table(clicks, camera), "SLEAP", "cam1", ["frame", "track", "u", "v"]),
        ):
            layout = propose_layout(text.encode(), "points.csv")
            assert layout.program == program
            read = read_points(text.encode(), layout, its_name, None, "points.csv")
            rows = [sorted(each[columns].to_numpy().tolist()) for each in (read, own)]
            assert rows[0] == rows[1]
