"""The pages: what they say, what they keep, their menu, and that no traceback shows."""

from collections.abc import Mapping
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.exchange.exchange import export_files
from stereocal.projects.application import ProjectApplication
from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.ui.menu import SECTIONS, TITLES
from tests.files import zipped
from tests.formats.test_exchange import FULL as FULL_RIG
from tests.pages.stored_projects import (
    FEW,
    FULL,
    ROOT,
    again,
    drop,
    go,
    messages,
    page_of,
    pictured,
    placed,
    project_of,
    told,
)

FIELD = ROOT / "sample_data" / "field"


def open_sample(app: AppTest) -> AppTest:
    app.button(key="demo").click().run()
    return app.switch_page("pages/data.py").run()


def give_zip(app: AppTest, files: Mapping[str, bytes]) -> AppTest:
    return drop(go(app, "data"), {"rig.zip": zipped(files)})


def test_every_page_says_what_it_lacks(app: AppTest) -> None:
    assert "Nothing is loaded yet" in messages(app.switch_page("pages/data.py").run())
    assert "it needs points, cameras" in messages(app.switch_page("pages/calibrate.py").run())


def test_sample_to_result_and_back_in_a_new_session(app: AppTest, home: Path) -> None:
    open_sample(app)
    assert "50 pairs of points in 25 frames" in messages(app)
    app.switch_page("pages/calibrate.py").run()
    assert "No result yet" in messages(app)
    app.slider(key="calibration_frames_1_25").set_value(20).run()
    project = project_of(app, home)
    project.keep_settings({"validate_splits": "frames", **FEW})
    app.button(key="run").click().run()
    assert "Use the refined set for both" in messages(app)
    result, evaluation = project.calibration, project.calibration_evaluation
    assert result is not None and len(result.frames) == 20
    # The tiles are of whole runs, whatever Validate shows.
    assert evaluation is not None and evaluation.settings.splits == "runs"

    tab = again(app, "calibrate")
    assert "Use the refined set for both" in messages(tab)
    assert tab.slider(key="calibration_frames_1_25").value == 20


def test_real_recording_with_its_middle_marker_to_apply(app: AppTest, home: Path) -> None:
    app.button(key="recording").click().run()
    app.switch_page("pages/data.py").run()
    assert "818 pairs of points in 409 frames" in messages(app)
    project = project_of(app, home)
    read = read_dataset(FIELD.parent / "recording")
    assert project.dataset is not None and project.dataset.sha256 == read.sha256
    assert project.table is not None and b"time_frame" in project.table[1]
    store = ProjectApplication(project)
    for side in CAMERAS:
        points = store.points(side)
        assert points is not None and (points.rows, points.frames) == (409, 409)


def test_form_that_moved_on_is_said_and_the_result_stays(pressed: AppTest) -> None:
    app = pressed
    assert states(app)["calibrate"] == "done"
    app.number_input(key="delta").set_value(2e-3).run()
    assert (
        "Changed since this result: Δ (0.001, now 0.002). It is shown as it was before."
        in messages(app)
    )
    assert "Use the refined set for both" in messages(app)
    app.switch_page("pages/data.py").run()
    app.number_input(key="baseline_m_value").set_value(4.6).run()
    assert states(app)["calibrate"] == "stale"
    app.switch_page("pages/calibrate.py").run()
    assert "baseline (4.5 m, now 4.6 m), Δ (0.001, now 0.002)" in messages(app)
    assert app.number_input(key="delta").value == 2e-3


BAD_CELLS = ((5, "x", 'u_primary is "x"'), (9, "5000", "outside the 2336x1728 px image"))


def test_bad_rows_are_listed_and_can_be_left_out_unless_all_are(app: AppTest) -> None:
    open_sample(app)
    lines = (FIELD / "correspondences.csv").read_text().splitlines()
    for line, value, reason in BAD_CELLS:
        cells = lines[line - 1].split(",")
        cells[2] = value
        bad = [*lines[: line - 1], ",".join(cells), *lines[line:]]
        drop(app, {"points.csv": "\n".join(bad).encode()})
        refused = app.dataframe[0].value
        assert list(refused["Line"]) == [line]
        assert reason in refused["Refused because"][0]
        app.button(key="use_rest").click().run()
        assert "49 pairs of points in 25 frames" in messages(app)
    bad = [lines[0], *(line.rsplit(",", 1)[0] + ",9e9" for line in lines[1:])]
    drop(app, {"points.csv": "\n".join(bad).encode()})
    assert len(app.dataframe[0].value) == len(lines) - 1
    assert not [button for button in app.button if button.key == "use_rest"]


