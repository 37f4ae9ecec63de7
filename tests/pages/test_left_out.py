"""Frames left out, on the pages: named, put back, exchanged, and the exchange taken back."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.projects.project import Project
from tests.pages.stored_projects import go, messages, project_of
from tests.pages.test_pages import FIELD, give_zip
from tests.pages.waiting import ended

BAD = 7


@pytest.fixture
def project(app: AppTest, home: Path) -> Project:
    """The field's data with A and B exchanged in the secondary image of one frame."""
    dataset = read_dataset(FIELD).with_targets_exchanged([BAD])
    give_zip(app, pack_dataset(dataset))
    project = project_of(app, home)
    project.keep_settings({"validate_runs": 10})
    go(app, "calibrate").button(key="run").click().run()
    return project


def left_out(project: Project) -> tuple[int, ...]:
    calibration = project.calibration
    assert calibration is not None
    return calibration.screening.left_out


def test_a_bad_frame_is_named_exchanged_and_taken_back(app: AppTest, project: Project) -> None:
    assert left_out(project) == (BAD,)
    said = messages(app)
    assert f"frame {BAD}" in said
    assert "exchanged in one camera" in said
    assert app.success
    # Exchanged, it is back at once.
    app.button(key=f"exchange_{BAD}").click().run()
    assert project.inputs.exchanged == [BAD]
    assert left_out(project) == ()
    assert ended(project, "calibration").state == "done"
    calibration = project.calibration
    assert calibration is not None and BAD in calibration.frames
    sound = read_dataset(FIELD)
    assert calibration.dataset.correspondences.secondary.tolist() == (
        sound.correspondences.secondary.tolist()
    )
    # The other pages go by it too, and it can be taken back.
    app.switch_page("pages/validate.py").run()
    assert f"frame {BAD}" not in messages(app)
    app.switch_page("pages/calibrate.py").run()
    app.button(key=f"unexchange_{BAD}").click().run()
    assert ended(project, "calibration").state == "done"
    assert project.inputs.exchanged == []
    assert left_out(project) == (BAD,)
