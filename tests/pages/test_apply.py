"""The Apply page, the wizard and the menu of formats, without a browser."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.cli import main
from stereocal.figures.space import VIEWS
from stereocal.formats.exchange.exchange import FORMATS
from stereocal.matching.application import PAIRS, POINTS
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.project import Project
from stereocal.rig.camera import CameraName
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.ui import apply as apply_page
from stereocal.ui import apply_frames
from stereocal.ui.apply import FILES, OWN
from tests.known_rig import PRIMARY, RIG, SECONDARY, bar_ends, images
from tests.pages.waiting import ended

ROOT = Path(__file__).parents[2]
SLOW = 120
SET_2D = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, matching_threshold_px=0.8)
SET_3D = replace(SET_2D, method="3d", matching_threshold_px=None)


def tables(frames: int = 6, points: int = 15) -> dict[CameraName, pd.DataFrame]:
    """Points of both cameras, shuffled; `bird` tells which is which."""
    rng = np.random.default_rng(4)
    sides: dict[CameraName, list[pd.DataFrame]] = {"primary": [], "secondary": []}
    for frame in range(1, 1 + frames):
        seen = images(rng.uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5], (points, 3)))
        for side, pixels in zip(sides, seen, strict=True):
            order = rng.permutation(points)
            u, v = pixels[order].T
            sides[side].append(pd.DataFrame({"frame": frame, "u": u, "v": v, "bird": order}))
    return {side: pd.concat(parts, ignore_index=True) for side, parts in sides.items()}


def csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False).encode()


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


@pytest.fixture
def app(home: Path) -> Iterator[AppTest]:
    assert not home.exists()
    started = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    yield started
    assert not started.exception


def said(app: AppTest, *kinds: str) -> str:
    wanted = kinds or ("error", "info", "warning", "success", "caption")
    return " ".join(str(item.value) for kind in wanted for item in getattr(app, kind)).replace(
        "\\", ""
    )


def calibrated(app: AppTest) -> AppTest:
    app.button(key="demo").click().run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    return app.switch_page("pages/apply.py").run()


def begun(app: AppTest) -> AppTest:
    app.switch_page("pages/apply.py").run()
    app.button(key="apply_begin").click().run()
    return app


def give_sets(app: AppTest, matching: RigParameters, measuring: RigParameters) -> AppTest:
    for use, rig in (("matching", matching), ("measuring", measuring)):
        content = rig.dumps().encode()
        app.file_uploader(key=f"upload_set_{use}").upload(f"{use}.json", content).run()
    return app


def give_points(app: AppTest, primary: bytes, secondary: bytes) -> AppTest:
    app.file_uploader(key="upload_points_primary").upload("p.csv", primary).run()
    return app.file_uploader(key="upload_points_secondary").upload("s.csv", secondary).run()


def with_files(app: AppTest) -> AppTest:
    both = tables()
    give_points(begun(app), csv(both["primary"]), csv(both["secondary"]))
    return give_sets(app, SET_2D, SET_3D)


def store_of(app: AppTest, home: Path) -> ProjectApplication:
    return ProjectApplication(Project.open(home, app.session_state["project_id"]))


def written(app: AppTest, home: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    result = store_of(app, home).result
    assert result is not None
    return pd.read_csv(io.BytesIO(result[1][PAIRS].read_bytes())), pd.read_csv(
        io.BytesIO(result[1][POINTS].read_bytes())
    )


def test_nothing_yet_is_said(app: AppTest) -> None:
    app.switch_page("pages/apply.py").run()
    assert "it needs points of both cameras" in said(app)
    begun(app)
    assert "Still missing: the points of both cameras" in said(app)
    assert "Still missing: a parameter file" in said(app)


def test_own_points_are_matched_and_measured(app: AppTest, home: Path) -> None:
    calibrated(app)
    answer = "50 pairs in 25 frames, none of them ambiguous, none outside the volume of the bars."
    assert answer in said(app, "success")
    assert "50 of 50 pairs have the same target in both cameras" in said(app, "caption")
    assert "50 points, median reprojection error" in said(app, "caption")
    pairs, points = written(app, home)
    assert len(pairs) == len(points) == 50
    assert not points["outside_volume"].any()  # the volume holds the bars that it was found from
    assert (pairs["target_primary"] == pairs["target_secondary"]).all()
    app.segmented_control(key="apply_view").set_value("A known length").run()
    app.selectbox(key="apply_way").set_value("target_primary").run()
    # The bar is 0.9 m; with the 3D set, fitted to these very bars. Measured: 0.13 %.
    sentence = said(app, "success")
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


def test_frames_can_be_chosen_and_played(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    with_files(app)
    slider = app.slider(key="apply_frame")
    assert (slider.min, slider.max, slider.value) == (1, 6, 1)
    assert "Frame 1: 15 pairs" in said(app, "caption")
    app.button(key="apply_next").click().run()
    assert "Frame 2: 15 pairs" in said(app, "caption")
    app.slider(key="apply_frame").set_value(4).run()
    assert "Frame 4: 15 pairs" in said(app, "caption")
    monkeypatch.setattr(apply_frames, "STEP_S", 0.0)
    app.button(key="apply_play").click().run()
    assert (
        app.slider(key="apply_frame").value == 5 and app.button(key="apply_play").label == "Pause"
    )
    app.run()
    assert "Frame 6: 15 pairs" in said(app, "caption")
    app.run()
    assert app.button(key="apply_play").label == "Play"  # at the end
    app.button(key="apply_play").click().run()
    assert app.slider(key="apply_frame").value == 2  # from the beginning
    app.button(key="apply_play").click().run()
    assert app.button(key="apply_play").label == "Play"


def test_points_with_a_name_are_connected(app: AppTest) -> None:
    begun(app)
    way = np.stack([np.linspace(-1, 1, 30), np.full(30, 0.3), np.linspace(7, 9, 30)], axis=1)
    sides = [
        pd.DataFrame({"frame": range(30), "u": seen[:, 0], "v": seen[:, 1], "bird": 7})
        for seen in images(way)
    ]
    give_points(app, *map(csv, sides))
    give_sets(app, SET_2D, SET_3D)
    lines = app.selectbox(key="apply_tracks")
    assert lines.options == ["nothing", "the point of each frame"]
    assert lines.value == "the point of each frame"
    assert "lines connect them to 1 track" in said(app, "caption")
    lines.set_value("nothing").run()
    assert "lines connect" not in said(app, "caption")


def test_the_files_are_those_of_the_command_line(app: AppTest, home: Path, tmp_path: Path) -> None:
    with_files(app)
    both = tables()
    for side, table in both.items():
        (tmp_path / f"{side}.csv").write_bytes(csv(table))
    SET_2D.save(tmp_path / "2d.json")
    SET_3D.save(tmp_path / "3d.json")
    for threshold in ("0.8", "0.25"):
        app.number_input(key="apply_threshold").set_value(float(threshold)).run()
        assert (
            main(
                [
                    "match",
                    *(str(tmp_path / f"{side}.csv") for side in both),
                    "--parameters",
                    str(tmp_path / "2d.json"),
                    "--threshold",
                    threshold,
                    "--out",
                    str(tmp_path / PAIRS),
                ]
            )
            == 0
        )
        assert (
            main(
                [
                    "reconstruct",
                    str(tmp_path / PAIRS),
                    "--parameters",
                    str(tmp_path / "3d.json"),
                    "--out",
                    str(tmp_path / POINTS),
                ]
            )
            == 0
        )
        result = store_of(app, home).result
        assert result is not None
        for name in (PAIRS, POINTS):
            assert result[1][name].read_bytes() == (tmp_path / name).read_bytes()


def test_point_files_are_given_in_plain_sight_and_used_once_both_are_there(app: AppTest) -> None:
    calibrated(app)
    assert app.selectbox(key="apply_points").value == OWN
    folded = {each.key for expander in app.expander for each in expander.get("file_uploader")}
    assert not {"upload_points_primary", "upload_points_secondary"} & folded
    app.selectbox(key="apply_points").set_value(OWN).run()
    content = csv(tables()["primary"])
    app.file_uploader(key="upload_points_primary").upload("p.csv", content).run()
    assert "Not in use: p.csv" in said(app, "caption")
    assert "Still missing: the points of the secondary camera." in said(app, "info")
    assert "50 pairs in 25 frames" in said(app, "success")
    content = csv(tables()["secondary"])
    app.file_uploader(key="upload_points_secondary").upload("s.csv", content).run()
    assert app.selectbox(key="apply_points").value == FILES
    assert "Still missing" not in said(app, "info")


def test_the_bar_is_no_known_length_of_other_points(app: AppTest, home: Path) -> None:
    with_files(app)
    store_of(app, home).project.give({}, target_distance_m=0.9)
    app.segmented_control(key="apply_view").set_value("A known length").run()
    assert app.number_input(key="apply_known").value is None
    assert "Give the known length." in said(app, "info")


def test_points_outside_the_volume_of_the_bars_are_said_and_drawn(app: AppTest, home: Path) -> None:
    with_files(app)
    assert "volume" not in said(app)
    volume = Volume((-1.0, 1.0), (-1.0, 1.0), (5.0, 8.0))
    give_sets(app, SET_2D, replace(SET_3D, volume=volume))
    points = written(app, home)[1]
    outside = (points["z"] > 8.0).to_numpy()
    np.testing.assert_array_equal(points["outside_volume"], outside)
    assert f"{outside.sum()} outside the volume of the bars." in said(app, "success")
    assert (
        f"{outside.sum()} of 90 points lie outside the volume that the bars filled (5 to 8 m)"
        in (said(app, "caption"))
    )
    assert f"{outside.sum()} of them outside the volume of the bars" in said(app, "caption")
    app.segmented_control(key="apply_view").set_value("A known length").run()
    assert "outside_volume" not in app.selectbox(key="apply_way").options


def test_threshold_moves_the_result_and_is_kept(app: AppTest, home: Path) -> None:
    with_files(app)
    field = app.number_input(key="apply_threshold")
    assert field.value is None
    assert field.placeholder.startswith("0.8, ")
    assert "cannot be estimated" in said(app, "caption")  # exact points
    before, _ = written(app, home)
    assert len(before) == 90  # exact points: none is lost, however small the threshold
    app.number_input(key="apply_threshold").set_value(40.0).run()
    after, _ = written(app, home)
    assert after["ambiguous"].sum() > before["ambiguous"].sum()
    app.segmented_control(key="apply_view").set_value("Threshold and depths").run()
    assert "90 have a partner within 40 px" in said(app, "caption")
    assert "Threshold 40 px" in said(app, "caption")
    app.number_input(key="apply_sigma_px").set_value(0.5).run()
    assert "Your points scatter by 0.5 px, as stated." in said(app, "caption")
    assert written(app, home)[0]["sigma_primary_px"].eq(0.5).all()

    again = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    again.query_params["project"] = app.session_state["project_id"]
    again.run().switch_page("pages/apply.py").run()
    assert again.number_input(key="apply_threshold").value == 40.0
    assert again.number_input(key="apply_sigma_px").value == 0.5
    assert "In use: p.csv, 90 points In use: s.csv, 90 points" in said(again, "caption")
    assert "90 pairs in 6 frames" in said(again, "success")


def test_depth_range_is_a_second_gate(app: AppTest, home: Path) -> None:
    with_files(app)
    app.segmented_control(key="apply_view").set_value("Threshold and depths").run()
    app.toggle(key="apply_only_depths").set_value(True).run()
    app.number_input(key="apply_near").set_value(7.0).run()
    app.number_input(key="apply_far").set_value(9.0).run()
    _, points = written(app, home)
    assert 0 < len(points) < 90
    assert points["z"].between(7, 9).all()
    app.number_input(key="apply_far").set_value(5.0).run()
    assert "The depth range 7 to 5 m is not possible" in said(app, "error")
    assert "have changed since this result" in said(app, "warning")


def test_a_long_work_runs_as_a_job(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apply_page, "INSTANT_S", 0.0)
    with_files(app)
    assert "No result yet" in said(app)
    app.button(key="apply_run").click().run()
    assert ended(store_of(app, home).project, "apply").state == "done"
    app.run()
    assert "90 pairs in 6 frames" in said(app, "success")


def test_sets_used_for_the_wrong_purpose_and_of_another_rig(app: AppTest, home: Path) -> None:
    with_files(app).number_input(key="apply_threshold").set_value(0.7).run()
    give_sets(app, SET_3D, SET_2D)
    assert "Match with parameters_2d.json" in said(app, "warning")
    assert "Measure with parameters_3d.json" in said(app, "warning")
    kept = written(app, home)[0]
    wider = replace(SET_3D, pose=replace(RIG, T=1.2 * RIG.T))
    give_sets(app, SET_2D, wider)
    assert "The two parameter files are of different rigs: the baseline" in said(app, "error")
    pd.testing.assert_frame_equal(written(app, home)[0], kept)
    small = replace(PRIMARY, image_size=(800, 600))
    give_sets(app, replace(SET_2D, primary=small), replace(SET_3D, primary=small))
    assert "the parameters are of images of 800x600 px" in said(app, "error")
    pd.testing.assert_frame_equal(written(app, home)[0], kept)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"frame,u,v\n1,5,5\n1,nine,5\n", 'line 3: u is "nine"'),
        (b"frame,u,v\n", "the file has one row only"),
        (b"", "the file is empty"),
        (b"frame,u,v\n1,,\n", "the table has no rows with points"),
        (b"\x00\x01\x02\x03" * 50, "this is not a text file"),
    ],
)
def test_a_bad_file_is_said_and_nothing_is_lost(
    app: AppTest, home: Path, content: bytes, sentence: str
) -> None:
    with_files(app)
    app.file_uploader(key="upload_points_primary").upload("bad.csv", content).run()
    assert sentence in said(app, "error")
    assert "What was loaded before is unchanged" in said(app, "error")
    assert "In use: p.csv, 90 points" in said(app, "caption")
    assert "90 pairs" in said(app, "success")
    assert str(home) not in said(app)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: t.assign(frame=t["frame"] + 100), "no frame in common"),
        (lambda t: pd.concat([t, t.iloc[[3]]]).sort_values("frame", kind="stable"), "twice"),
        (lambda t: t.assign(u=t["u"].where(t.index != 3, 5000.0)), "is outside the"),
        (lambda t: t.assign(u=t["u"] + 900), "of another camera, or the images were scaled"),
    ],
)
def test_points_that_do_not_fit_are_said(
    app: AppTest, home: Path, change: object, sentence: str
) -> None:
    with_files(app)
    assert callable(change)
    content = csv(change(tables()["primary"]))
    app.file_uploader(key="upload_points_primary").upload("odd.csv", content).run()
    assert sentence in said(app, "error")
    assert "odd.csv" in said(app, "error")
    assert "90 pairs" in said(app, "success")
    assert str(home) not in said(app)


def test_a_frame_in_one_camera_only_is_a_note(app: AppTest) -> None:
    both = tables()
    less = both["secondary"][both["secondary"]["frame"] != 2]
    give_points(begun(app), csv(both["primary"]), csv(less))
    give_sets(app, SET_2D, SET_3D)
    assert "1 frames are in p.csv only (2)" in said(app, "warning")
    assert "75 pairs in 5 frames" in said(app, "success")


def test_a_set_that_is_none_is_said(app: AppTest) -> None:
    with_files(app)
    for content in (b"{}", b"\xff\xfe", b"[1"):
        app.file_uploader(key="upload_set_matching").upload("bad.json", content).run()
        assert "bad.json: " in said(app, "error")
        assert "In use: matching.json" in said(app, "caption")


def dltdv(height: tuple[int, int] = (1200, 1024)) -> bytes:
    """Both ends of the bar as DLTdv5 writes them, counted from the lower left."""
    first, second = images(bar_ends(6))
    lines = [
        "pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y,pt2_cam1_X,pt2_cam1_Y,pt2_cam2_X,pt2_cam2_Y"
    ]
    for k in range(6):
        cells = []
        for end in (0, 1):
            for view, high in zip((first, second), height, strict=True):
                u, v = view[2 * k + end]
                cells += [repr(float(u + 1)), repr(float(high - v))]
        lines.append(",".join(cells))
    return "\n".join(lines).encode()


def test_wizard_of_dltdv_files(app: AppTest, home: Path) -> None:
    give_points(begun(app), dltdv(), dltdv())
    assert any("looks like DLTdv5 to 7" in item.value for item in app.markdown)
    assert app.selectbox(key="wizard_primary_camera").value == "cam1"
    assert app.selectbox(key="wizard_secondary_camera").value == "cam2"
    assert "Give the image height" in said(app, "info")
    for side, height in (("primary", 1200), ("secondary", 1024)):
        app.number_input(key=f"wizard_{side}_image_height").set_value(height).run()
    preview = app.table[0].value
    first, _ = images(bar_ends(6))
    np.testing.assert_allclose(preview["u"].to_numpy(dtype=float)[0], first[0, 0], atol=1e-4)
    np.testing.assert_allclose(preview["v"].to_numpy(dtype=float)[0], first[0, 1], atol=1e-4)
    for side in ("primary", "secondary"):
        app.button(key=f"use_{side}").click().run()
    give_sets(app, SET_2D, SET_3D)
    pairs, points = written(app, home)
    assert len(pairs) == 12
    assert (pairs["point_primary"] == pairs["point_secondary"]).all()
    np.testing.assert_allclose(np.sort(points["z"]), np.sort(bar_ends(6)[:, 2]), rtol=0, atol=1e-9)
    # The answers are kept, for the same file and for the next.
    app.button(key="again_primary").click().run()
    assert app.number_input(key="wizard_primary_image_height").value == 1200
    app.selectbox(key="wizard_primary_corner").set_value("upper-left").run()
    app.button(key="aside_primary").click().run()
    assert len(written(app, home)[0]) == 12


def test_wizard_of_a_table_with_unknown_columns(app: AppTest, home: Path) -> None:
    both = tables()
    give_sets(begun(app), SET_2D, SET_3D)
    odd = {
        side: pd.DataFrame(
            {"when": t["frame"], "weight": 1.5, "down": t["v"] + 1, "right": t["u"] + 1}
        )
        for side, t in both.items()
    }
    give_points(app, csv(odd["primary"]), csv(odd["secondary"]))
    for side in ("primary", "secondary"):
        for name in ("frame", "u", "v"):
            chosen = app.selectbox(key=f"wizard_{side}_{name}")
            assert chosen.value is None  # nothing is proposed of a table that is not known
            assert "Choose the columns" in said(app, "info")
            chosen.set_value({"frame": 0, "u": 3, "v": 3}[name]).run()
        assert "choose three different columns" in said(app, "error")
        app.selectbox(key=f"wizard_{side}_v").set_value(2).run()
        app.number_input(key=f"wizard_{side}_first_pixel").set_value(1.0).run()
        app.button(key=f"use_{side}").click().run()
    pairs, _ = written(app, home)
    assert len(pairs) == 90 and "weight_primary" in pairs
    np.testing.assert_allclose(pairs["error_px"], 0, atol=1e-6)


def test_wand_file_on_the_data_page(app: AppTest, home: Path) -> None:
    app.switch_page("pages/data.py").run()
    first, second = images(bar_ends(6))
    rows = [
        [*second[2 * k], *first[2 * k], *second[2 * k + 1], *first[2 * k + 1]] for k in range(6)
    ]
    table = np.array(rows)
    table[:, 1::2] = np.array([1024, 1200, 1024, 1200]) - table[:, 1::2]
    content = "\n".join(",".join(map(repr, row)) for row in table.tolist()).encode()
    app.file_uploader(key="upload_correspondences").upload("wand.csv", content).run()
    assert any("looks like a wand file" in item.value for item in app.markdown)
    assert "Give the image heights" in said(app, "info")
    app.number_input(key="wizard_bars_height_0").set_value(1200).run()
    app.number_input(key="wizard_bars_height_1").set_value(1024).run()
    app.selectbox(key="wizard_bars_camera_0").set_value("cam2").run()
    assert "the two cameras are the same" in said(app, "error")
    app.selectbox(key="wizard_bars_camera_1").set_value("cam1").run()
    assert "12 pairs of points in 6 frames" in said(app, "caption")
    app.button(key="use_bars").click().run()
    project = Project.open(home, app.session_state["project_id"])
    assert project.table is not None and project.table[0] == "wand.csv"
    frame = pd.read_csv(io.BytesIO(project.table[1]))
    np.testing.assert_allclose(
        frame[["u_primary", "v_primary"]].to_numpy()[:6], first[::2], atol=1e-9
    )


def test_our_own_table_needs_no_wizard(app: AppTest) -> None:
    app.switch_page("pages/data.py").run()
    content = (ROOT / "sample_data/field/correspondences.csv").read_bytes()
    app.file_uploader(key="upload_correspondences").upload("points.csv", content).run()
    assert "In use: points.csv" in said(app, "caption")
    assert not any("looks like" in item.value for item in app.markdown)


def test_menu_of_formats(app: AppTest) -> None:
    app.button(key="demo").click().run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    app.segmented_control(key="view").set_value("Parameters").run()
    app.selectbox(key="format_file").set_value("3d").run()
    for name in FORMATS:
        app.selectbox(key="format").set_value(name).run()
        assert not app.exception
        assert not app.error, (name, said(app, "error"))
    assert "undistort points" in said(app, "caption")
    app.selectbox(key="dlt_corner_3d").set_value("lower-left").run()
    assert not app.exception and not app.error


def test_a_carried_project_has_the_result(app: AppTest, home: Path, tmp_path: Path) -> None:
    with_files(app)
    store = store_of(app, home)
    pack_project(store.project, tmp_path / "project.zip")
    there = unpack_project(tmp_path / "project.zip", "project.zip", tmp_path / "there")
    carried = ProjectApplication(there)
    before, after = store.result, carried.result
    assert before is not None and after is not None and after[0] == before[0]
    assert after[1][PAIRS].read_bytes() == before[1][PAIRS].read_bytes()
    assert carried.points("primary") is not None and carried.set_of("matching") is not None


def test_refined_set_serves_both(app: AppTest) -> None:
    calibrated(app)
    for use in ("matching", "measuring"):
        app.selectbox(key=f"apply_{use}").set_value("refined").run()
    assert "50 of 50 pairs have the same target" in said(app, "caption")
    assert not app.error and not app.warning
    app.selectbox(key="apply_matching").set_value("3d").run()
    assert "it accepts more wrong pairs" in said(app, "warning")
