"""Each upload is read once, also after a click meanwhile, and each result computed once."""

import pkgutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import streamlit as st
from streamlit.testing.v1 import AppTest

from stereocal.fit.refine import refine
from stereocal.formats import correspondences_csv
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.frames.frame import correspondences_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import pack_project
from stereocal.projects.home import recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.system.latest import forget
from stereocal.ui import jobs
from stereocal.ui.start import RIG
from tests.files import zipped
from tests.pages.stored_projects import (
    FEW,
    FULL,
    drop,
    ended,
    go,
    messages,
    placed,
    project_of,
    wait_until,
)
from tests.pages.test_pages import FIELD, give_zip, open_sample


def counted(patch: pytest.MonkeyPatch, function: str) -> list[tuple[Any, ...]]:
    """Lists the arguments of each call of a function."""
    original, calls = pkgutil.resolve_name(function), []

    def count(*given: Any, **named: Any) -> Any:
        calls.append(given)
        return original(*given, **named)

    patch.setattr(function, count)
    return calls


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The tables of points that were parsed."""
    forget()
    return counted(monkeypatch, f"{correspondences_csv.__name__}.read_rows")


@pytest.fixture
def cameras(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The cameras that were parsed."""
    return counted(monkeypatch, "stereocal.rig.camera.Camera.from_json")


def test_a_data_set_is_parsed_once(
    app: AppTest, home: Path, tables: list[Any], cameras: list[Any]
) -> None:
    files = pack_dataset(read_dataset(FIELD))
    tables.clear()
    cameras.clear()
    give_zip(app, files)
    go(app, "calibrate")
    assert project_of(app, home).dataset is not None
    assert (len(tables), len(cameras)) == (1, 2)


