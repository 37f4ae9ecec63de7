"""Tables with columns of any name: asked about on Data as on Apply, once for each header."""

from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.application import ProjectApplication
from stereocal.projects.given import ProjectGiven
from tests.formats.test_column_roles import ROWS, TABLES, UNKNOWN
from tests.pages.stored_projects import drop, go, project_of, told
from tests.pages.test_apply import begun


def give(app: AppTest, content: bytes, name: str = "t.csv") -> AppTest:
    return drop(go(app, "data"), {name: content})


def rows_of(app: AppTest, home: Path) -> int:
    table = project_of(app, home).table
    return 0 if table is None else table[1].count(b"\n") - 1


NUMBERED = TABLES["long"].replace(b";left;", b";2;").replace(b";right;", b";1;")
"""Each camera is called by the number of the other."""


@pytest.mark.parametrize("name", ["spreadsheet", "wide", "long", "numbered"])
def test_a_table_is_shown_and_taken_by_one_press(name: str, app: AppTest, home: Path) -> None:
    give(app, {**TABLES, "numbered": NUMBERED}[name])
    assert not app.error
    shown = app.dataframe[0].value
    assert shown.index[0] == "Read as" and len(shown) > 2
    assert "Nothing is loaded" not in told(app, "info")
    assert not [name for name in app.table[0].value.columns if "_" in name]  # names in files
    app.button(key="use_bars").click().run()
    assert rows_of(app, home) == len(ROWS)


def test_what_the_header_does_not_say_is_asked(app: AppTest, home: Path) -> None:
    give(app, UNKNOWN)
    assert "Choose the columns with x and y" in told(app, "info")
    assert not [button for button in app.button if button.key == "use_bars"]
    for k, role in enumerate(("frame", "camera", "target", "x", "y")):
        app.selectbox(key=f"wizard_bars_role_{k}").set_value(role).run()
    app.button(key="use_bars").click().run()
    assert rows_of(app, home) == len(ROWS)


def test_what_is_no_table_is_said_and_a_bad_cell_is_named(app: AppTest, home: Path) -> None:
    give(app, b"\x00\x01")
    assert "t.csv" in told(app)
    bad = TABLES["long"].replace(b"left;A;", b"left;A;x", 1)
    give(app, bad, "bad.csv")
    assert "bad.csv" in told(app, "error") and "line 2: column 4 (x)" in told(app, "error")
    assert rows_of(app, home) == 0


def test_all_of_three_cameras(app: AppTest, home: Path) -> None:
    own = TABLES["long"].decode().splitlines()
    third = [line.replace(";left;", ";top;") for line in own if ";left;" in line]
    give(app, "\n".join([*own, *third]).encode())
    app.button(key="use_all_cameras").click().run()
    (part,) = ProjectGiven(project_of(app, home)).parts.values()
    assert part.read_bytes().startswith(b"frame,camera,target,u,v\n")
    assert part.read_bytes().count(b"top") == len(ROWS)


def test_apply_asks_once_for_a_header(app: AppTest, home: Path) -> None:
    """A file with both cameras, given twice: the second is read as the first, for the other."""
    begun(app)
    app.file_uploader(key="upload_points_primary").upload("p.csv", TABLES["long"]).run()
    app.button(key="use_primary").click().run()
    app.file_uploader(key="upload_points_secondary").upload("s.csv", TABLES["long"]).run()
    assert not [button for button in app.button if button.key == "use_secondary"]
    store = ProjectApplication(project_of(app, home))
    files = [store.point_file("primary"), store.point_file("secondary")]
    assert [file and file.answers and file.answers.camera for file in files] == ["left", "right"]
    assert np.ptp([file.rows for file in files if file]) == 0
