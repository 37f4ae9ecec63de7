"""A damaged file costs itself alone: every page opens, and says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.pages.damage import DAMAGES, SHOWN_BY, files_of_full, look_after

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
