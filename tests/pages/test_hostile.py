"""Hostile files and addresses through the real pages: a sentence, never a traceback."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.project import Project
from stereocal.ui.intake import give_dataset
from stereocal.ui.menu import TITLES
from tests.hostile_projects import dataset
from tests.pages.stored_projects import dashboard, go, messages, session
from tests.soak import repeats
from tests.soak.damage import damaged
from tests.soak.readers import readers


@dataclass(frozen=True)
class Door:
    """Where files come in: a page, what is chosen on it, the uploader, and whose files it takes."""

    page: str
    uploader: str
    reader: str
    name: str
    choose: tuple[str, str] | None = None


PHOTOGRAPHS, FILES = ("data_how", "Photographs"), ("apply_points", "Two point files")
DOORS = (
    Door("data", "upload_correspondences", "correspondences.csv", "points.csv"),
    Door("data", "upload_correspondences", "points, wand", "wand.csv"),
    Door("data", "upload_primary", "camera, ours", "primary.json"),
    Door("data", "upload_secondary", "camera, OpenCV YAML", "secondary.yml"),
    Door("data", "upload_primary", "camera, OpenCV XML", "primary.xml"),
    Door("data", "upload_primary", "archive, TOML", "rig.toml"),
    Door("data", "upload_secondary", "archive, Kalibr", "rig.yaml"),
    Door("data", "upload_zip", "data set, zip", "set.zip", ("data_how", "A zip")),
    Door("data", "upload_photographs_0", "photograph, PNG", "left1.png", PHOTOGRAPHS),
    Door("data", "upload_photographs_0", "photograph, TIFF", "a.tif", PHOTOGRAPHS),
    Door("data", "upload_photographs_0", "photographs, zip", "a.zip", PHOTOGRAPHS),
    Door("cameras", "upload_boards_primary_0", "photograph, JPEG", "1.jpg"),
    Door("validate", "upload_more", "data set, zip", "more.zip"),
    Door("apply", "upload_points_primary", "points, deeplabcut", "a.csv", FILES),
    Door("apply", "upload_points_secondary", "Parquet", "b.parquet", FILES),
    Door("apply", "upload_set_matching", "parameters", "p.json"),
    Door("check", "upload_check_parameters", "parameters", "p.json"),
    Door("check", "upload_check_images", "data set, zip", "new.zip"),
    Door("check", "upload_check_images", "correspondences.csv", "new.csv"),
    Door("check", "upload_check_images", "Parquet", "pairs.parquet"),
    Door("start", "upload_project", "project, zip", "p.zip"),
)


def begun(home: Path) -> Project:
    """A complete small project."""
    project = Project.create(home)
    give_dataset(project, pack_dataset(dataset()), "a data set")
    return project


def opened(door: Door, project: Project) -> AppTest:
    """The door's page, ready to be given a file."""
    app = go(session(project), door.page)
    if door.choose:
        choose(app, *door.choose)
    return app


def choose(app: AppTest, key: str, value: str) -> None:
    """Choose what a page takes, by a menu or by buttons."""
    menu = app.selectbox if key == "apply_points" else app.segmented_control
    menu(key=key).set_value(value).run()


def tracebacks(app: AppTest) -> str:
    """What a page shows of exceptions."""
    return "".join(f"{each.message}\n{each.stack_trace}" for each in app.exception)


@pytest.mark.parametrize("door", DOORS, ids=lambda door: f"{door.page}, {door.reader}")
@pytest.mark.soak
def test_no_door_shows_a_traceback(door: Door, home: Path) -> None:
    reader = readers()[door.reader]

    @settings(
        max_examples=repeats(2, 13),
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged(reader.kind, reader.seeds()))
    def upload(content: bytes) -> None:
        app = opened(door, begun(home))
        app.file_uploader(key=door.uploader).upload(door.name, content)
        assert tracebacks(app.run()) == ""
        for page in TITLES if door.page == "start" else ():
            assert tracebacks(app.switch_page(f"pages/{page}.py").run()) == ""

    upload()


@pytest.mark.parametrize("address", ["", "../../etc/passwd", "0" * 31, "<b>", "\x00", "0" * 5000])
def test_an_address_that_is_none(address: str, home: Path) -> None:
    assert home.is_dir()
    app = dashboard(project=address)
    assert not tracebacks(app)
    assert "The address does not name a project" in messages(app)


@pytest.mark.parametrize(
    ("variable", "sentence"),
    [("MOST_FILE_MB", "at most 1 MB are read"), ("MOST_FILES", "2 files at once are too many")],
)
@pytest.mark.parametrize(
    ("how", "key", "suffix"),
    [
        ("Photographs", "upload_photographs_0", "png"),
        ("Three cameras and more", "upload_several_0", "json"),
    ],
)
def test_limits_hold_on_the_pages(
    variable: str,
    sentence: str,
    how: str,
    key: str,
    suffix: str,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(f"STEREOCAL_{variable}", "1")
    app = go(session(begun(home)), "data")
    app.segmented_control(key="data_how").set_value(how).run()
    widget = app.file_uploader(key=key)
    for name in ("left1", "right1"):
        widget.upload(f"{name}.{suffix}", bytes(1_200_000))
    app.run()
    assert not tracebacks(app)
    assert sentence in messages(app)
    assert f"STEREOCAL_{variable}" in messages(app)


def test_a_setting_that_is_none_is_said_on_every_page(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert home.is_dir()
    monkeypatch.setenv("STEREOCAL_MOST_RATIO", "plenty")
    app = dashboard()
    assert not tracebacks(app)
    assert 'STEREOCAL_MOST_RATIO is "plenty": it must be a number' in messages(app).replace(
        "\\", ""
    )
