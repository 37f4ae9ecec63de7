"""Two tables of cameras that were started by hand: dropped, answered, calibrated."""

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.ui.in_step import BY_HAND, IN_STEP
from tests.pages.stored_projects import FEW, dashboard, drop, go, project_of, run_job, told
from tests.rigs.moving_bar import counted_by_themselves

LATER = 137
FILES, _ = counted_by_themselves(LATER)
TABLES = {name: content for name, content in FILES.items() if name.endswith(".csv")}
LENSES = {name: content for name, content in FILES.items() if name.endswith(".json")}


def start_frame(app: AppTest, home: Path) -> int | None:
    dataset = project_of(app, home).dataset
    return None if dataset is None else dataset.start_frame


def answers(app: AppTest) -> list[str]:
    return [str(each.label) for each in app.button if str(each.key).startswith("use_bars")]


def with_lengths(app: AppTest) -> AppTest:
    for key, metres in (("baseline_m_value", 4.5), ("target_distance_m_value", 0.9)):
        app.number_input(key=key).set_value(metres).run()
    return app


def test_two_tables_are_dropped_answered_and_calibrated(home: Path) -> None:
    app = drop(dashboard("data"), FILES)
    assert "137.00" in told(app, "warning")
    assert answers(app) == [BY_HAND, IN_STEP]
    with_lengths(app.button(key="use_bars").click().run())
    assert "Complete" in told(app, "success") and "137.00" in told(app, "markdown")
    assert start_frame(app, home) == LATER
    project = project_of(app, home)
    project.keep_settings(FEW)
    run_job(go(app, "calibrate"), "run", project, "calibration")
    assert {each.key for each in app.get("download_button")} >= {"download_2d", "download_3d"}


def test_without_lenses_it_is_asked_and_the_lenses_tell(home: Path) -> None:
    app = drop(dashboard("data"), TABLES)
    assert answers(app) == [IN_STEP] and "camera files" in told(app, "info")
    drop(app, LENSES)
    assert answers(app) == [BY_HAND, IN_STEP]
    with_lengths(app.button(key="use_bars_1").click().run())
    assert start_frame(app, home) == 0


def test_tables_in_step_are_used_by_one_press_as_before(home: Path) -> None:
    files, _ = counted_by_themselves(later=0, frames=80)
    app = drop(dashboard("data"), files)
    assert answers(app) == ["Use these points"]
    with_lengths(app.button(key="use_bars").click().run())
    assert start_frame(app, home) == 0 and "started by hand" not in told(app)


@pytest.mark.parametrize("order", [("frame", "own"), ("own", "frame")])
def test_a_count_that_the_table_names_is_each_cameras_own(
    home: Path, order: tuple[str, str]
) -> None:
    named = {n: t.replace(b"frame,", b"camera_frame,", 1) for n, t in TABLES.items()}
    parts = {"frame": LENSES, "own": named}
    app = dashboard("data")
    for part in order:
        drop(app, parts[part])
    assert answers(app) == ["Use these points"]
    with_lengths(app.button(key="use_bars").click().run())
    assert start_frame(app, home) == LATER


def test_a_table_of_points_with_a_column_camera(home: Path) -> None:
    """In the columns of `points.csv`, as those of three cameras and more are given."""
    head, *_ = TABLES["left.csv"].split(b"\n", 1)
    rows = [
        row.replace(b",", b"," + camera + b",", 1)
        for camera in (b"left", b"right")
        for row in TABLES[f"{camera.decode()}.csv"].splitlines()[1:]
    ]
    assert head.strip() == b"frame,target,x,y"
    table = b"\n".join([b"frame,camera,target,u,v", *rows])
    app = drop(dashboard("data"), {"points.csv": table, **LENSES})
    app.number_input(key="several_B_m").set_value(0.9).run()
    assert "137.00" in told(app, "warning")
    assert [app.button(key=f"several_run{k}").label for k in ("", "_1")] == [BY_HAND, IN_STEP]
    app.button(key="several_run").click().run()
    assert start_frame(app, home) == LATER
