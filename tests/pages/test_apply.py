"""The Apply page with its World frame, without a browser."""

import io
import json
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.field.checking.repair import REPAIRED
from stereocal.figures.space import VIEWS
from stereocal.matching.application import POINTS
from stereocal.matching.reconstruction import name_of_world
from stereocal.matching.views import PAIRS
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.application import USES, ProjectApplication
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip
from stereocal.ui import apply as apply_page
from stereocal.ui import fields, jobs
from stereocal.ui.apply_points import CLICKED
from tests.field.world_tables import lines_csv, survey_csv
from tests.matching.test_point_noise import seen
from tests.pages.stored_projects import (
    SLOW,
    ended,
    go,
    messages,
    page_of,
    pictured,
    project_of,
    run_job,
    told,
)
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY
from tests.rigs.worlds import Place, plumb_lines, surveyed, world_of_cameras

SET_2D = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, matching_threshold_px=0.8)
SET_3D = replace(SET_2D, method="3d", matching_threshold_px=None)

CASES = Path(__file__).parent.parent / "cases"
CASE_T = [-1.1961007208, -0.0468322354155, 0.222822367413]


def csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False).encode()


def begun(app: AppTest) -> AppTest:
    return go(app, "apply").button(key="apply_begin").click().run()


def give_sets(app: AppTest, matching: RigParameters, measuring: RigParameters) -> AppTest:
    for use, rig in (("matching", matching), ("measuring", measuring)):
        content = rig.dumps().encode()
        app.file_uploader(key=f"upload_set_{use}").upload(f"{use}.json", content).run()
    return app


def give_points(app: AppTest, primary: bytes, secondary: bytes) -> AppTest:
    app.file_uploader(key="upload_points_primary").upload("p.csv", primary).run()
    return app.file_uploader(key="upload_points_secondary").upload("s.csv", secondary).run()


def with_files(app: AppTest) -> AppTest:
    give_points(begun(app), *map(csv, seen(0.0, 6, 15, missing=0.0)))
    return give_sets(app, SET_2D, SET_3D)


def store_of(app: AppTest, home: Path) -> ProjectApplication:
    return ProjectApplication(project_of(app, home))


def result_of(app: AppTest, home: Path) -> tuple[pd.DataFrame, pd.DataFrame, Pose | None]:
    """The pairs, the points, and the world frame of these."""
    result = store_of(app, home).result
    assert result is not None
    outcome, files = result
    pairs, points = (pd.read_csv(io.BytesIO(files[name].read_bytes())) for name in (PAIRS, POINTS))
    return pairs, points, outcome.world


def test_nothing_yet_is_said(app: AppTest) -> None:
    go(app, "apply")
    assert "it needs points of both cameras" in told(app)
    begun(app)
    assert "Still missing: the points of both cameras" in told(app)
    assert "Still missing: a parameter file" in told(app)


def test_own_points_are_matched_and_measured(pressed: AppTest, home: Path) -> None:
    app = go(pressed, "apply")
    answer = "50 pairs in 25 frames, none of them ambiguous, none outside the volume of the bars."
    assert answer in told(app, "success")
    assert "50 of 50 pairs have the same target in both cameras" in told(app, "caption")
    assert "50 points, median reprojection error" in told(app, "caption")
    pairs, points, _ = result_of(app, home)
    assert len(pairs) == len(points) == 50
    assert not points["outside_volume"].any()  # the volume holds the bars that it was found from
    assert (pairs["target_primary"] == pairs["target_secondary"]).all()
    app.segmented_control(key="apply_view").set_value("A known length").run()
    app.selectbox(key="apply_way").set_value("target_primary").run()
    # The bar is 0.9 m; with the 3D set, fitted to these very bars. Measured: 0.13 %.
    sentence = told(app, "success")
    assert "known length is 0.9 m" in sentence
    error = float(sentence.split("The mean error is ")[1].split(" %")[0])
    assert error < 0.5
    for view in ("Threshold and depths", "Tables"):
        app.segmented_control(key="apply_view").set_value(view).run()
        assert not app.exception and not app.error
    assert [len(table.value) for table in app.dataframe] == [8, 8]
    app.segmented_control(key="apply_colour").set_value("error").run()
    for view in VIEWS:
        app.segmented_control(key="apply_seen_from").set_value(view).run()
        assert not app.exception and not app.error


