"""Three cameras and more, from their files and photographs, on the pages that two cameras have."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.cli import main
from stereocal.fit.parameter_file import of_file
from stereocal.fit.rig_file import RigFile
from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_files import pack_recording, parse_recording
from stereocal.formats.points_csv import write_points
from stereocal.matching.application import points_by_camera
from stereocal.matching.clicks import Click
from stereocal.matching.lengths import check_lengths
from stereocal.projects.application import ProjectApplication, ProjectCheck, slot_of
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.given import ProjectGiven
from stereocal.projects.home import find_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.server_settings import default_home
from stereocal.rig.geometry import Pose
from stereocal.simulation.rigs import simulated_rig
from stereocal.ui.apply_points import CLICKED
from stereocal.ui.menu import OTHER_ADDRESSES
from stereocal.ui.results import looks_of
from stereocal.ui.rig import TILES as RIG_TILES
from stereocal.ui.start import RIG
from stereocal.ui.validation import ALL_PAIRS
from tests.archives import caliscope_files, wand_csv
from tests.files import encoded, zipped
from tests.further import of_a_whole_soak
from tests.pages.stored_projects import (
    dashboard,
    drop,
    ended,
    go,
    look_at,
    page_of,
    rig_of_three,
    run_job,
    told,
    wait_until,
)
from tests.pages.test_pages import states
from tests.photographs.board_pairs import HERE, placings, stereo
from tests.photographs.lens import PATTERN, SMALL, photographed
from tests.photographs.small_rig import BAR_M, CAMERAS, photographed_bars
from tests.projects.test_recording import given as sample
from tests.projects.test_recording import rig_text


@pytest.fixture
def project(home: Path) -> Project:
    return rig_of_three(home)


def titles(app: AppTest) -> list[str]:
    return [str(title.value) for title in app.title]


def test_calibrate_shows_all_cameras_and_the_pair_that_is_chosen(project: Project) -> None:
    app = page_of(project, "calibrate")
    assert "One rig of 3 cameras" in told(app, "success")
    assert not app.exception and not app.error
    assert [metric.label for metric in app.metric][:3] == [*RIG_TILES]
    # The first pair is calibrated unasked, when it is first looked at.
    assert project.of_pair("1-2").calibration is not None
    assert project.of_pair("2-3").calibration is None
    app.selectbox(key="pair").set_value("2-3").run()
    pair = project.of_pair("2-3")
    assert pair.calibration is not None and not app.exception
    assert pair.calibration_evaluation is not None and pair.recommended is not None
    _is_of_the_rig(pair)
    for look in looks_of(pair):
        look_at(app, look)
        assert not app.exception and not app.error, look
    # The same pair on the next page, in this tab and after the page is opened anew.
    assert go(app, "validate").selectbox(key="pair").value == "2-3"
    assert not app.exception and not app.error
    app = page_of(project, "validate")
    assert app.selectbox(key="pair").value == "2-3"
    app.segmented_control(key="validate_on").set_value(ALL_PAIRS).run()
    assert ended(pair, "evaluation").state == "done"
    assert pair.evaluation is not None and len(pair.evaluation.runs) == 3
    assert not app.run().exception and not app.error
    cards = told(go(app, "start"))
    assert "One rig: 0." in cards and cards.count("3 cameras") == 1
    # What changes the rig makes it stale.
    assert "Changed since" not in told(go(app, "calibrate"), "warning")
    project.give({}, baselines_m={"1-2": 2.0}, baseline_sigma_m=0.01)
    assert "Changed since" in told(app.run(), "warning")
    assert states(app)["calibrate"] == "stale"
    assert app.button(key="run").proto.type == "primary"


def _is_of_the_rig(pair: Project) -> None:
    """The refined set of the pair 2-3."""
    found = pair.calibration
    assert found is not None and found.refined is not None
    rig = RigFile.loads(rig_text()).pair("2", "3")
    assert [*found.refined.pose.angles] == pytest.approx([*rig.pose.angles], abs=1e-9)
    assert found.refined.primary.lens_values == pytest.approx(rig.primary.lens_values, rel=1e-9)
    stated = (rig.uncertainties or {})["covariance"]["matrix"]
    own = of_file(found.refined.covariance, found.refined.pose)
    sigmas = np.sqrt(np.diag(own))[: len(stated)]
    assert sigmas == pytest.approx(np.sqrt(np.diag(stated)), rel=1e-4)


def test_the_sample_is_opened_from_start(app: AppTest) -> None:
    app.button(key="demo_rig").click().run()
    assert titles(app) == ["Data"] and "2-3 (412 frames)" in told(app)


def test_a_frame_is_left_out_of_all_cameras(project: Project) -> None:
    app = page_of(project, "calibrate")
    frame = int(str(app.selectbox(key="chosen_frame").value))
    app.button(key="frame_leave_out").click().run()
    assert project.inputs.left_out == [frame]
    assert ended(project, "rig").state == "done"
    recording, rig = project.recording, project.rig
    assert recording is not None and rig is not None
    fewer = recording.where(recording.frame != frame)
    assert rig.about.inputs["sha256"] == fewer.sha256
    app = page_of(project, "calibrate")
    app.selectbox(key="chosen_frame").set_value(frame).run()
    assert f"Frame {frame} was left out by you." in told(app, "markdown")
    app.button(key="frame_put_back").click().run()
    assert project.inputs.left_out == [] and not app.exception


def test_the_menu_and_next_lead_through_a_rig(project: Project) -> None:
    app = page_of(project, "cameras")
    states = app.session_state["page_states"]
    assert {states[name].mark for name in ("cameras", "data", "calibrate")} == {"done"}
    lenses = app.table[0].value
    assert list(lenses.index) == ["1", "2", "3"] and "Refined, px" in lenses
    for following in ("Data", "Calibrate", "Validate", "Apply", "Check"):
        app.button(key="next").click().run()
        assert titles(app) == [following] and not app.exception
    assert "rig" in OTHER_ADDRESSES  # of before


def test_points_of_three_cameras_are_clicked(project: Project) -> None:
    """Two cameras give a point, and the third improves it."""
    rig = RigFile.loads(rig_text())
    project.keep_settings({"apply_points_of_rig": CLICKED})
    app = page_of(project, "apply")
    sizes = {name: camera.image_size[::-1] for name, camera in rig.cameras.items()}
    images = {
        f"cam{name}_{frame:02}.png": encoded(np.full(size, 90 + frame, np.uint8))
        for name, size in sizes.items()
        for frame in (1, 2)
    }
    drop(app, images, "upload_footage")
    assert any(each.label.endswith("2 frames") for each in app.expander) and not app.exception
    assert "Click point 1 in one of the pictures." in told(app)
    assert rig.volume is not None
    x, y, z = (0.5 * sum(ends) for ends in vars(rig.volume).values())
    point = np.array([[x * z, y * z, z]])
    seen = {
        name: placed.camera.project(placed.pose.apply(point))[0].tolist()
        for name, placed in rig.placed.items()
    }
    store = ProjectClicks(project)
    store.act(Act([Click(1, "1", "point 1", *seen["1"])]))
    assert "Now click point 1 in the 2 or 3 picture, near the line." in told(app.run())
    store.act(Act([Click(1, "3", "point 1", *seen["3"])]))
    assert "below the threshold of 1.98 px" in told(app.run(), "success")
    store.act(Act([Click(1, "2", "point 1", *seen["2"])]))
    assert "below the threshold of 2.07 px" in told(app.run(), "success")
    app.button(key="clicks_all").click().run()
    assert "1 point in 1 frame" in told(app) and not app.exception
    result = ProjectApplication(project).result
    assert result is not None and result[0].sigma_px == 1.0
    points = pd.read_csv(io.BytesIO(result[1]["points.csv"].read_bytes()))
    assert points["views"].tolist() == [3] and points["track"].tolist() == ["point 1"]
    np.testing.assert_allclose(points[["x", "y", "z"]], point, atol=1e-3)


def test_points_of_a_rig_are_matched_and_measured_as_by_the_commands(
    project: Project, tmp_path: Path
) -> None:
    """The points are the wand's markers, unnamed, in a tenth of the frames."""
    store, files = ProjectApplication(project), tmp_path / "files"
    recording = project.recording
    assert recording is not None
    some = points_by_camera(recording.where(recording.frame % 30 == 0))
    files.mkdir()
    (files / "rig.json").write_text(rig_text())
    given = []
    for camera, table in some.items():
        path = files / f"{camera}.csv"
        table.to_csv(path, index=False)
        store.offer_points(slot_of(camera), path.name, path.read_bytes())
        given.append(f"{camera}={path}")
    app = page_of(project, "apply")
    assert not app.exception and not app.error
    result = store.result
    assert result is not None and result[0].matched == "tracks.csv"
    made = {"tracks.csv": ["match", *given], "points.csv": ["reconstruct", f"{files}/tracks.csv"]}
    for name, words in made.items():
        assert main([*words, "--rig", f"{files}/rig.json", "--out", f"{files}/{name}"]) == 0
        assert result[1][name].read_bytes() == (files / name).read_bytes()
    points = pd.read_csv(files / "points.csv")
    assert (points["views"] == 3).any()
    # The names are carried along: A and B of the wand are 0.39 m apart. Measured: 0.15 %.
    app.segmented_control(key="apply_view").set_value("A known length").run()
    app.number_input(key="apply_known").set_value(0.39).run()
    assert "target" in app.selectbox(key="apply_way").options
    check = check_lengths(points, 0.39, "target", ("A", "B"))
    assert check.mean_error < 0.003 and check.sentence() in told(app, "success")
    assert app.session_state["page_states"]["apply"].mark == "done"
    for view in ("Camera 1", "Camera 3", "Above"):
        app.selectbox(key="apply_seen_from").set_value(view).run()
        assert not app.exception


