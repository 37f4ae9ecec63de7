"""Projects that earlier versions wrote: each opens, with all that it held, on every page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stereocal.project import Project
from stereocal.store.application import ProjectApplication
from stereocal.store.lens import ProjectLens
from stereocal.store.photographs import ProjectPhotographs
from stereocal.store.review import read_review
from tests.pages.stored_projects import FULL, STORED, go, look_at_all, placed, session, told


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return tmp_path


def test_there_are_some_and_they_are_small() -> None:
    assert len(STORED) >= 3
    assert all(path.stat().st_size < 300_000 for path in STORED)


@pytest.mark.parametrize("source", STORED, ids=lambda path: path.stem)
def test_every_version_opens_with_all_it_held(source: Path, home: Path) -> None:
    project = Project.open(home, placed(source, home).id)
    before = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}
    inputs = project.inputs
    calibration, evaluation, dataset = project.calibration, project.evaluation, project.dataset
    assert inputs.name == "Field day" and not inputs.missing
    assert dataset is not None and calibration is not None and evaluation is not None
    assert calibration.dataset.sha256 == dataset.sha256
    assert set(calibration.methods) == {"essential", "2d", "3d"}
    assert len(evaluation.runs[0]) == 10
    photographs = ProjectPhotographs(project)
    if (project.folder / "photographs").is_dir():
        assert len(photographs.photographs) == 12 and len(photographs.rows) == 6
        review = read_review(photographs)
        assert len(review.frames) == 6 and len(review.edits) == 2
        lens = ProjectLens(project, "primary")
        assert lens.search is not None and lens.calibration is not None
    if (project.folder / "apply").is_dir():
        store = ProjectApplication(project)
        assert store.result is not None and store.result[0].pairs > 0
        assert store.point_file("primary") is not None and store.set_of("measuring") is not None

    errors: dict[str, str] = {}
    said = look_at_all(session(project), errors)
    assert not errors
    assert "Complete: " in said["data"]
    assert "focal length fx" in said["cameras"] or "No lens yet" not in said["cameras"]
    assert "essential" in said["calibrate"].lower()
    for path, content in before.items():
        if path.name != "project.json" and "results" not in path.parts:
            # Looking at a project keeps settings of forms, and what is quick is computed anew.
            assert path.name in ("evaluation.npz", "result.json") or path.read_bytes() == content


def test_a_project_of_a_newer_version_is_left_as_it_is(home: Path) -> None:
    project = placed(FULL, home)
    path = project.folder / "project.json"
    state = json.loads(path.read_bytes())
    path.write_text(json.dumps({**state, "format": "stereocal-project/2", "new": 1}))
    before = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}
    app = session(project)
    for page in ("data", "calibrate", "apply"):
        assert "newer version of stereocal (stereocal-project/2): update" in told(go(app, page))
    after = {path: path.read_bytes() for path in project.folder.rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("file", "page"),
    [
        ("photographs/photographs.json", "data"),
        ("lens/primary/photographs.json", "cameras"),
        ("apply/apply.json", "apply"),
    ],
)
def test_a_part_of_a_newer_version_is_left_as_it_is(file: str, page: str, home: Path) -> None:
    project = placed(FULL, home)
    project.keep_settings({"apply_points": "Two point files"})
    path = project.folder / file
    state = json.loads(path.read_bytes())
    content = json.dumps({**state, "format": f"{state['format'][:-1]}2"})
    path.write_text(content)
    assert "newer version" in told(go(session(project), page))
    assert path.read_text() == content


def test_a_tab_of_before_an_update_meets_the_new_server(home: Path) -> None:
    project = placed(FULL, home)
    stale: dict[str, dict[str, object]] = {
        "data": {
            "data_how": "Fotos", "photographs_how": "By pigeon", "frames_view": 3,
            "review_frame": 99, "sheet": 40, "baseline_m_unit": "furlong",
            "baseline_m_value": -3.0, "refused": "text", "pairs_base": 4,
            "photographs_round": "first", "told": [("shout", "x")], "inputs_seen": 3,
        },
        "calibrate": {
            "calibration_frames": 10_000, "essential": "cubic", "delta": -1.0, "seed": "x",
            "minimum_moves": 0, "view": "Nothing", "format_2d": "fax", "settings_seen": [],
        },
        "validate": {
            "validate_runs": 7, "validate_frames": -4, "validate_on": "Everything",
            "bin_width": 0.3, "columns": "Four",
        },
        "one_set": {"baseline_m_known": "Guessed", "refine_sigma_px": -2.0},
        "cameras": {
            "lens_camera": "tertiary", "lens_how": "By hand", "board_columns": 1,
            "board_kind": "Circles", "leave_out_primary": ["gone.png"],
        },
        "apply": {
            "apply_points": "None", "apply_sets": "Mine", "apply_matching": "4d",
            "apply_threshold": -1.0, "apply_view": "All",
        },
    }  # fmt: skip
    for page, values in stale.items():
        keys = list(values)
        for few in (keys[::3], keys[1::3], keys[2::3]):
            app = go(session(project, **{key: values[key] for key in few}), page)
            assert not app.exception, few
            assert told(app), few
        project.keep_settings(values)
        app = go(session(project), page)
        assert not app.exception, page
        assert told(app), page


def test_an_old_address_is_said(home: Path) -> None:
    project = placed(FULL, home)
    app = session(project)
    app.query_params["project"] = "7"
    app.session_state["project_id"] = "7"
    assert "does not name a project" in told(go(app, "data"), "error")
    app.query_params["page"] = "old"
    assert "Complete" in look_at_all(session(project))["data"]
