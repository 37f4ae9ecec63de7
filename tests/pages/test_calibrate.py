"""The Calibrate page: one press to the recommendation, closer looks one at a time, and what
Data and the settings state for the refined set."""

import json
import re
import threading
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.cli import main
from stereocal.evaluation.evaluate import evaluate
from stereocal.fit.least_squares.unknowns import DEFAULT_FOCAL, baseline_sigma_m, lenses_of
from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.projects.archive import pack_project
from stereocal.projects.packed import packed_table
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.system.latest import forget
from stereocal.system.zip_files import unzip
from stereocal.ui import jobs
from stereocal.ui.forms import refine_settings
from stereocal.ui.results import TILES
from stereocal.verdict import recommendation
from stereocal.verdict.in_words import digits
from stereocal.workflow import pair_run
from tests.pages.stored_projects import (
    FEW,
    FULL,
    SLOW,
    again,
    ended,
    go,
    look_at,
    messages,
    pictured,
    placed,
    project_of,
    told,
    wait_until,
)
from tests.pages.test_pages import FIELD, give_zip, open_sample, states

BAD = 7


def test_one_press_gives_everything(pressed: AppTest, home: Path) -> None:
    project = project_of(pressed, home)
    assert project.calibration is not None
    evaluation = project.calibration_evaluation
    assert evaluation is not None and evaluation.settings.runs == 100
    assert project.evaluation is not None  # Validate has it too
    kinds = {key: pressed.button(key=key).proto.type for key in ("run", "next")}
    assert kinds == {"run": "secondary", "next": "primary"}
    assert "Use the refined set for both" in messages(pressed)
    labels = [metric.label for metric in pressed.metric]
    assert labels == [*TILES]
    assert all(metric.value.endswith(("%", "px")) for metric in pressed.metric)
    assert "forecast for similar bars" in told(pressed, "caption")
    assert "held out here: " in told(pressed, "caption") and "not yet" not in told(
        pressed, "caption"
    )
    pressed.switch_page("pages/validate.py").run()
    assert project.evaluation is not None
    assert not pressed.exception and not pressed.error


def test_a_projects_zip_gives_the_same_files_again(
    pressed: AppTest, home: Path, tmp_path: Path
) -> None:
    """What the page computes in parts, and `calibrate` at once."""
    project = project_of(pressed, home)
    assert project.calibration is not None
    found = project.answer
    assert found is not None
    target, again = tmp_path / "project.zip", tmp_path / "again"
    pack_project(project, target, found.parameter_files)
    assert main(["calibrate", str(target), "--out", str(again)]) == 0
    files = unzip(target, target.name)
    assert len(found.parameter_files) == 3
    for name in found.parameter_files:
        now, packed = (json.loads(each) for each in ((again / name).read_bytes(), files[name]))
        assert {**now, "created": ""} == {**packed, "created": ""}
    project.exchange_targets(3)  # the result is of other data now
    pack_project(project, target, found.parameter_files)
    dataset = project.dataset
    assert dataset is not None and dataset.sha256 != found.run.dataset.sha256
    assert read_dataset(target).sha256 == dataset.sha256


def test_a_frame_is_left_out_and_put_back(pressed: AppTest, home: Path) -> None:
    project = project_of(pressed, home)
    project.keep_settings(FEW)
    before = project.calibration
    pressed.selectbox(key="chosen_frame").set_value(9).run()
    pressed.button(key="frame_leave_out").click().run()
    assert project.inputs.left_out == [9]
    assert "Frame 9 was left out by you." in told(pressed, "markdown")
    assert ended(project, "calibration").state == "done"
    pressed.run()
    calibration = project.calibration
    assert calibration is not None and before is not None
    assert calibration.screening.by_user == (9,)
    assert calibration.methods["2d"].cost != before.methods["2d"].cost
    assert project.calibration_evaluation is not None  # of the frames that are left
    assert "Left out by you: frame 9." in messages(pressed)
    assert "Frame 9 was left out by you." in told(pressed, "markdown")
    assert "1 of 25 frames left out" in told(pressed, "caption")
    pressed.button(key="frame_put_back").click().run()
    assert ended(project, "calibration").state == "done"
    calibration = project.calibration
    assert calibration is not None and calibration.screening.left_out == ()
    assert "Frame 9 is used." in told(pressed, "markdown")