def test_names_of_a_rigs_points_decide_with_a_switch(project: Project) -> None:
    store, recording = ProjectApplication(project), project.recording
    assert recording is not None
    some = points_by_camera(recording.where(recording.frame % 150 == 0))
    for camera, table in some.items():
        named = table.rename(columns={"target": "point"}).to_csv(index=False)
        store.offer_points(slot_of(camera), f"{camera}.csv", named.encode())
    app = page_of(project, "apply")
    assert store.result is not None and "(column point)" in store.result[0].sentences[1]
    app.toggle(key="apply_names").set_value(False).run()
    assert not app.exception and "(column point)" not in store.result[0].sentences[1]
    assert store.result[0].names == "none"


def test_a_rig_file_alone_is_applied(app: AppTest, home: Path) -> None:
    go(app, "apply").button(key="apply_begin").click().run()
    app.file_uploader(key="upload_set_matching").upload("rig.json", rig_text().encode()).run()
    assert "a rig of 3 cameras" in told(app, "caption") and not app.exception
    tables = {
        path.name: b"".join(path.read_bytes().splitlines(keepends=True)[:40])
        for path in (RIG / f"points_{camera}.csv" for camera in "12")
    }
    drop(app, tables, "upload_points_camera 2")  # each goes to the camera in its name
    result = ProjectApplication(Project.open(home, find_projects(home)[0])).result
    assert result is not None and result[0].cameras == ["1", "2"]
    app.button(key="forget_rig").click().run()
    assert not app.exception and "parameter file" in told(app)


