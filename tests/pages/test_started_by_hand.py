"""The Data page with cameras that count their own frames."""

from pathlib import Path

from stereocal.cli import main
from stereocal.projects.recording import ProjectRecording
from tests.files import zipped
from tests.pages.stored_projects import dashboard, drop, go, project_of


def test_data_brings_them_into_step_and_says_how(home: Path, tmp_path: Path) -> None:
    assert main(["sample", "by_hand", "--out", str(tmp_path)]) == 0
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    lines = files["points.csv"].splitlines(keepends=True)
    early = [line for line in lines[1:] if int(line.split(b",")[0]) < 200]
    files["points.csv"] = b"".join([lines[0], *early])
    app = go(drop(dashboard("data"), {"recording.zip": zipped(files)}), "data")
    assert "The cameras were started by hand" in [str(each.value) for each in app.subheader]
    assert any("one frame off" in str(each.value) for each in app.markdown)
    recording = ProjectRecording(project_of(app, home)).read()
    assert recording is not None
    assert recording.start_frames == {"1": 0, "2": 41, "3": -118}
    app.toggle(key="show_offsets").set_value(True).run()
    assert not app.exception
