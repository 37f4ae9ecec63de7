"""A stored project, a look at its pages, and waiting for what happens beside them."""

import re
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_recording
from stereocal.projects.archive import unpack_project
from stereocal.projects.project import Project
from stereocal.ui import jobs
from stereocal.ui.rig import run_of
from stereocal.ui.start import three_cameras
from tests.projects.test_recording import rig_text

ROOT = Path(__file__).parents[2]
FULL = ROOT / "tests" / "projects" / "full.zip"
"""6 pairs of photographs, targets, 2 edits, a calibration, a validation of 10 runs, 7 boards, a
lens, and points that were matched and measured."""
FEW = {"validate_runs": 10}
"""The settings of a validation by few runs, where it does not matter what comes of it."""
SLOW = 120
"""Seconds that nothing takes unless it hangs, on a busy machine either."""


def placed(source: Path, home: Path) -> Project:
    """The project of a zip."""
    return unpack_project(source, source.name, home)


def rig_of_three(home: Path) -> Project:
    """The sample of three cameras with its rig, and the frames that it was fitted to."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STEREOCAL_HOME", str(home))
        project = three_cameras()
    recording = project.recording
    assert recording is not None
    fitted = recording.where(recording.frame % 3 == 0)
    project.give_recording(fitted, pack_recording(fitted))
    run = run_of(project)
    assert run is not None
    project.keep_rig(rig_text(), b"zip", run.made_from)
    project.keep_settings(FEW)
    return project


def dashboard(page: str = "start", **address: str) -> AppTest:
    """A browser tab with what the address names, freshly opened."""
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    app.query_params.update(address)
    return app.run() if page == "start" else go(app, page)


def page_of(project: Project, page: str = "start") -> AppTest:
    """A page in a browser tab that was opened by its address."""
    return dashboard(page, project=project.id)


def again(app: AppTest, page: str) -> AppTest:
    """A page of the same project, in a new tab."""
    return dashboard(page, project=app.session_state["project_id"])


def drop(app: AppTest, files: Mapping[str, bytes], key: str = "upload_data") -> AppTest:
    """Give files together, on the Data page or in another place; one that empties is counted."""
    is_it = re.compile(rf"{key}(_\d+)?").fullmatch
    widget = next(each for each in app.file_uploader if is_it(str(each.key)))
    for name, content in files.items():
        widget.upload(name, content)
    return app.run()


def project_of(app: AppTest, home: Path) -> Project:
    return Project.open(home, app.session_state["project_id"])


def go(app: AppTest, page: str) -> AppTest:
    return app.switch_page(f"pages/{page}.py").run()


def look_at(app: AppTest, look: str) -> AppTest:
    """One of the looks of Calibrate: in sight, or under *More*."""
    control = app.segmented_control(key="view")
    if look in control.options:
        return control.set_value(look).run()
    return app.button(key=f"look_{look}").click().run()


def told(app: AppTest, *kinds: str) -> str:
    wanted = kinds or ("error", "info", "warning", "success", "caption", "markdown")
    found = [str(item.value) for kind in wanted for item in getattr(app, kind)]
    return " ".join(found).replace("\\", "")


def messages(app: AppTest) -> str:
    return told(app, "error", "info", "warning", "success")


def pictured(app: AppTest) -> str:
    """What screen readers say of the figures."""
    return " ".join(figure.proto.alt for figure in app.get("plotly_chart"))


def wait_until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + SLOW
    while not done():
        assert time.monotonic() < end
        time.sleep(0.005)


def ended(project: Project, kind: jobs.Kind) -> jobs.Job:
    """The job of this kind that a page has begun, once it has ended, however it did."""
    job = jobs.job_of(project, kind)
    assert job is not None
    wait_until(lambda: job.state != "running")
    return job


def run_job(app: AppTest, key: str, project: Project, kind: jobs.Kind) -> jobs.Job:
    """Press the button of a job; it, once it has ended, and its page drawn again."""
    app.button(key=key).click().run()
    job = ended(project, kind)
    app.run()
    return job
