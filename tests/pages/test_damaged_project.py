"""A damaged file costs itself alone: every page opens, and says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.review import read_review
from tests.pages.damage import DAMAGES, SHOWN_BY, files_of_full, look_after
from tests.pages.stored_projects import FULL, go, placed, session, told

SAID = {
    "project.json": ("data", "project's file|no project at this address"),
    "calibration.json": ("calibrate", "calibrate again"),
    "photographs/photographs.json": ("data", "remove all photographs, and give them again"),
    "photographs/frames.json": ("data", "find them again|find the targets again"),
    "lens/primary/photographs.json": ("cameras", "remove them, and give them again"),
    "lens/primary/boards.npz": ("cameras", "calibrate the lens again"),
    "lens/primary/lens.npz": ("cameras", "calibrate the lens again"),
}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return tmp_path


def test_every_file_in_one_way_on_the_page_that_shows_it(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = files_of_full(home / "list")
    assert len(files) >= 20
    for at, file in enumerate(files):
        monkeypatch.setenv("STEREOCAL_HOME", str(home / f"{at}"))
        page = SHOWN_BY[file if file in SHOWN_BY else file.split("/")[0]]
        look_after(home / f"{at}", file, list(DAMAGES)[at % len(DAMAGES)], [page])


@pytest.mark.parametrize(
    ("file", "page"),
    [("photographs/photographs.json", "data"), ("lens/primary/photographs.json", "cameras")],
)
def test_a_list_that_has_gone_is_said_and_can_be_begun_anew(
    file: str, page: str, home: Path
) -> None:
    project = placed(FULL, home)
    (project.folder / file).unlink()
    app = go(session(project), page)
    assert "has gone; remove" in told(app, "error")
    app.button(key="no_photographs" if page == "data" else "no_boards_primary").click().run()
    assert not app.exception and not app.error


def test_edits_that_are_damaged_cost_the_undoing_alone(home: Path) -> None:
    project = placed(FULL, home)
    (project.folder / "photographs" / "edits.json").write_bytes(b"{")
    project.keep_settings({"frames_view": "One frame"})
    app = go(session(project), "data")
    assert "they cannot be undone" in told(app, "warning")
    app.button(key="review_leave").click().run()
    assert not read_review(ProjectPhotographs(project)).frame(1).use
    assert "cannot be undone" not in told(app, "warning")
    app.button(key="review_undo").click().run()
    assert read_review(ProjectPhotographs(project)).frame(1).use and not app.exception


@pytest.mark.parametrize("file", SAID)
def test_what_to_do_is_said_and_the_rest_works(file: str, home: Path) -> None:
    page, words = SAID[file]
    said = look_after(home, file, "cut in half", ["data", "cameras", "calibrate", "validate"])
    red, _ = said[page]
    assert any(word in red for word in words.split("|")), red
    if file != "project.json":
        others = [red for name, (red, _) in said.items() if name != page]
        assert not any("damaged" in red or "cannot be read" in red for red in others), others
        assert page == "data" or "Complete: " in said["data"][1]
