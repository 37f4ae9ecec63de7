"""Two videos on the Data page become photographs of the project."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.photographs import ProjectPhotographs
from tests.pages.test_apply import app as app
from tests.pages.test_apply import home as home
from tests.pages.test_apply import said
from tests.pages.test_asked import project_of
from tests.pages.waiting import ended
from tests.videos import write_video

pytest.importorskip("av")


def give(app: AppTest, primary: bytes, secondary: bytes) -> AppTest:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("Photographs").run()
    app.segmented_control(key="photographs_how").set_value("Two videos").run()
    for which, content in (("primary", primary), ("secondary", secondary)):
        found = next(
            each
            for each in app.file_uploader
            if str(each.key).endswith(f"_{which}") and str(each.key).startswith("upload_videos")
        )
        found.upload(f"{which}.mp4", content)
    return app.run()


def test_videos(app: AppTest, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    times = [k / 25 for k in range(50)]
    whole = write_video(tmp_path / "a.mp4", times).read_bytes()
    kept = [k for k in range(50) if k != 30]
    dropped = write_video(tmp_path / "b.mp4", [times[k] for k in kept], numbers=kept).read_bytes()
    give(app, whole, dropped)
    app.selectbox(key="video_choice").select("every").run()
    app.number_input(key="video_n").set_value(10).run()
    app.button(key="take_frames").click().run()
    project = project_of(app, home)
    assert ended(project, "video").state == "done"
    app.run()
    assert "1 frame is missing" in said(app, "warning")
    store = ProjectPhotographs(project)
    assert [row.pair.frame for row in store.rows] == [1, 11, 21, 32, 41]
    assert not list(temporary.glob("stereocal-video-*"))