def test_two_bars_give_files_without_forecast(app: AppTest, home: Path) -> None:
    dataset = read_dataset(FIELD)
    rows = dataset.correspondences
    single = rows.where((rows.target == 0) | (rows.frame < 3))
    give_zip(app, pack_dataset(dataset.changed(correspondences=single)))
    project_of(app, home).keep_settings(FEW)
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    assert project_of(app, home).calibration is not None
    assert "There is no forecast" in messages(app)
    assert "parameters_2d.json" not in messages(app)
    assert not app.exception


def test_the_recommendation_is_followed(pressed: AppTest, home: Path) -> None:
    project = project_of(pressed, home)
    assert project.recommended == ("refined", "refined")
    assert pressed.segmented_control(key="rig_method").value == "refined"
    offered = [button.proto for button in pressed.get("download_button")][:3]
    assert [re.sub(" .*", "", each.label) for each in offered] == [
        "parameters_2d.json",
        "parameters_3d.json",
        "parameters_refined.json",
    ]
    assert [each.type for each in offered] == ["secondary", "secondary", "primary"]
    pressed.segmented_control(key="view").set_value("Stated and estimated").run()
    assert pressed.selectbox(key="format_file").value == "refined"
    go(pressed, "validate")
    assert pressed.toggle(key="with_refined").value
    go(pressed, "apply")
    for use in ("matching", "measuring"):
        box = pressed.selectbox(key=f"apply_{use}")
        assert box.value == "refined" and "Refined set · recommended" in box.options
    assert "--parameters parameters_refined.json" in pressed.code[0].value
    go(pressed, "calibrate")
    pressed.number_input(key="seed").set_value(3).run()
    assert project.recommended is not None  # of the result that is still there
    project.keep_calibration(calibrate(read_dataset(FIELD)), project.inputs)
    assert project.recommended is None