def test_a_rig_is_checked_with_its_table_of_points(project: Project, tmp_path: Path) -> None:
    recording = project.recording
    assert recording is not None
    moved = recording.points.copy()
    moved[recording.camera == 1] += [4.0, 0.0]  # of camera 2, turned by 0.2 degrees
    some = replace(recording, points=moved).where(recording.frame % 12 == 0)
    app = page_of(project, "check")
    assert "this project's rig" in told(app, "caption")
    app.file_uploader(key="upload_check_images_0").upload("new.csv", write_points(some)).run()
    said = told(app, "warning")
    assert "Moved or refocused: camera 2." in said and not app.exception
    assert "1-2: " in told(app, "caption")
    # The same as the command says.
    (tmp_path / "new.csv").write_bytes(write_points(some))
    (tmp_path / "rig.json").write_text(rig_text())
    files = [str(tmp_path / name) for name in ("rig.json", "new.csv")]
    assert main(["check", *files, "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "check.json").read_text())["cameras_moved"] == ["2"]


def test_lengths_are_typed_in_any_unit(project: Project) -> None:
    app = page_of(project, "data")
    app.selectbox(key="rig_unit").set_value("cm").run()
    assert not project.inputs.baselines_m
    app.selectbox(key="baseline_of").set_value("1-3").run()
    app.number_input(key="baseline_1-3").set_value(123.4).run()
    assert project.inputs.baselines_m == {"1-3": 1.234}
    # The number is as it was typed, and the other lengths are as long as they were.
    app.selectbox(key="baseline_of").set_value("1-2").run()
    app.number_input(key="baseline_1-2").set_value(2.5).run()
    app.selectbox(key="rig_unit").set_value("m").run()
    assert app.number_input(key="baseline_1-2").value == 2.5
    assert project.inputs.baselines_m == {"1-3": 1.234, "1-2": 2.5}
    app.selectbox(key="baseline_m_known").set_value("Tape").run()
    recording = project.recording
    assert recording is not None and not app.exception
    assert recording.baselines_m == {("1", "3"): 1.234, ("1", "2"): 2.5}
    assert recording.baseline_sigma_m == pytest.approx(0.005)
    assert "Download this data set" in [each.proto.label for each in app.get("download_button")]


def test_lengths_that_look_like_millimetres_can_be_taken_as_such(app: AppTest, home: Path) -> None:
    given(app, files_of_rig())
    for key, shown in (("several_B_m", 1390.0), ("baseline_1-2", 2400.0)):
        app.number_input(key=key).set_value(shown).run()
        assert "looks like millimetres" in told(app, "error")
        app.button(key="use_rest").click().run()
        assert app.number_input(key=key).value == shown / 1000 and not app.error
    project = Project.open(home, find_projects(home)[0])
    assert project.settings["several_B_m"] == 1.39
    assert project.inputs.baselines_m == {"1-2": 2.4}


def files_of_rig() -> dict[str, bytes]:
    """The camera files and the table of the sample, every eighteenth frame."""
    files = {path.name: path.read_bytes() for path in RIG.iterdir() if path.suffix == ".yaml"}
    head, *rows = (RIG / "points.csv").read_bytes().splitlines(keepends=True)
    return {
        **files,
        "points.csv": head + b"".join(r for r in rows if int(r.split(b",")[0]) % 18 == 0),
    }


def given(app: AppTest, files: dict[str, bytes]) -> AppTest:
    """Files given together on the Data page."""
    return drop(go(app, "data"), files)


def test_from_files_to_the_rig(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given(app, files_of_rig())
    assert "the distance from A to B is missing" in told(app, "warning")
    app.number_input(key="several_B_m").set_value(0.39).run()
    app.number_input(key="several_M_m").set_value(0.13).run()
    app.selectbox(key="target_distance_m_known").set_value("Caliper").run()
    assert "1-2 (" in told(app, "caption") and not app.error

    def failing(*_: object) -> None:
        raise np.linalg.LinAlgError

    project = Project.open(home, find_projects(home)[0])
    with monkeypatch.context() as patch:
        patch.setattr("stereocal.workflow.run.settings_of_pair", failing)
        app.button(key="several_run").click().run()
        assert titles(app) == ["Calibrate"]
        assert ended(project, "rig").state == "done"
    why = "has no files: its images determine too little of it."
    assert why in told(go(app, "calibrate"), "warning")
    recording, parts = project.recording, ProjectGiven(project)
    assert recording is not None
    assert list(recording.cameras) == ["1", "2", "3"]
    assert recording.object.names == ("A", "B", "M")
    assert recording.object.sigma_m == pytest.approx(0.0001)
    assert "One rig of 3 cameras" in told(app)
    # The files are still there to be corrected; what replaces one is named, and can be undone.
    other = files_of_rig()["camera_2.yaml"]
    drop(go(app, "data"), {"camera_1.yaml": other})
    assert "camera_1.yaml was replaced" in told(app, "info")
    assert parts.parts["camera_1.yaml"] == parts.parts["camera_2.yaml"]
    assert app.button(key="several_run").proto.type == "primary"
    app.button(key="undo_camera_1.yaml").click().run()
    assert app.button(key="several_run").proto.type == "secondary"  # they are in use
    assert parts.parts["camera_1.yaml"].read_bytes() == files_of_rig()["camera_1.yaml"]
    assert states(app)["calibrate"] == "done"
    # Known otherwise, the recording stays in use, and its rig is to be found again.
    app.selectbox(key="target_distance_m_known").set_value("Printer").run()
    recording = project.recording
    assert recording is not None and states(app)["calibrate"] == "stale"
    assert recording.object.sigma_m == pytest.approx(0.003 * 0.39)
    assert app.button(key="several_run").proto.type == "secondary"
    # Of another recording, nothing is stated.
    project.give_recording(parse_recording(sample(), "another"), sample())
    last = project.recording
    assert last is not None and last.object.sigma_m is None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda files: files.pop("camera_2.yaml"), "points of a camera 2, and no camera file"),
        (
            lambda files: files.pop("points.csv"),
            "Table of points missing, give the CSV of the bar's ends.",
        ),
        (lambda files: files.update({"camera_4.yaml": files["camera_1.yaml"]}), "4 has no points"),
        (
            lambda files: files.update({"points.csv": files["points.csv"] + b"1,1,A,9999,5\n"}),
            "out",
        ),
    ],
    ids=["no file", "no table", "no points", "outside"],
)
def test_wrong_files_are_named(app: AppTest, change: Callable[[Any], Any], named: str) -> None:
    files = files_of_rig()
    change(files)
    given(app, files)
    if "points.csv" in files:
        app.number_input(key="several_B_m").set_value(0.39).run()
    assert named in told(app, "warning")


