"""Each upload is read once, each result computed once; nothing in hand is read back."""

from __future__ import annotations

import pkgutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import streamlit as st
from streamlit.testing.v1 import AppTest

from stereocal.evaluation import evaluate as evaluation
from stereocal.formats import correspondences_csv
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.frames.frame import correspondences_of
from stereocal.projects import project as project_module
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.refined.refine import refine
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Correspondences
from stereocal.system.latest import Latest
from tests.pages.stored_projects import FULL, go, placed, project_of
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
    return counted(monkeypatch, f"{correspondences_csv.__name__}.read_rows")


@pytest.fixture
def cameras(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The cameras that were parsed."""
    read, calls = Camera.from_json, []

    def count(data: Any, source: str) -> Camera:
        calls.append(data)
        return read(data, source)

    monkeypatch.setattr(Camera, "from_json", count)
    return calls


def test_a_data_set_is_parsed_once(
    app: AppTest, home: Path, tables: list[object], cameras: list[object]
) -> None:
    files = pack_dataset(read_dataset(FIELD))
    tables.clear()
    cameras.clear()
    give_zip(app, files)
    go(app, "calibrate")
    assert project_of(app, home).dataset is not None
    assert (len(tables), len(cameras)) == (1, 2)


def test_single_files_are_parsed_once(
    app: AppTest, home: Path, tables: list[object], cameras: list[object]
) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("Single files").run()
    for slot, name in (("primary", "primary.json"), ("correspondences", "correspondences.csv")):
        content = (FIELD / name).read_bytes()
        app.file_uploader(key=f"upload_{slot}").upload(name, content).run()
    assert set(project_of(app, home).inputs.files) == {"primary", "correspondences"}
    assert (len(tables), len(cameras)) == (1, 1)


def test_detected_points_are_no_table_to_be_parsed(home: Path, tables: list[object]) -> None:
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
        assert same(rows, again, name)


def same(first: Correspondences, second: Correspondences, name: str) -> bool:
    a, b = (np.asarray(getattr(each, name)) for each in (first, second))
    return bool(a.tobytes() == b.tobytes())


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a restart of the server."""
    for kind in project_module.KEPT:
        monkeypatch.setitem(project_module.KEPT, kind, Latest(8))
    st.cache_resource.clear()


def test_a_calibration_in_hand_is_not_read_back_and_a_stored_one_not_fitted_again(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpacked = counted(monkeypatch, "stereocal.projects.project.unpack_calibration")
    read = counted(monkeypatch, "stereocal.projects.project.unpack_evaluation")
    fitted = counted(monkeypatch, "stereocal.ui.refined.refine")
    forget(monkeypatch)  # what other tests of this process have calibrated
    project_of(open_sample(app), home).keep_settings({"validate_runs": 10})
    go(app, "calibrate").button(key="run").click().run()
    shown = [button.proto.id for button in app.get("download_button")]
    assert shown and not unpacked and not read and len(fitted) == 1
    forget(monkeypatch)
    app.run()
    assert (len(unpacked), len(read), len(fitted)) == (1, 1, 1)
    calibration = project_of(app, home).calibration
    assert calibration is not None and calibration.refined is not None
    again = refine(calibration.fitted, calibration.refined.settings)
    assert np.array_equal(again.p_covariance, calibration.refined.p_covariance)


def test_a_move_of_a_slider_computes_the_methods_of_the_paper_once(
    pressed: AppTest, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = go(pressed, "validate")
    app.slider(key="validate_runs").set_value(10).run()
    searched: list[int] = []
    original = evaluation.paper_angles

    def count(dataset: Any, rows: Any, settings: Any, *seeds: Any) -> Any:
        if settings.search.maximum_moves > 1:
            searched.append(1)
        return original(dataset, rows, settings, *seeds)

    monkeypatch.setattr(evaluation, "paper_angles", count)
    app.slider(key="acceptance").set_value(0.3).run()
    assert len(searched) == 10
    searched.clear()
    app.slider(key="validate_frames").set_value(15).run()
    assert len(searched) == 10
