"""Cameras that are not in step, on the pages: offered, found, shown, and shifted on Apply."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.project import Project
from tests.pages.stored_projects import messages
from tests.pages.test_pages import project_of, zipped
from tests.pages.waiting import ended
from tests.refined.test_time_offset import moving


@pytest.fixture
def project(app: AppTest, home: Path) -> Project:
    """A recording whose secondary camera is 0.1 frames late, calibrated."""
    packed = zipped({name: bytes(own) for name, own in pack_dataset(moving(0.1)).items()})
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    app.file_uploader(key="upload_zip").upload("late.zip", packed, "application/zip").run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    return project_of(app, home)


def test_it_is_offered_and_then_in_every_page(app: AppTest, project: Project) -> None:
    assert "out of step" in messages(app)
    app.button(key="bring_into_step").click().run()
    ended(project, "calibration")
    app.run()
    assert "frame intervals later than the primary" in messages(app)
    assert "out of step" not in messages(app)
    assert app.toggle(key="time_offset").value
    calibration = project.calibration
    assert calibration is not None and calibration.screening.shift is not None
    assert calibration.screening.shift.frames == pytest.approx(0.1, abs=0.02)
    for page in ("validate", "one_set", "apply", "calibrate"):
        app.switch_page(f"pages/{page}.py").run()
        assert not app.exception and not app.error, page
    assert not any("have changed" in warning.value for warning in app.warning)