def test_exchanged_camera_files_are_named(app: AppTest, home: Path) -> None:
    """Of lenses that differ, in a simulation; those of the sample are of one model."""
    packed = pack_recording(simulated_rig(np.random.default_rng(1), 3, 80).recording)
    one, two, three = (packed[f"camera_{number}.json"] for number in (1, 2, 3))
    files = {"c1.json": two, "c2.json": one, "c3.json": three, "points.csv": packed["points.csv"]}
    given(app, files).number_input(key="several_B_m").set_value(0.6).run()
    project = Project.open(home, find_projects(home)[0])
    assert run_job(app, "several_run", project, "rig").state == "failed"
    assert project.rig is None
    sentence = told(go(app, "calibrate"), "error")
    assert "c1 and c2" in sentence and "exchanged" in sentence


CORNERS = PATTERN.points - PATTERN.points.mean(axis=0)
"""Of a board whose pose is that of its middle."""


def give(app: AppTest, files: dict[str, bytes]) -> None:
    """One camera after the other."""
    for camera in CAMERAS:
        drop(app, {name: own for name, own in files.items() if name.startswith(camera)})
        assert not app.exception and not app.error
        assert ("mid/0099.png: this is not a readable" in told(app, "warning")) == (
            "mid/0099.png" in files and camera == "mid"
        )