def test_a_bad_row_of_a_recording_of_three_cameras_is_listed(app: AppTest) -> None:
    files = {file.name: file.read_bytes() for file in (FIELD.parent / "rig").iterdir()}
    files["points.csv"] = files["points.csv"].replace(b"257.346", b"9999", 1)
    give_zip(app, files)
    assert list(app.dataframe[0].value["Line"]) == [3]


def test_the_first_number_and_its_unit_may_come_together(app: AppTest, home: Path) -> None:
    go(app, "data").number_input(key="baseline_m_value").set_value(300.0)
    app.selectbox(key="baseline_m_unit").set_value("cm").run()
    assert project_of(app, home).inputs.baseline_m == 3.0


def test_lengths_that_cannot_be_are_said_and_the_old_ones_stay(app: AppTest, home: Path) -> None:
    open_sample(app)
    app.number_input(key="target_distance_m_value").set_value(0.0).run()
    assert "must be a length above 0" in messages(app)
    assert project_of(app, home).inputs.target_distance_m == 0.9
    app.number_input(key="baseline_m_value").set_value(4500.0).run()
    assert "looks like millimetres" in messages(app)
    assert project_of(app, home).inputs.baseline_m == 4.5
    (way,) = (button for button in app.button if button.label == "It is 4500 mm")
    way.click().run()
    assert "looks like millimetres" not in messages(app)
    # A bar in millimetres beside a baseline in metres.
    project = project_of(app, home)
    project.give({}, target_distance_m=900.0)
    app.run()
    assert not [button for button in app.button if button.label.startswith("They are in inch")]
    app.button(key="bar_in_mm").click().run()
    assert project.inputs.target_distance_m == pytest.approx(0.9)
    assert project.inputs.baseline_m == pytest.approx(4.5)
    assert not app.warning
    project.give({"secondary": ("primary.json", (FIELD / "primary.json").read_bytes())})
    app.run()
    assert "Both cameras have the same file" in messages(app)


def test_a_wrong_length_stands_beside_the_recommendation(app: AppTest, home: Path) -> None:
    """Every figure can be good while all lengths are 5 % wrong."""
    open_sample(app)
    project = project_of(app, home)
    project.give({}, target_distance_m=0.95)
    project.keep_settings(FEW)
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    assert any("contradict each other" in item.value for item in app.warning)
    assert "Disagreement of each input" in pictured(app)
    assert not [item.value for item in app.success if "refined set" in item.value]


def test_lengths_in_another_unit_are_asked_about_once(app: AppTest, home: Path) -> None:
    open_sample(app)
    project = project_of(app, home)
    assert any("The cameras are 4.5 m apart" in item.value for item in app.markdown)
    project.give({}, baseline_m=450.0, target_distance_m=90.0)
    app.run()
    (asked,) = (item.value for item in app.warning if "in metres?" in item.value)
    assert "4.5 and 0.9 m if they are in cm" in asked
    app.button(key="in_metres").click().run()
    assert not app.warning and project.inputs.baseline_m == 450.0
    project.give({}, baseline_m=460.0)
    app.run()
    app.button(key="in_cm").click().run()
    assert not app.warning and not app.exception
    assert project.inputs.baseline_m == pytest.approx(4.6)
    assert project.inputs.target_distance_m == pytest.approx(0.9)
    assert app.number_input(key="baseline_m_value").value == pytest.approx(4.6)


@pytest.mark.parametrize("press, baseline_m", [("in_metres", 4.5), ("lengths_right", 0.045)])
def test_a_number_whose_unit_was_changed_is_taken_as_the_button_says(
    press: str, baseline_m: float, app: AppTest, home: Path
) -> None:
    open_sample(app)
    app.selectbox(key="baseline_m_unit").set_value("cm").run()
    project = project_of(app, home)
    assert project.inputs.baseline_m == pytest.approx(0.045)
    (asked,) = (item.value for item in app.warning)
    assert "0.045 m apart" in asked and not [b for b in app.button if b.key == "in_cm"]
    app.button(key=press).click().run()
    assert project.inputs.baseline_m == pytest.approx(baseline_m)
    assert not app.warning and not app.exception
    unit, number = app.selectbox(key="baseline_m_unit"), app.number_input(key="baseline_m_value")
    assert (unit.value, number.value) == ("m" if press == "in_metres" else "cm", 4.5)


@pytest.fixture
def project(home: Path) -> Project:
    return placed(FULL, home)


def states(app: AppTest) -> dict[str, str]:
    found = app.session_state["page_states"]
    return {name: state.mark for name, state in found.items()}