def test_threshold_moves_the_result_and_is_kept(app: AppTest, home: Path) -> None:
    with_files(app)
    field = app.number_input(key="apply_threshold")
    assert field.value is None
    assert field.placeholder.startswith("0.8, ")
    assert "cannot be estimated" in told(app, "caption")  # exact points
    before, _, _ = result_of(app, home)
    assert len(before) == 90  # exact points: none is lost, however small the threshold
    app.number_input(key="apply_threshold").set_value(40.0).run()
    after, _, _ = result_of(app, home)
    assert after["ambiguous"].sum() > before["ambiguous"].sum()
    app.segmented_control(key="apply_view").set_value("Threshold and depths").run()
    assert "90 have a partner within 40 px" in told(app, "caption")
    assert "Threshold 40 px" in told(app, "caption")
    app.number_input(key="apply_sigma_px").set_value(0.5).run()
    assert "Your points scatter by 0.5 px, as stated." in told(app, "caption")
    assert result_of(app, home)[0]["sigma_primary_px"].eq(0.5).all()

    again = page_of(store_of(app, home).project, "apply")
    assert again.number_input(key="apply_threshold").value == 40.0
    assert again.number_input(key="apply_sigma_px").value == 0.5
    assert "In use: p.csv, 90 points In use: s.csv, 90 points" in told(again, "caption")
    assert "90 pairs in 6 frames" in told(again, "success")


def test_names_decide_with_a_switch(app: AppTest, home: Path) -> None:
    """The names of two points are exchanged in one camera."""
    first, second = (
        table.rename(columns={"bird": "point"}) for table in seen(0.0, 6, 15, missing=0.0)
    )
    second["point"] = second["point"].replace({1: 12, 12: 1})
    give_sets(give_points(begun(app), csv(first), csv(second)), SET_2D, SET_3D)
    pairs, _, _ = result_of(app, home)
    assert (pairs["point_primary"] == pairs["point_secondary"]).all()
    assert len(pairs) == 89  # an exchanged one meets behind a camera
    assert "2D" in told(app, "caption") and "of points of one name" in told(app, "caption")
    assert set(pairs["point_primary"][~pairs["within_threshold"]]) == {1, 12}
    app.toggle(key="apply_names").set_value(False).run()
    pairs, _, _ = result_of(app, home)
    assert (pairs["point_primary"] != pairs["point_secondary"]).sum() == 12


def test_work_of_seconds_begins_unasked_once(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apply_page, "INSTANT_S", 0.0)
    with_files(app)
    project = store_of(app, home).project
    job = ended(project, "apply")
    app.run()
    assert "90 pairs in 6 frames" in told(app, "success") and ended(project, "apply") is job
    job.state, job.cancelled = "cancelled", True
    store_of(app, home).forget_result()
    app.run()
    assert ended(project, "apply") is job  # a person has cancelled it
    assert run_job(app, "apply_run", project, "apply").state == "done"
    app.number_input(key="apply_threshold").set_value(40.0).run()
    assert ended(project, "apply").work.made_from != job.work.made_from


def test_unasked_work_leaves_what_was_pressed(app: AppTest, home: Path) -> None:
    project = store_of(begun(app), home).project
    released, kind = threading.Event(), "apply"

    def work(follows: bool) -> jobs.PageWork:
        run = (lambda _: None) if follows else (lambda _: released.wait(SLOW) and None)
        return jobs.PageWork(project, "apply", ("x",), run, {"it": [follows]}, follows=follows)

    pressed = jobs.start(work(follows=False))
    assert jobs.start(work(follows=True)) is pressed
    released.set()
    assert ended(project, "apply") is pressed and pressed.state == "done"
    stored_jobs.begin(project.results, kind)  # as if the server had stopped
    assert stored_jobs.is_interrupted(project.results, kind)
    jobs.start(work(follows=True))
    assert ended(project, "apply").state == "done"
    assert not stored_jobs.is_interrupted(project.results, kind)


@pytest.fixture
def place() -> Place:
    rng = np.random.default_rng(4)
    return Place(SET_3D, SET_3D, world_of_cameras(rng), rng)


def give(app: AppTest, path: Path) -> AppTest:
    return app.file_uploader(key="upload_world").upload(path.name, path.read_bytes()).run()