def test_nothing_is_offered_before_its_threshold_is_final(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_end = threading.Event()

    def waiting(*given: Any, **named: Any) -> Any:
        assert may_end.wait(SLOW)
        return evaluate(*given, **named)

    monkeypatch.setattr(jobs, "WAIT_S", 0.0)
    monkeypatch.setattr(pair_run, "evaluate", waiting)
    project = project_of(open_sample(app), home)
    project.keep_settings(FEW)
    go(app, "calibrate").button(key="run").click().run()
    try:
        wait_until(lambda: project.calibration_digest is not None)
        assert {metric.value for metric in app.run().metric} == {"…"}
        for page in ("calibrate", "apply", "check"):
            go(app, page)
            assert not app.get("download_button"), page
            assert " px" not in messages(app), page
            assert page == "calibrate" or "is being validated" in messages(app)
    finally:
        may_end.set()
    assert ended(project, "calibration").state == "done"
    go(app, "calibrate")
    assert project.calibration is not None
    found = project.answer
    assert found is not None
    (tile,) = [metric.value for metric in app.metric if metric.label == "Threshold"]
    in_file = found.sets["refined"].matching_threshold_px
    assert in_file is not None and tile == f"{digits(in_file, 2)} px"
    assert f"match below {tile} (held-out frames), and measure" in messages(app)
    assert "of parameters_refined.json, from frames held out here" in told(app, "caption")
    app.segmented_control(key="view").set_value("Stated and estimated").run()
    (row,) = [each.value for each in app.table if "Matching threshold (px)" in each.value.index]
    assert str(row.loc["Matching threshold (px)", "Refined set"]) + " px" == tile


@pytest.fixture
def exchanged(app: AppTest, home: Path) -> Project:
    """The field's data with A and B exchanged in the secondary image of one frame."""
    dataset = read_dataset(FIELD).with_targets_exchanged([BAD])
    give_zip(app, pack_dataset(dataset))
    project = project_of(app, home)
    project.keep_settings(FEW)
    go(app, "calibrate").button(key="run").click().run()
    return project


def left_out(project: Project) -> tuple[int, ...]:
    calibration = project.calibration
    assert calibration is not None
    return calibration.screening.left_out


def test_a_bad_frame_is_named_exchanged_and_taken_back(app: AppTest, exchanged: Project) -> None:
    project = exchanged
    assert left_out(project) == (BAD,)
    said = messages(app)
    assert f"frame {BAD}" in said
    assert "exchanged in one camera" in said
    assert app.success
    # Exchanged, it is back at once.
    app.button(key=f"exchange_{BAD}").click().run()
    assert project.inputs.exchanged == {"secondary": [BAD]}
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
    app.button(key=f"unexchange_secondary_{BAD}").click().run()
    assert ended(project, "calibration").state == "done"
    assert project.inputs.exchanged == {}
    assert left_out(project) == (BAD,)


def test_a_forecast_that_held_out_frames_contradict_is_yellow(
    pressed: AppTest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The box, the tile of the figure, and the words; without it the same box is green."""
    said = "Held-out frames contradict the forecast: seen in a test."
    for told_of, colour in ((said, "warning"), ("", "success")):
        forget()
        monkeypatch.setattr(recommendation, "_contradiction", lambda *_, own=told_of: own)
        app = again(pressed, "calibrate")
        first = next(box.value for box in getattr(app, colour) if "A length of" in str(box.value))
        assert (said in str(first).replace("\\", "")) is bool(told_of)
        captions = " ".join(str(each.value) for each in app.caption)
        assert ("which does not hold" in captions) is bool(told_of)


CHANGED = "Changed since this result: acceptance ratio (0.2, now 0.3)"


def test_inputs_are_tested_the_settings_followed_and_what_is_stale_renewed_where_it_stands(
    pressed: AppTest, home: Path
) -> None:
    app, project = pressed, project_of(pressed, home)
    before = project.calibration_digest
    assert "What disagrees" not in told(app)
    project.keep_settings({"acceptance": 0.3})  # a slider of Validate
    for name in ("apply", "calibrate"):
        assert f"{CHANGED}." in messages(go(app, name))
        renewing = app.button(key="run")
        assert (renewing.label, renewing.proto.type) == ("Calibrate again", "primary")
    project.keep_settings(FEW)
    look_at(app, "Stated and estimated")
    assert "go unnoticed" in messages(app)
    assert "Baseline" in list(app.table[0].value.index)
    row = "Focal length fx, primary camera (px)"
    table = app.table[-1].value
    assert str(table.loc[row, "Standard error"]).startswith("±")
    app.switch_page("pages/data.py").run()
    for which in ("primary", "secondary"):
        app.selectbox(key=f"lens_{which}_known").set_value("Typed").run()
        app.number_input(key=f"lens_{which}_focal_percent").set_value(0.0)
        app.number_input(key=f"lens_{which}_centre_px").set_value(0.0).run()
    go(app, "calibrate").multiselect(key="free_distortion").set_value(["secondary"]).run()
    go(app, "apply").button(key="run").click().run()
    assert CHANGED not in messages(app) and not [b for b in app.button if b.key == "run"]
    assert project.calibration_digest != before and project.calibration_evaluation is not None
    assert states(app)["calibrate"] == "done"
    go(app, "calibrate")
    table = look_at(app, "Stated and estimated").table[-1].value
    assert table.loc[row, "Standard error"] == "held"
    calibration = project.calibration
    assert calibration is not None and calibration.refined is not None
    assert calibration.refined.settings.free_distortion == ("secondary",)


def test_the_looks_are_computed_from_the_stored_result(pressed: AppTest, home: Path) -> None:
    run = project_of(pressed, home).run
    assert run is not None and run.forecast is not None and run.forecast.check is not None
    look_at(pressed, "Stated and estimated")
    for sentence in (run.forecast.verdict.figures, run.forecast.check.text, run.advice):
        assert sentence and sentence in told(pressed, "caption")
    look_at(pressed, "Residuals by place")
    assert "they accuse no lens" in pictured(pressed)
    look_at(pressed, "How accurate, where")
    assert "(median)" in pictured(pressed)


def test_a_project_with_a_look_that_is_gone_opens(pressed: AppTest, home: Path) -> None:
    project_of(pressed, home).keep_settings({"view": "Parameters", "along": 100})
    tab = again(pressed, "calibrate")
    assert not tab.exception
    assert tab.segmented_control(key="view").value == "Errors by frame"


def read(project: Project) -> Pair:
    dataset = project.dataset
    assert dataset is not None
    return dataset


def choose(app: AppTest, key: str, option: str) -> None:
    app.selectbox(key=f"{key}_known").set_value(option).run()


def test_typed_numbers_stand_after_f5_and_reach_the_refined_method(
    app: AppTest, home: Path
) -> None:
    project = project_of(open_sample(app), home)
    choose(app, "baseline_m", "Typed")
    assert read(project).baseline_sigma_m is None  # the field is empty yet
    app.number_input(key="baseline_m_sigma_mm").set_value(3.5).run()
    choose(app, "lens_secondary", "Typed")
    app.number_input(key="lens_secondary_focal_percent").set_value(0.4).run()
    assert read(project).secondary.uncertainty is None  # both numbers, or none
    app.number_input(key="lens_secondary_centre_px").set_value(6.0).run()
    dataset = read(project)
    settings = refine_settings(project, dataset)
    assert baseline_sigma_m(dataset, settings) == pytest.approx(0.0035)
    prior = lenses_of(dataset.recording, settings)["secondary"]
    assert (prior.focal, prior.centre_px) == pytest.approx((0.004, 6.0))
    assert lenses_of(dataset.recording, settings)["primary"].focal == DEFAULT_FOCAL

    tab = again(app, "data")
    assert tab.selectbox(key="baseline_m_known").value == "Typed"
    assert tab.number_input(key="baseline_m_sigma_mm").value == 3.5
    assert tab.number_input(key="lens_secondary_focal_percent").value == 0.4
    assert tab.number_input(key="lens_secondary_centre_px").value == 6.0
    assert tab.selectbox(key="lens_primary_known").value == "Not stated"


def test_a_printed_length_is_known_to_a_share_of_it(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    choose(app, "target_distance_m", "Caliper")
    assert read(project).target_distance_sigma_m == pytest.approx(0.0001)
    choose(app, "target_distance_m", "Printer")
    assert read(project).target_distance_sigma_m == pytest.approx(0.003 * 0.9)
    app.number_input(key="target_distance_m_value").set_value(0.5).run()
    assert read(project).target_distance_sigma_m == pytest.approx(0.003 * 0.5)
    assert app.selectbox(key="target_distance_m_known").value == "Printer"
    choose(app, "target_distance_m", "Not stated")
    assert read(project).target_distance_sigma_m is None
    # Another data set, which states nothing, is not as printed.
    choose(app, "target_distance_m", "Printer")
    project.give({}, target_distance_m=0.7, target_distance_sigma_m=None)
    app.run()
    assert app.selectbox(key="target_distance_m_known").value == "Not stated"


def test_points_that_are_too_few_are_not_green_and_lead_nowhere(app: AppTest, home: Path) -> None:
    """Two pairs in one frame, and four in two: five are needed."""
    project = project_of(open_sample(app), home)
    assert app.button(key="next") and len(app.success)
    table = packed_table(read(project).correspondences)
    head, *rows = table.splitlines(keepends=True)
    for few in (2, 4):
        project.give({"correspondences": ("few.csv", head + b"".join(rows[:few]))})
        app.switch_page("pages/data.py").run()
        assert f"{few} pairs" in " ".join(str(each.value) for each in app.warning)
        assert not len(app.success) and "next" not in [each.key for each in app.button]
        assert states(app)["data"] == "missing"


def test_freed_lenses_are_the_same_setting_in_any_order(home: Path) -> None:
    project = placed(FULL, home)
    project.keep_settings({"free_distortion": ["secondary", "primary"]})
    settings = refine_settings(project, read(project))
    assert settings.free_distortion == ("primary", "secondary")