def test_camera_files_of_other_programs_are_asked_what_they_do_not_say(
    app: AppTest, home: Path
) -> None:
    """A message of ROS, and a file of OpenCV whose image size is asked."""
    cases = Path(__file__).parent.parent / "cases"
    right = (cases / "ros_topic_echo" / "r2.yaml").read_bytes()
    left = (cases / "image_size_option_ignored" / "l.yml").read_bytes()
    drop(go(app, "data"), {"left.yml": left, "right.yaml": right})
    assert "left.yml: the file does not state the size of the images" in messages(app)
    for side, pixels in (("width", 1600), ("height", 1200)):
        app.number_input(key=f"refused_{side}").set_value(pixels)
    app.button(key="use_rest").click().run()
    assert not app.error and not app.exception
    primary, secondary = project_of(app, home).cameras
    assert primary is not None and secondary is not None
    assert (primary.image_size, secondary.image_size) == ((1600, 1200), (1920, 1080))
    assert (primary.K[0, 0], secondary.K[0, 0]) == (1500, 1510)


def test_the_baseline_of_two_camera_info_files_is_proposed(app: AppTest, home: Path) -> None:
    """Of ROS, in the projection matrix of the second; stored only when it is accepted."""
    files = export_files(FULL_RIG, "ros")
    drop(go(app, "data"), {f"{which}.yaml": files[f"{which}.yaml"] for which in CAMERAS})
    project = project_of(app, home)
    assert all(project.cameras) and project.inputs.baseline_m is None
    app.button(key="use_nominal_baseline").click().run()
    stated = project.inputs
    assert stated.baseline_m == pytest.approx(FULL_RIG.pose.baseline, rel=1e-6)
    assert stated.baseline_sigma_m == pytest.approx(0.02 * FULL_RIG.pose.baseline, rel=1e-6)
    assert not [button for button in app.button if button.key == "use_nominal_baseline"]


def test_every_file_of_pages_is_in_one_group() -> None:
    files = sorted(path.stem for path in (Path(__file__).parents[2] / "pages").glob("*.py"))
    assert sorted(TITLES) == files
    assert list(SECTIONS) == ["stereocal", "Before", "Calibrate", "Use"]


def test_the_project_is_named_and_renamed(project: Project) -> None:
    app = page_of(project, "validate")
    name = app.sidebar.text_input(key="project_name")
    assert name.value == project.inputs.name
    name.set_value("Meadow").run()
    assert project.inputs.name == "Meadow"
    assert app.sidebar.caption[0].value.startswith("Saved 20")
    assert not app.exception and not app.error
    assert go(app, "data").sidebar.text_input(key="project_name").value == "Meadow"


def test_sample_photographs_fill_all_pages(app: AppTest, home: Path) -> None:
    app.button(key="demo_photographs").click().run()
    app.switch_page("pages/data.py").run()
    assert "50 photographs. 25 pairs by name" in told(app)
    assert app.number_input(key="baseline_m_value").value == 4.5
    assert not app.button(key="find_targets").disabled
    project = project_of(app, home)
    assert all(project.cameras)
    assert project.inputs.missing == ["the table of points"]
    assert "Still missing: the targets in the photographs (press *Find the targets*)" in told(app)
    for which in CAMERAS:
        assert len(ProjectLens(project, which).photographs) == 22
    app.switch_page("pages/cameras.py").run()
    assert "Of the primary camera: 22 photographs" in told(app)
    assert app.number_input(key="board_columns").value == 18


def test_large_counts_are_written_alike(app: AppTest, home: Path) -> None:
    open_sample(app)
    dataset = project_of(app, home).dataset
    assert dataset is not None
    head, *rows = write_table(dataset.correspondences).decode().splitlines()
    many = [
        f"{int(frame) + 1000 * k},{rest}"
        for k in range(30)
        for frame, rest in (row.split(",", 1) for row in rows)
    ]
    drop(app, {"correspondences.csv": "\n".join([head, *many]).encode()})
    assert f"Complete: {len(many):,} pairs of points" in told(app, "success")
    assert f"{len(many):,}" in app.table[-1].value.to_string()
    shown = "".join([messages(app), app.table[-1].value.to_string()])
    assert str(len(many)) not in shown


def test_one_button_of_a_page_stands_out(project: Project) -> None:
    app = page_of(project)
    for page in ("data", "validate", "apply", "check", "plan"):
        go(app, page)
        buttons = [*app.get("button"), *app.get("download_button")]
        first = [each.proto.label for each in buttons if each.proto.type == "primary"]
        assert len(first) <= 1, (page, first)


def test_a_plan_without_a_project_is_kept_by_the_button_that_stands_out(app: AppTest) -> None:
    go(app, "plan")
    assert app.button(key="plan_start").proto.type == "primary"
    assert app.button(key="next").proto.type == "secondary"
