"""The points of another program in a project: read once, and shown as they were read."""

from __future__ import annotations

from pathlib import Path

import pytest

from stereocal.formats.point_answers import first_answers, layout_of
from stereocal.matching.point_table import PointTable
from stereocal.projects import application
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project

XYPTS = b"pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n1.5,2,3,4\n5,6,NaN,NaN\n7,8,9,10\n"


def test_an_answered_table_is_not_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ProjectApplication(Project.create(tmp_path))
    store.offer_points("primary", "xypts.csv", XYPTS)
    answers = first_answers(layout_of(XYPTS, "xypts.csv"), 0, image_height=1024)
    with monkeypatch.context() as patch:
        patch.delattr(application, "PointTable")
        store.answer("primary", answers)
    points = store.points("primary")
    assert points is not None and (points.rows, points.frames) == (3, 3)
    assert store.asking("primary") is None
    with store.opened(points.name) as folder:
        found = PointTable(folder / points.name, ("u", "v")).check()
    assert (found.rows, len(found.frames)) == (3, 3)
