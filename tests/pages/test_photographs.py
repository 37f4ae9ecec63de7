"""Photographs on the Data page, without a browser."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.camera_file import write_camera
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.camera import CAMERAS, CameraName
from tests.bar_photographs import bar_set
from tests.files import description, zipped
from tests.further import further
from tests.pages.stored_projects import (
    again,
    drop,
    go,
    messages,
    project_of,
    run_job,
    told,
    wait_until,
)

BARS = bar_set(7)
FILES = BARS.files()


@pytest.fixture
def app(app: AppTest) -> AppTest:
    return go(app, "data")


def store_of(app: AppTest, home: Path) -> ProjectPhotographs:
    return ProjectPhotographs(project_of(app, home))


def find(app: AppTest, home: Path) -> None:
    store = store_of(app, home)
    run_job(app, "find_targets", store.project, "photographs")
    assert store.frames


def cameras() -> dict[str, bytes]:
    sides: tuple[CameraName, ...] = CAMERAS
    return {f"{side}.json": write_camera(getattr(BARS.rig, side)) for side in sides}


def give_cameras_and_lengths(app: AppTest) -> None:
    drop(app, cameras())
    app.number_input(key="baseline_m_value").set_value(2.0).run()
    app.number_input(key="target_distance_m_value").set_value(0.9).run()


def wait_for_the_cancel(*given: object, earlier: object, target: object) -> None:
    """In place of the search."""
    assert earlier is not None and target is not None
    progress = given[-1]
    assert callable(progress)
    wait_until(partial(progress, 0, 1))


def test_from_photographs_to_a_complete_data_set_which_a_cancelled_search_leaves(
    app: AppTest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drop(app, {"bars.zip": zipped(FILES)})
    assert '14 photographs. 7 pairs by name: "primary with left" marks the primary' in messages(app)
    assert app.button(key="find_targets").disabled
    assert "Give the camera file of the primary and the secondary camera" in messages(app)
    give_cameras_and_lengths(app)
    assert "Still missing: the targets in the photographs" in messages(app)
    find(app, tmp_path)
    assert "7 frames: 7 found, 0 doubtful, 0 refused" in messages(app)
    assert "14 pairs of points in 7 frames" in messages(app)
    dataset = store_of(app, tmp_path).project.dataset
    assert dataset is not None
    rows = dataset.correspondences
    for pair in BARS.pairs:
        found = rows.primary[rows.frame == pair.frame]
        away = np.linalg.norm(found[:, None] - pair.centres_primary[None], axis=2).min(axis=1)
        assert away.max() < 0.1
    assert rows.has_sigmas and (rows.source == 0).all()

    before = store_of(app, tmp_path).frames
    monkeypatch.setattr("stereocal.ui.photographs.detect_frames", wait_for_the_cancel)
    app.button(key="find_targets").click().run()
    assert app.button(key="find_targets").disabled
    assert app.checkbox(key="use_frame_1").disabled
    run_job(app, "cancel_photographs", store_of(app, tmp_path).project, "photographs")
    assert "Cancelled. What was found before is unchanged" in messages(app)
    assert store_of(app, tmp_path).frames == before
    assert not app.button(key="find_targets").disabled

    app.checkbox(key="use_frame_2").set_value(False).run()
    assert "12 pairs of points in 6 frames" in messages(app)
    tab = again(app, "data")
    assert "12 pairs of points in 6 frames" in messages(tab)
    assert tab.checkbox(key="use_frame_2").value is False


def dataset_files() -> dict[str, bytes]:
    files = {f"rig/{name}": content for name, content in FILES.items()}
    for slot in ("primary", "secondary"):
        files[f"rig/{slot}.json"] = write_camera(getattr(BARS.rig, slot))
    return files | {"rig/dataset.json": description("field day", 2.0, 0.9)}


@pytest.mark.parametrize("packed", [True, *further(False)])
def test_a_data_set_of_photographs(packed: bool, app: AppTest, tmp_path: Path) -> None:
    photograph = FILES["primary/left1.png"]
    drop(app, {"left77.png": photograph, "right77.png": photograph})
    files = dataset_files()
    drop(app, {"field.zip": zipped(files)} if packed else files)
    assert "14 photographs. 7 pairs by name" in messages(app)
    assert "Still missing: the targets in the photographs" in messages(app)
    project = store_of(app, tmp_path).project
    assert project.inputs.name == "field day" and project.inputs.baseline_m == 2.0


def of_camera(side: str, name: str) -> dict[str, bytes]:
    """The photographs of one camera, as it numbers them."""
    own = [content for each, content in FILES.items() if each.startswith(side)]
    return {f"{name}_{number}.png": content for number, content in enumerate(own, 1001)}


def press(app: AppTest, label: str) -> AppTest:
    (button,) = (button for button in app.button if button.label.replace("\\", "") == label)
    return button.click().run()


def test_photographs_named_by_the_cameras_are_asked_about_once(app: AppTest, home: Path) -> None:
    drop(app, {**of_camera("primary", "IMG"), **of_camera("secondary", "DSC"), "notes.md": b"x"})
    assert "Recognised: 14 photographs" in messages(app) and "notes.md: " in messages(app)
    assert "In use: 14 photographs" in told(app, "caption")
    press(app, "IMG_1001 to IMG_1007 (7)")
    assert "In use: 7 + 7 photographs" in told(app, "caption")
    store = store_of(app, home)
    assert {name[:12] for name in store.photographs} == {"primary/IMG_", "secondary/DS"}
    # What goes with them is not asked about any more.
    lenses = cameras()
    drop(app, {"DSC.json": lenses["secondary.json"], "IMG.json": lenses["primary.json"]})
    assert store.project.inputs.labels == {"primary": "IMG.json", "secondary": "DSC.json"}
    drop(app, {"IMG_1099.png": FILES["primary/left1.png"] + b"another"})
    assert "primary/IMG_1099.png" in store.photographs


def test_one_camera_after_the_other_with_the_same_names(app: AppTest, home: Path) -> None:
    for side in CAMERAS:
        drop(app, of_camera(side, "IMG"))
        assert "Which camera took IMG_1001 to IMG_1007 (7)?" in told(app, "markdown")
        press(app, f"The {side} camera")
        assert "Which camera" not in told(app, "markdown")
    assert "14 photographs. 7 pairs by name" in messages(app)
    # Those that are there already are no others.
    drop(app, of_camera("secondary", "IMG"))
    assert len(store_of(app, home).photographs) == 14
    assert "Which camera" not in told(app, "markdown")


def test_both_lots_before_the_question_is_answered(app: AppTest) -> None:
    for side in CAMERAS:
        drop(app, of_camera(side, "IMG"))
    assert "14 photographs. 7 pairs by name" in messages(app)


def test_camera_files_whose_names_do_not_tell(app: AppTest, home: Path) -> None:
    lenses = [*cameras().values()]
    drop(app, {"hero7.json": lenses[0], "hero8.json": lenses[1]})
    press(app, "hero8.json")
    project = store_of(app, home).project
    assert project.inputs.labels == {"primary": "hero8.json", "secondary": "hero7.json"}
    drop(app, {"hero9.json": lenses[0]})
    press(app, "A third camera")
    assert {*ProjectGiven(project).rig_cameras} == {"hero7", "hero8", "hero9"}
    assert not app.exception and not project.inputs.files
