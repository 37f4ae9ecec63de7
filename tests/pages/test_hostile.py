"""Hostile files and addresses through the real pages: a sentence, never a traceback."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.system.guarded import Guard
from tests.deadly import ALL_ABORT
from tests.pages.hostile_walk import (
    APP,
    DOORS,
    SLOW_S,
    Door,
    begun,
    choose,
    give,
    hostile,
    tracebacks,
)
from tests.pages.stored_projects import messages


@pytest.fixture
def deadly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every decoder crashes in the child that tries it."""
    guard = Guard(ALL_ABORT)
    for module in ("intake", "apply", "check", "projects"):
        monkeypatch.setattr(f"stereocal.ui.{module}.server_guard", lambda: guard)
    yield
    guard.close()


@pytest.mark.parametrize("door", DOORS, ids=lambda door: f"{door.page}, {door.reader}")
@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.soak
def test_no_door_shows_a_traceback(number: int, door: Door, home: Path) -> None:
    """`python -m benchmarks.hostile_pages` gives more."""
    assert give(door, hostile(door.reader, number), begun(home)) == ""


@pytest.mark.parametrize(
    "address", ["", "..", "../../etc/passwd", "0" * 31, "A" * 32, "<b>", "\x00", "é", "0" * 5000]
)
def test_an_address_that_is_none(address: str, home: Path) -> None:
    assert home.is_dir()
    app = AppTest.from_file(APP, default_timeout=SLOW_S)
    app.query_params["project"] = address
    app.run()
    assert not tracebacks(app)
    assert "The address does not name a project" in messages(app)


@pytest.mark.parametrize(
    "number",
    [
        number
        for number, door in enumerate(DOORS)
        if door.reader in ("photograph, PNG", "photographs, zip", "photograph, JPEG", "Parquet")
        or door.page == "start"
    ],
)
def test_a_file_that_crashes_its_decoder(number: int, home: Path, deadly: None) -> None:
    assert deadly is None
    door, project = DOORS[number], begun(home)
    before = project.dataset
    from tests.soak.readers import readers

    app = AppTest.from_file(APP, default_timeout=SLOW_S)
    app.query_params["project"] = project.id
    app.run().switch_page(f"pages/{door.page}.py").run()
    if door.choose:
        choose(app, *door.choose)
    app.file_uploader(key=door.uploader).upload(door.name, readers()[door.reader].seeds()[0])
    app.run()
    assert not tracebacks(app)
    assert "makes its decoder fail" in messages(app)
    after = project.dataset
    assert before is not None and after is not None and after.sha256 == before.sha256


@pytest.mark.parametrize(
    ("variable", "sentence"),
    [("MOST_FILE_MB", "at most 1 MB are read"), ("MOST_FILES", "2 files at once are too many")],
)
def test_limits_hold_on_the_pages(
    variable: str, sentence: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"STEREOCAL_{variable}", "1")
    app = AppTest.from_file(APP, default_timeout=SLOW_S)
    app.query_params["project"] = begun(home).id
    app.run().switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("Photographs").run()
    widget = app.file_uploader(key="upload_photographs_0")
    for name in ("left1.png", "right1.png"):
        widget.upload(name, bytes(1_200_000))
    app.run()
    assert not tracebacks(app)
    assert sentence in messages(app).replace("\\", "")
    assert f"STEREOCAL_{variable}" in messages(app).replace("\\", "")


def test_a_setting_that_is_none_is_said_on_every_page(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert home.is_dir()
    monkeypatch.setenv("STEREOCAL_MOST_RATIO", "plenty")
    app = AppTest.from_file(APP, default_timeout=SLOW_S).run()
    assert not tracebacks(app)
    assert 'STEREOCAL_MOST_RATIO is "plenty": it must be a number' in messages(app).replace(
        "\\", ""
    )
