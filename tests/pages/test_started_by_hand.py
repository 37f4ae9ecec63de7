"""The Data page with cameras that count their own frames."""

from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.files import zipped
from tests.pages.stored_projects import dashboard, drop, ended, go, page_of, project_of, told
from tools.photographs.started_by_hand import START_S, write_sample


def test_data_brings_them_into_step_and_says_how(home: Path, tmp_path: Path) -> None:
    assert main(["sample", "by_hand", "--out", str(tmp_path)]) == 0
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    lines = files["points.csv"].splitlines(keepends=True)
    early = [line for line in lines[1:] if int(line.split(b",")[0]) < 200]
    files["points.csv"] = b"".join([lines[0], *early])
    app = go(drop(dashboard("data"), {"recording.zip": zipped(files)}), "data")
    assert "The cameras were started by hand" in [str(each.value) for each in app.subheader]
    assert any("one frame off" in str(each.value) for each in app.markdown)
    recording = project_of(app, home).recording
    assert recording is not None
    assert recording.start_frames == {"1": 0, "2": 41, "3": -118}
    app.toggle(key="show_offsets").set_value(True).run()
    assert not app.exception


@pytest.mark.soak  # the command takes these steps in tests/frames/test_by_motion.py
def test_videos_of_cameras_started_by_hand(home: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    given = tmp_path / "given"
    write_sample(given)
    project = Project.create(home)
    project.keep_settings({"held": "balls", "held_balls": "red,yellow"})
    app = page_of(project, "data")
    app.toggle(key="video_by_hand").set_value(True).run()
    drop(app, {path.name: path.read_bytes() for path in given.iterdir()})
    ended(project, "video")
    app.run()
    assert "Until then, the first with the first" in told(app)
    app.button(key="find_targets").click().run()
    ended(project, "photographs")
    app.run()
    assert not app.exception
    assert "by the motion" in told(app) and "The sound agrees" in told(app)
    frames = ProjectPhotographs(project).frames or []
    first, second = (int(name.split("/")[1][:6]) for name in frames[5].files)
    assert abs((first - second) / 15 - START_S) < 1 / 30
    assert sum(frame.use for frame in frames) > 60
