"""Hostile files through the real pages: no page may show a traceback, whatever they hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from random import Random

from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset
from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.hostile_projects import dataset
from tests.soak.mutations import from_nothing, mutated
from tests.soak.readers import readers

APP = str(Path(__file__).parents[2] / "app.py")
SLOW_S = 120
PAGES = [f"pages/{name}.py" for name in TITLES]


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
    Door(
        "apply",
        "upload_points_primary",
        "points, deeplabcut",
        "a.csv",
        ("apply_points", "Two point files"),
    ),
    Door(
        "apply",
        "upload_points_secondary",
        "Parquet",
        "b.parquet",
        ("apply_points", "Two point files"),
    ),
    Door(
        "apply",
        "upload_points_primary",
        "points, trackmate",
        "c.csv",
        ("apply_points", "Two point files"),
    ),
    Door("apply", "upload_set_matching", "parameters", "p.json"),
    Door("check", "upload_check_parameters", "parameters", "p.json"),
    Door("check", "upload_check_images", "data set, zip", "new.zip"),
    Door("check", "upload_check_images", "correspondences.csv", "new.csv"),
    Door("check", "upload_check_images", "Parquet", "pairs.parquet"),
    Door("start", "upload_project", "project, zip", "p.zip"),
)


def hostile(reader: str, number: int) -> bytes:
    """A file for a reader; mostly one that was sound."""
    random, known = Random(f"page/{reader}/{number}"), readers()[reader]
    if random.random() < 0.1:
        return from_nothing(known.kind, random)
    sound = known.seeds()
    return mutated(known.kind, random, random.choice(sound), random.choice(sound))


def begun(home: Path) -> Project:
    """A complete small project."""
    files, own = pack_dataset(dataset()), dataset()
    project = Project.create(home)
    project.give(
        {
            "correspondences": ("points.csv", files["correspondences.csv"]),
            "primary": ("primary.json", files["primary.json"]),
            "secondary": ("secondary.json", files["secondary.json"]),
        },
        baseline_m=own.baseline_m,
        target_distance_m=own.target_distance_m,
    )
    return project


def give(door: Door, content: bytes, project: Project) -> str:
    """Upload a file; the tracebacks that a page shows then, or nothing."""
    app = AppTest.from_file(APP, default_timeout=SLOW_S)
    app.query_params["project"] = project.id
    app.run().switch_page(f"pages/{door.page}.py").run()
    if door.choose:
        choose(app, *door.choose)
    app.file_uploader(key=door.uploader).upload(door.name, content)
    app.run()
    shown = tracebacks(app)
    if door.page == "start":
        for page in PAGES:
            app.switch_page(page).run()
            shown += tracebacks(app)
    return shown


def choose(app: AppTest, key: str, value: str) -> None:
    """Choose what a page takes, by a menu or by buttons."""
    menu = app.selectbox if key == "apply_points" else app.segmented_control
    menu(key=key).set_value(value).run()


def tracebacks(app: AppTest) -> str:
    """What a page shows of exceptions."""
    return "".join(f"{each.message}\n{each.stack_trace}" for each in app.exception)