def test_points_in_the_frame_of_plumb_lines(
    app: AppTest, home: Path, place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, before, world = result_of(with_files(app), home)
    assert world is None and "coordinates" not in before
    (tmp_path / "plumb.csv").write_bytes(lines_csv(plumb_lines(place)))
    give(app, tmp_path / "plumb.csv")
    assert "World frame of 4 plumb lines: the vertical is known within" in told(app, "success")
    assert "Points are in the world frame." in told(app, "success")
    _, after, world = result_of(app, home)
    assert world is not None
    assert np.degrees(np.arccos(world.R[2] @ place.up)) < 0.2
    moved = world.apply(before[["x", "y", "z"]])
    np.testing.assert_allclose(after[["x", "y", "z"]], moved, atol=1e-9)
    assert (after["coordinates"] == name_of_world(world)).all()
    assert any("--world world.json" in str(code.value) for code in app.code)
    for view in ("Tables", "A known length"):
        app.segmented_control(key="apply_view").set_value(view).run()
    assert "coordinates" not in app.selectbox(key="apply_way").options
    app.selectbox(key="world_x_axis").set_value("baseline").run()
    turned = result_of(app, home)[2]
    assert turned is not None
    assert turned.apply(SET_3D.pose.inverse().T)[1] == pytest.approx(0, abs=1e-9)
    own = told(app, "success")
    app.number_input(key="world_sigma_px").set_value(3.0).run()
    assert told(app, "success") != own  # other bounds, by the noise as stated
    # The only number that may be removed, of a page that does not rest: it must be told apart from
    # one that did not reach the browser (tests/pages/test_fields.py).
    monkeypatch.setattr(fields, "RESTS_S", -1.0)
    app.number_input(key="world_sigma_px").set_value(None).run()
    app.number_input(key="world_sigma_px").set_value(None).run()
    assert told(app, "success") == own
    app.button(key="forget_world").click().run()
    assert result_of(app, home)[2] is None
    assert "Points are in the world frame." not in told(app, "success")


def test_a_survey_its_residuals_and_a_mirrored_one(
    app: AppTest, home: Path, place: Place, tmp_path: Path
) -> None:
    (tmp_path / "survey.csv").write_bytes(survey_csv(surveyed(place, 6)))
    give(with_files(app), tmp_path / "survey.csv")
    assert "World frame of 6 surveyed points" in told(app, "success")
    assert "P4" in list(app.dataframe[0].value["Point"])
    app.selectbox(key="world_origin").set_value("P2").run()
    assert not app.error
    table = pd.read_csv(tmp_path / "survey.csv")
    table[["x", "y"]] = table[["y", "x"]].to_numpy()
    table.to_csv(tmp_path / "mirrored.csv", index=False)
    give(app, tmp_path / "mirrored.csv")
    assert "left-handed" in told(app, "error")
    assert "in the frame of the primary camera" in told(app, "error")
    assert result_of(app, home)[2] is None


def test_files_of_other_programs_are_asked_what_they_do_not_say(app: AppTest, home: Path) -> None:
    """DLT coefficients that are counted from below, and ROS files, of which one is chosen."""
    begun(app)
    (coefficients,) = (CASES / "dlt_counted_from_below").iterdir()
    app.file_uploader(key="upload_set_matching").upload("d.csv", coefficients.read_bytes()).run()
    app.selectbox(key="set_format_matching").set_value("dlt").run()
    for which in ("primary", "secondary"):
        for side, pixels in (("width", 1920), ("height", 1080)):
            app.number_input(key=f"set_size_matching_{which}_{side}").set_value(pixels).run()
    assert "counted from the lower left" in told(app, "info")
    app.selectbox(key="set_corner_matching").set_value("lower-left").run()
    app.selectbox(key="set_unit_matching").set_value("m").run()
    assert "1.218 m apart" in told(app, "caption")
    app.button(key="use_matching").click().run()
    content = pack_zip(
        {each.name: each.read_bytes() for each in (CASES / "ros_order_ignored").iterdir()}
    )
    app.file_uploader(key="upload_set_measuring").upload("ros.zip", content).run()
    app.selectbox(key="set_format_measuring").set_value("ros").run()
    assert "left.yaml was taken as the primary camera" in told(app, "caption")
    app.selectbox(key="set_primary_measuring").set_value(1).run()
    assert "right.yaml was taken as the primary camera" in told(app, "caption")
    app.button(key="use_measuring").click().run()
    assert not app.exception and not app.error
    first, second = (store_of(app, home).set_of(use) for use in ("matching", "measuring"))
    assert first is not None and second is not None
    # The true T of both, measured: 1e-6 m.
    np.testing.assert_allclose(first[1].pose.T, CASE_T, rtol=0, atol=1e-5)
    np.testing.assert_allclose(second[1].pose.inverse().T, CASE_T, rtol=0, atol=1e-5)


def elements(app: AppTest, kind: str) -> Any:
    return app.get(kind)


def files_named(app: AppTest) -> tuple[str, ...]:
    """The parameter files that the two shown commands name; *Made with* names the same."""
    (shown,) = (str(code.value) for code in app.code)
    found = tuple(re.findall(r"--(?:parameters|rig) (\S+)", shown))
    made_with = told(app, "caption").partition("Made with: ")[2]
    assert len(found) == 2 and all(f"with {name}" in made_with for name in found)
    return found


def test_sets_of_the_project_serve_and_are_named(pressed: AppTest) -> None:
    app = go(pressed, "apply")
    for use in USES:
        app.selectbox(key=f"apply_{use}").set_value("refined").run()
    assert "50 of 50 pairs have the same target" in told(app, "caption")
    assert not app.error and not app.warning
    app.selectbox(key="apply_matching").set_value("3d").run()
    assert "it accepts more wrong pairs" in told(app, "warning")
    app.selectbox(key="apply_matching").set_value("2d").run()
    app.selectbox(key="apply_measuring").set_value("3d").run()
    assert files_named(app) == ("parameters_2d.json", "parameters_3d.json")


def test_the_files_that_were_given_are_named(app: AppTest, home: Path) -> None:
    give_points(begun(app), *map(csv, seen(0.0, 6, 15, missing=0.0)))
    assert files_named(give_sets(app, SET_2D, SET_3D)) == ("matching.json", "measuring.json")
    # As the button of Check does it: what is repaired has the method of the refined set.
    repaired = replace(SET_2D, method="refined", inputs={"repaired_from": {}})
    for use in USES:
        store_of(app, home).keep_set(use, REPAIRED, repaired.dumps().encode())
    assert files_named(app.run()) == (REPAIRED, REPAIRED)
    assert "the refined set" not in told(app, "caption")
    store_of(app, home).keep_set("matching", "d.csv", SET_2D.dumps().encode())
    assert re.findall(r"--parameters (\S+)", str(app.run().code[0].value)) == ["d.json", REPAIRED]
    assert "matched with d.csv" in told(app, "caption")
    assert any(each.label == "Download d.json" for each in elements(app, "download_button"))


def test_the_viewer_opens_at_a_frame_with_pairs_and_draws_no_empty_box(app: AppTest) -> None:
    first, second = seen(0.0, 6, 15, missing=0.0)
    first["frame"], second["frame"] = 10 * first["frame"] + 20, 10 * second["frame"] + 20
    alone = pd.DataFrame({"frame": [1], "u": [100.0], "v": [100.0]})
    give_points(begun(app), csv(pd.concat([alone, first])), csv(second))
    give_sets(app, SET_2D, SET_3D)
    at, last = int(first["frame"].min()), int(first["frame"].max())
    assert app.slider[0].value == at
    boxes = [f"matches_{side}" for side in ("primary", "secondary")]

    def drawn() -> list[str]:
        return [
            name
            for name in boxes
            if any(name in each.proto.id for each in elements(app, "plotly_chart"))
        ]

    assert f"Frame {at}: 15 pairs" in pictured(app) and drawn() == boxes
    app.slider[0].set_value(last - 3).run()  # without points
    assert app.slider[0].value == last and f"Frame {last}: 15 pairs" in pictured(app)
    app.slider[0].set_value(1).run()
    assert "Frame 1: 0 pairs" in pictured(app) and drawn() == boxes[:1]


def test_a_result_of_a_table_is_not_shown_with_clicked_points(app: AppTest, home: Path) -> None:
    with_files(app)
    before = store_of(app, home).result
    assert before is not None and "90 pairs in 6 frames" in told(app, "success")
    app.selectbox(key="apply_points").set_value(CLICKED).run()
    assert "90 pairs" not in messages(app) and not app.get("plotly_chart")
    assert "before" not in told(app, "warning")
    app.selectbox(key="apply_points").set_value("Two point files").run()
    after = store_of(app, home).result
    assert "90 pairs in 6 frames" in told(app, "success")
    assert after is not None and after[0] == before[0]  # kept, not computed again
    # On the page tables have four digits, in files all.
    app.segmented_control(key="apply_view").set_value("Tables").run()
    shown = [json.loads(table.proto.columns) for table in app.dataframe]
    assert shown[0]["u_primary"]["type_config"]["format"] == "%.2f"
    assert {shown[1][axis]["type_config"]["format"] for axis in "xyz"} == {"%.4g"}
    assert len(str(result_of(app, home)[1]["x"][0])) > 10


def test_a_long_work_runs_as_a_job_and_what_has_changed_since_is_said(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apply_page, "INSTANT_S", 0.0)
    monkeypatch.setattr(apply_page, "UNASKED_S", 0.0)
    with_files(app)
    assert "No result yet" in told(app)
    assert run_job(app, "apply_run", store_of(app, home).project, "apply").state == "done"
    assert "90 pairs in 6 frames" in told(app, "success")
    app.number_input(key="apply_threshold").set_value(40.0).run()
    words = "Changed since this result: threshold, depths, noise, names or world frame."
    assert words in told(app, "warning")
    give_sets(app, SET_2D, replace(SET_2D, cost=2.0))
    assert "Changed since this result: parameters, threshold" in told(app, "warning")
    give_sets(app, SET_2D, SET_3D)
    assert words in told(app, "warning")