def search(app: AppTest, home: Path) -> Project:
    project = Project.open(home, find_projects(home)[0])
    job = run_job(app, "find_in_all_cameras", project, "photographs")
    assert job.state == "done" and not app.exception, job.sentence
    return project


def test_photographs_of_a_bar_to_the_rig(app: AppTest, home: Path) -> None:
    files = dict(photographed_bars()[0])
    files["mid/0003.png"] = encoded(np.zeros((600, 800), np.uint8))
    files["mid/0099.png"] = b"damaged"
    given(app, {f"{name}.json": write_camera(own) for name, own in CAMERAS.items()})
    give(app, files)
    project = search(app, home)
    assert "12 frames. Photographs not used: 1" in told(app, "caption")
    assert "mid/0003.png" in told(app, "markdown")
    app.number_input(key="several_B_m").set_value(BAR_M).run()
    app.button(key="several_run").click().run()
    assert titles(app) == ["Calibrate"]
    recording = project.recording
    assert recording is not None and {*recording.cameras} == {*CAMERAS}
    assert [len(recording.common_frames("mid", each)) for each in ("left", "right")] == [11, 11]
    wait_until(lambda: project.rig is not None)
    rig = project.rig
    assert rig is not None and rig.names == [*recording.cameras]
    _check_with_photographs(app, project, rig)
    # The photographs are still there; without one camera's, what was found is out of date.
    assert "Changed since" not in told(go(app, "data"), "warning")
    app.button(key="several_clear").click().run()
    assert not app.exception and "left-mid" in told(app, "caption")