def test_a_recording_of_more_cameras_is_parsed_once(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forget()
    tables = counted(monkeypatch, "stereocal.formats.dataset_files.read_points_csv")
    files = {path.name: path.read_bytes() for path in RIG.iterdir() if path.suffix != ".md"}
    give_zip(app, files)
    go(app, "calibrate")
    assert project_of(app, home).recording is not None
    assert len(tables) == 1


def test_single_files_are_parsed_once(
    app: AppTest, home: Path, tables: list[Any], cameras: list[Any]
) -> None:
    app.switch_page("pages/data.py").run()
    for name in ("primary.json", "correspondences.csv"):
        drop(app, {name: (FIELD / name).read_bytes()})
    assert set(project_of(app, home).inputs.files) == {"primary", "correspondences"}
    assert (len(tables), len(cameras)) == (1, 1)


def test_detected_points_are_no_table_to_be_parsed(home: Path, tables: list[Any]) -> None:
    project = placed(FULL, home)
    store = ProjectPhotographs(project)
    frames = store.frames
    assert frames is not None
    moved = [frame.swapped(0) for frame in frames]
    tables.clear()
    store.keep_corrected(moved)
    dataset = project.dataset
    assert dataset is not None and not tables
    rows = dataset.correspondences
    assert np.array_equal(rows.primary, correspondences_of(moved).primary)
    again = correspondences_csv.read_table(
        correspondences_csv.write_table(correspondences_of(moved)), "as stored"
    ).correspondences
    for name in ("frame", "target", "primary", "secondary", "sigma_primary_px", "source"):
        first, second = (np.asarray(getattr(each, name)) for each in (rows, again))
        assert first.tobytes() == second.tobytes()


def test_a_calibration_in_hand_is_not_read_back_and_a_stored_one_not_fitted_again(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpacked = counted(monkeypatch, "stereocal.projects.project.unpack_calibration")
    read = counted(monkeypatch, "stereocal.projects.project.unpack_evaluation")
    fitted = counted(monkeypatch, "stereocal.workflow.pair_run.refine")
    forget()  # what other tests of this process have calibrated
    project_of(open_sample(app), home).keep_settings(FEW)
    go(app, "calibrate").button(key="run").click().run()
    shown = [button.proto.id for button in app.get("download_button")]
    assert shown and not unpacked and not read and len(fitted) == 1
    forget()
    app.run()
    assert (len(unpacked), len(read), len(fitted)) == (1, 1, 1)
    calibration = project_of(app, home).calibration
    assert calibration is not None and calibration.refined is not None
    again = refine(calibration.fitted, calibration.refined.settings)
    assert np.array_equal(again.p_covariance, calibration.refined.p_covariance)


def test_a_move_of_a_slider_computes_the_methods_of_the_paper_once(
    pressed: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = go(pressed, "validate")
    app.slider(key="validate_runs").set_value(10).run()
    ended(project_of(app, home), "evaluation")
    searched = counted(monkeypatch, "stereocal.evaluation.evaluate.paper_angles")
    for key, value in (("acceptance", 0.3), ("validate_frames", 15)):
        (slider,) = [one for one in app.slider if one.key and one.key.startswith(key)]
        slider.set_value(value).run()
        ended(project_of(app, home), "evaluation")
        assert sum(given[2].search.maximum_moves > 1 for given in searched) == 10
        searched.clear()


def click_meanwhile(monkeypatch: pytest.MonkeyPatch, function: str) -> list[object]:
    """The first call of a function ends in the exception that a click raises; lists the calls."""
    original = pkgutil.resolve_name(function)
    calls: list[object] = []

    def interrupted(*given: object, **named: object) -> object:
        calls.append(given)
        if len(calls) == 1:
            st.rerun()
        return original(*given, **named)

    monkeypatch.setattr(function, interrupted)
    return calls


def upload(app: AppTest, key: str, name: str, content: bytes, calls: list[object]) -> None:
    """Upload a file; it is taken in the run after the click, and once."""
    app.file_uploader(key=key).upload(name, content).run()
    assert len(calls) == 2
    app.run()
    assert len(calls) == 2


@pytest.mark.parametrize("place", ["intake.give_dataset", "intake.sort_files"])
def test_data_set(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    app.switch_page("pages/data.py").run()
    calls = click_meanwhile(monkeypatch, f"stereocal.ui.{place}")
    upload(app, "upload_data_0", "rig.zip", zipped(pack_dataset(read_dataset(FIELD))), calls)
    assert project_of(app, home).dataset is not None


def test_a_search_for_targets_of_the_data_set_before_is_stopped(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)

    def until_cancelled(job: jobs.Job) -> bool:
        wait_until(lambda: job.cancelled)
        return False

    jobs.start(jobs.PageWork(project, "photographs", ("photographs",), until_cancelled))
    give_zip(app, pack_dataset(read_dataset(FIELD)))
    assert not app.exception
    assert ended(project, "photographs").state == "cancelled"


def test_refusal_is_said(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    app.switch_page("pages/data.py").run()
    calls = click_meanwhile(monkeypatch, "stereocal.ui.messages.set_refusal")
    upload(app, "upload_data_0", "rig.zip", zipped({"dataset.json": b"{}"}), calls)
    assert "must be an object" in messages(app)


def test_points(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = project_of(open_sample(app), home)
    app.switch_page("pages/apply.py").run()
    app.selectbox(key="apply_points").set_value("Two point files").run()
    calls = click_meanwhile(
        monkeypatch, "stereocal.projects.application.ProjectApplication.offer_points"
    )
    upload(app, "upload_points_primary", "p.csv", b"frame,u,v\n0,1,2\n", calls)
    assert ProjectApplication(project).points("primary") is not None


def test_further_data_set(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = project_of(open_sample(app), home)
    app.switch_page("pages/validate.py").run()
    calls = click_meanwhile(monkeypatch, "stereocal.projects.project.Project.add_dataset")
    upload(app, "upload_more", "rig.zip", zipped(pack_dataset(read_dataset(FIELD))), calls)
    assert len(project.more_datasets) == 1


def test_project_is_unpacked_once(
    app: AppTest,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    project = project_of(open_sample(app), home)
    packed = tmp_path_factory.mktemp("elsewhere") / "field.zip"
    pack_project(project, packed)
    app.switch_page("pages/start.py").run()
    calls = click_meanwhile(monkeypatch, "stereocal.ui.projects.open_project")
    upload(app, "upload_project", "field.zip", packed.read_bytes(), calls)
    assert {one.id for one in recent_projects(home)} == {project.id, project_of(app, home).id}
    assert project_of(app, home).id != project.id
