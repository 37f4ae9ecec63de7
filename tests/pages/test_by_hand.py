"""Two tables of cameras that were started by hand: dropped, answered, calibrated."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.frames.video.extract import VideoReport, VideoSettings
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.system.latest import Latest
from stereocal.ui import videos
from stereocal.ui.in_step import BY_HAND, IN_STEP
from tests.pages.stored_projects import FEW, dashboard, drop, ended, go, project_of, run_job, told
from tests.pages.test_pairing import png
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


def test_two_videos_are_asked_about_and_taken_anew_by_one_press(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sentence says that they are apart; the answer is above the search, and may be changed."""
    seen = list[bool]()

    def extract(
        paths: dict[str, Path], settings: VideoSettings, keep: Callable[..., object], *_: object
    ) -> VideoReport:
        assert [path.read_bytes() for path in paths.values()] == [b"one", b"two"]
        seen.append(settings.by_hand)
        for which in paths:
            keep(f"{which}/000001.png", png(np.zeros((48, 64), np.uint8), None))
        apart = "" if settings.by_hand else "They are 2.31 s apart."
        return VideoReport(("1 pair of frames was taken.", apart), 1, False, {}, apart)

    monkeypatch.setattr(videos, "extract", extract)
    app = drop(dashboard("data"), {"left.mp4": b"one", "right.mp4": b"two"})
    project = project_of(app, home)
    ended(project, "video")
    app.run()
    assert "2.31" in told(app, "warning") and "2.31" not in told(app, "success")
    run_job(app, "videos_by_hand", project, "video")
    assert "2.31" not in told(app)
    assert ProjectPhotographs(project).choice.way == "motion"
    app.segmented_control(key="video_by_hand").set_value(False).run()
    ended(project, "video")
    assert seen == [False, True, False]
    assert ProjectPhotographs(project).choice.way != "motion"
    monkeypatch.setattr(videos, "_TAKEN", Latest(1))  # as after a restart
    app.segmented_control(key="video_by_hand").set_value(True).run()
    assert "again" in told(app, "warning") and len(seen) == 3