def _check_with_photographs(app: AppTest, project: Project, rig: RigFile) -> None:
    """Half of the photographs again: as new ones of the rig, then of a pair by its file."""
    place = "upload_check_images"
    half = [name for name in photographed_bars()[0] if int(name[-6:-4]) % 2]
    files = {name.replace("/", "_"): photographed_bars()[0][name] for name in half}
    drop(go(app, "check"), files, place)
    assert "18 photographs, 6 frames" in told(app, "markdown")
    _find_new(app, project)
    assert "targets found in 6 frames" in told(app, "caption")
    assert "no camera has moved" in told(app) or "no movement is seen" in told(app)
    # Photographs of the data are left alone.
    assert len(ProjectPhotographs(project).photographs) == 36
    of_pair = dashboard("check")
    of_pair.button(key="check_begin").click().run()
    pair = rig.pair("left", "right").dumps().encode()
    of_pair.file_uploader(key="upload_check_parameters").upload("p.json", pair).run()
    drop(of_pair, {name: files[name] for name in files if not name.startswith("mid_")}, place)
    _find_new(of_pair, Project.open(default_home(), of_pair.session_state["project_id"]))
    assert "targets found in 6 frames" in told(of_pair, "caption")
    assert not of_pair.warning and "Still missing" not in told(of_pair)


def _find_new(app: AppTest, project: Project) -> None:
    job = run_job(app, "find_new", ProjectCheck(project).of_images, "photographs")
    assert job.state == "done" and not app.exception and not app.error


def seen_by_both(count: int) -> list[Pose]:
    """Boards that the rolled camera sees too."""
    size, rolled = np.array(SMALL.image_size), stereo(2.0)
    return [
        board
        for board in placings(stereo(0.0), 8 * count, 6)
        if (np.abs(SMALL.project((rolled @ board).apply(CORNERS)) - size / 2) < size / 2 - 25).all()
    ][:count]


@of_a_whole_soak
def test_photographs_of_a_board(app: AppTest, home: Path) -> None:
    orders: dict[int, int] = {}
    boards = seen_by_both(5)
    poses = {"left": HERE, "mid": stereo(2.0), "right": stereo(0.0)}
    files = {
        f"{name}/{at}.png": encoded(photographed(pose @ board))
        for at, board in enumerate(boards)
        for name, pose in poses.items()
    }
    given(app, {f"{name}.json": write_camera(SMALL) for name in CAMERAS})
    give(app, files)
    assert app.segmented_control(key="held").value == "board"
    assert app.button(key="find_in_all_cameras").disabled
    app.number_input(key="board_square_mm").set_value(30.0).run()
    recording = search(app, home).recording
    assert recording is not None and recording.object.board is not None
    assert min(len(recording.common_frames(*pair)) for pair in recording.pairs) >= 4
    # The corners of the rolled camera have the numbers of the others': one pose fits all boards.
    for number, name in enumerate(recording.cameras):
        for frame, board in zip(np.unique(recording.frame), boards, strict=True):
            rows = (recording.frame == frame) & (recording.camera == number)
            if not rows.any():
                continue
            true = SMALL.project((poses[name] @ board).apply(CORNERS))
            ways = [np.abs(recording.points[rows] - true[::way]).max() for way in (1, -1)]
            assert min(ways) < 1.0
            assert ways.index(min(ways)) == orders.setdefault(int(frame), ways.index(min(ways)))


