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
from tests.pages.stored_projects import dashboard, drop, messages, page_of
from tests.soak import repeats
from tests.soak.damage import damaged
from tests.soak.readers import readers


@dataclass(frozen=True)
class Door:
    """Where files come in: a page, its uploader, whose files it takes, and a menu's choice."""

    page: str
    uploader: str
    reader: str
    name: str
    choose: tuple[str, str] | None = None


FILES = ("apply_points", "Two point files")
DOORS = (
    Door("data", "upload_data_0", "correspondences.csv", "points.csv"),
    Door("data", "upload_data_0", "points, wand", "wand.csv"),
    Door("data", "upload_data_0", "camera, ours", "primary.json"),
    Door("data", "upload_data_0", "camera, OpenCV YAML", "secondary.yml"),
    Door("data", "upload_data_0", "camera, OpenCV XML", "primary.xml"),
    Door("data", "upload_data_0", "archive, TOML", "rig.toml"),
    Door("data", "upload_data_0", "archive, Kalibr", "rig.yaml"),
    Door("data", "upload_data_0", "data set, zip", "set.zip"),
    Door("data", "upload_data_0", "photograph, PNG", "left1.png"),
    Door("data", "upload_data_0", "photograph, TIFF", "a.tif"),
    Door("data", "upload_data_0", "photographs, zip", "a.zip"),
    Door("cameras", "upload_boards_primary_0", "photograph, JPEG", "1.jpg"),
    Door("validate", "upload_more", "data set, zip", "more.zip"),
    Door("apply", "upload_points_primary", "points, deeplabcut", "a.csv", FILES),
    Door("apply", "upload_points_secondary", "Parquet", "b.parquet", FILES),
    Door("apply", "upload_set_matching", "parameters", "p.json"),
    Door("check", "upload_check_parameters", "parameters", "p.json"),
    Door("check", "upload_check_images_0", "data set, zip", "new.zip"),
    Door("check", "upload_check_images_0", "correspondences.csv", "new.csv"),
    Door("check", "upload_check_images_0", "Parquet", "pairs.parquet"),
    Door("start", "upload_project", "project, zip", "p.zip"),
)


def begun(home: Path) -> Project:
    """A complete small project."""
    project = Project.create(home)
    give_dataset(project, pack_dataset(dataset()), "a data set")
    return project


def opened(door: Door, project: Project) -> AppTest:
    """The door's page, ready to be given a file."""
    app = page_of(project, door.page)
    if door.choose:
        key, value = door.choose
        app.selectbox(key=key).set_value(value).run()
    return app


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
def test_limits_hold_on_the_pages(
    variable: str, sentence: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"STEREOCAL_{variable}", "1")
    app = page_of(begun(home), "data")
    drop(app, {name: bytes(1_200_000) for name in ("left1.png", "right1.png")})
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