def test_photographs_are_of_the_camera_that_they_name_or_that_is_said(app: AppTest) -> None:
    files, _ = photographed_bars()
    own = {
        name: [content for each, content in files.items() if each.startswith(name)][:4]
        for name in CAMERAS
    }
    # Before anything tells that there are three cameras.
    drop(go(app, "data"), {f"Left {n}.png": content for n, content in enumerate(own["left"])})
    drop(app, {f"{name}.json": write_camera(each) for name, each in CAMERAS.items()})
    flat = zipped({f"{n}.png": content for n, content in enumerate(own["mid"])})
    ordinary = {f"DSC_{n:04}.png": content for n, content in enumerate(own["right"])}
    drop(app, {"mid.zip": flat, **ordinary})
    assert "Which camera took DSC_0000 to DSC_0003 (4)?" in told(app, "markdown")
    (button,) = (button for button in app.button if button.label == "right")
    button.click().run()
    assert "Photographs: left 4, mid 4, right 4" in told(app, "markdown")
    assert "Which camera" not in told(app, "markdown")


def test_a_rig_file_serves_as_the_camera_files_of_all(app: AppTest, home: Path) -> None:
    drop(go(app, "data"), {"rig.json": rig_text().encode()})
    drop(app, {"points.csv": files_of_rig()["points.csv"]})
    app.number_input(key="several_B_m").set_value(0.39).run()
    assert "1-2 (" in told(app, "caption") and not app.error
    project = Project.open(home, find_projects(home)[0])
    assert [*ProjectGiven(project).parts] == ["1.json", "2.json", "3.json", "points.csv"]


def test_a_file_of_three_cameras_and_a_table_are_a_rig_or_two_of_them(
    app: AppTest, home: Path
) -> None:
    files = {"array.toml": caliscope_files()[0], "wand.csv": wand_csv(more_cameras=1)}
    given(app, files)
    project = Project.open(home, find_projects(home)[0])
    assert {*ProjectGiven(project).parts} == {*files}
    missing = told(app, "warning")
    assert "distance from A to B is missing" in missing and "--" not in missing  # no option
    app.number_input(key="several_B_m").set_value(0.6).run()
    assert "Camera 3 sees no end of the bar" in told(app, "warning")
    app.button(key="several_two").click().run()
    assert not ProjectGiven(project).parts
    assert {button.key for button in app.button} >= {"aside_archive", "aside_bars"}


def test_two_cameras_whose_table_names_them_are_a_pair(app: AppTest, home: Path) -> None:
    files = files_of_rig()
    head, *rows = files["points.csv"].splitlines(keepends=True)
    files["points.csv"] = head + b"".join(row for row in rows if row.split(b",")[1] != b"3")
    given(app, {name: files[name] for name in ("camera_1.yaml", "camera_2.yaml", "points.csv")})
    app.number_input(key="several_B_m").set_value(0.39).run()
    app.button(key="several_run").click().run()
    dataset = Project.open(home, find_projects(home)[0]).dataset
    assert dataset is not None and dataset.target_distance_m == 0.39
    assert not app.exception and "Complete:" in told(app, "success")


def test_names_that_do_not_match_are_reported(app: AppTest, home: Path) -> None:
    assert home.is_dir()
    photo = photographed_bars()[0]["left/0001.png"]
    given(app, {f"{name}.json": write_camera(own) for name, own in CAMERAS.items()})
    give(app, {f"{camera}/{name}.png": photo for camera, name in zip(CAMERAS, "abc", strict=True)})
    assert "name those of one moment alike" in told(app, "warning")


def test_photographs_of_three_cameras_ask_for_their_camera_files(app: AppTest) -> None:
    files, _ = photographed_bars()
    three = {
        f"int_cam{number}/{at}.png": content
        for number, name in enumerate(CAMERAS, start=1)
        for at, content in enumerate([c for each, c in files.items() if each.startswith(name)][:3])
    }
    drop(go(app, "data"), {"boards.zip": zipped(three)})
    assert "of 3 cameras: cam1, cam2, cam3" in told(app, "info")
    drop(app, {f"cam{n}.json": write_camera(c) for n, c in enumerate(CAMERAS.values(), start=1)})
    assert "cam1 3, cam2 3, cam3 3" in told(app, "markdown")
