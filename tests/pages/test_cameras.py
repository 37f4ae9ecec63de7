"""The Lenses page, without a browser."""

from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.lens import ProjectLens
from stereocal.projects.server_settings import default_home
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.photograph import read_photograph
from stereocal.ui import lens
from tests.files import encoded
from tests.pages.stored_projects import (
    again,
    dashboard,
    drop,
    ended,
    go,
    messages,
    project_of,
    run_job,
    told,
)
from tests.photographs.board_pairs import photographs, stereo
from tests.photographs.lens import SMALL, film_boards, write_boards

ROOT = Path(__file__).parents[2]
FIELD = ROOT / "sample_data" / "field"


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("boards")
    write_boards(folder, 7, seed=5)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def app(app: AppTest) -> AppTest:
    return go(app, "cameras")


def store_of(app: AppTest, home: Path, which: CameraName = "primary") -> ProjectLens:
    return ProjectLens(project_of(app, home), which)


def small_board(app: AppTest) -> AppTest:
    app.number_input(key="board_columns").set_value(8)
    app.number_input(key="board_rows").set_value(6)
    app.number_input(key="lens_subset").set_value(5)
    return app.number_input(key="lens_repeats").set_value(6).run()


def calibrate(app: AppTest, which: CameraName = "primary") -> AppTest:
    project = project_of(app, default_home())
    run_job(app, f"calibrate_{which}", project, lens.JOB_KINDS[which])
    return app


def test_photographs_to_the_projects_camera(
    app: AppTest, home: Path, boards: dict[str, bytes]
) -> None:
    drop(app, boards, "upload_boards_primary")
    assert "Of the primary camera: 7 photographs" in told(app)
    # As the photographs show.
    assert [app.number_input(key=f"board_{name}").value for name in ("columns", "rows")] == [8, 6]
    # A fisheye has no coefficients to hold.
    held, model = ("lens_fix_k3", "lens_zero_tangential"), app.segmented_control(key="lens_model")
    usual = model.value
    for chosen in ("fisheye", usual):
        app.segmented_control(key="lens_model").set_value(chosen).run()
        assert {app.toggle(key=key).disabled for key in held} == {chosen == "fisheye"}
    calibrate(small_board(app))
    assert not app.error
    assert "The focal length fx is" in messages(app)
    assert "6 draws of 5 out of 7 photographs" in messages(app)
    app.button(key="use_lens_primary").click().run()
    camera = project_of(app, home).cameras[0]
    assert camera is not None and camera.uncertainty is not None
    # Seven small photographs. Measured: 0.3 px.
    assert abs(camera.K[0, 0] - SMALL.K[0, 0]) < 3
    assert app.button(key="use_lens_primary").disabled

    app.switch_page("pages/data.py").run()
    assert any("lens from 7 board photographs" in item.value for item in app.caption)

    tab = again(app, "cameras")
    assert "6 draws of 5 out of 7 photographs" in messages(tab)
    assert tab.number_input(key="board_columns").value == 8


def test_a_video_to_a_lens(app: AppTest, home: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    video = film_boards(tmp_path / "board.mp4", 8, seed=5).read_bytes()
    kind, place = lens.JOB_KINDS["primary"], "upload_boards_primary"

    damaged = {"board.mp4": video[: len(video) // 2]}
    drop(app, damaged, place)
    ended(project_of(app, home), kind)
    (error,) = app.run().error
    assert error.value.startswith("board.mp4") and "damaged" in error.value
    assert not store_of(app, home).photographs

    drop(app, {"a.mp4": video, "b.mp4": video}, place)
    assert "one at a time" in told(app) and not store_of(app, home).photographs

    drop(app, {"board.mp4": video}, place)
    ended(project_of(app, home), kind)
    app.run()
    assert not app.error
    assert {name.partition("/")[0] for name in store_of(app, home).photographs} == {"board"}
    assert "Of the primary camera: 8 photographs" in told(app)
    assert [app.number_input(key=f"board_{name}").value for name in ("columns", "rows")] == [8, 6]
    calibrate(small_board(app))
    assert not app.error
    found = store_of(app, home).calibration
    # Eight small frames, compressed. Measured: 0.2 px.
    assert found is not None and abs(found.camera.K[0, 0] - SMALL.K[0, 0]) < 3


def test_loaded_lenses_are_not_called_missing(pressed: AppTest) -> None:
    nothing, loaded = "Nothing to calibrate yet", "Both lenses are loaded"
    shown = messages(go(pressed, "cameras"))
    assert loaded in shown and nothing not in shown
    shown = messages(go(dashboard(), "cameras"))
    assert nothing in shown and loaded not in shown


def test_sample_photographs(app: AppTest, home: Path) -> None:
    app.button(key="sample_boards").click().run()
    for which in CAMERAS:
        assert len(store_of(app, home, which).photographs) == 22


@pytest.fixture(scope="module")
def both() -> dict[str, bytes]:
    return photographs(stereo(0.3), 7, 6)


def test_photographs_of_two_cameras_are_divided(
    app: AppTest, home: Path, both: dict[str, bytes]
) -> None:
    drop(app, both, "upload_boards_primary")
    said = told(app, "error")
    assert "left00 to left06 (7)" in said and "right00 to right06 (7)" in said
    stores = [ProjectLens(project_of(app, home), which) for which in CAMERAS]
    assert not any(store.photographs for store in stores)
    app.button(key="use_rest").click().run()
    sides = [{name[:-6] for name in store.photographs} for store in stores]
    assert sides == [{"left"}, {"right"}] and not app.error
    # Those of the other camera among them, later.
    later = {f"right{n}.png": both[f"right0{n - 7}.png"] for n in (7, 8)}
    drop(app, later, "upload_boards_primary")
    app.button(key="use_rest").click().run()
    assert {*later} < {*stores[1].photographs} and len(stores[0].photographs) == 7
    drop(app, later, "upload_boards_primary")
    app.button(key="use_other").click().run()
    assert {*later} < {*stores[0].photographs} and "board_columns" in stores[0].project.settings


def test_two_images_in_a_photograph_are_split(
    app: AppTest, home: Path, both: dict[str, bytes]
) -> None:
    images = {name: read_photograph(own, name) for name, own in both.items()}
    joined = {
        f"{k}.png": np.hstack([images[f"{side}{k:02}.png"] for side in ("left", "right")])
        for k in range(7)
    }
    drop(app, {n: encoded(image) for n, image in joined.items()}, "upload_boards_primary")
    assert "side-by-side" in told(app, "warning")
    app.button(key="split_primary").click().run()
    for which, side in zip(CAMERAS, ("left", "right"), strict=True):
        stored = ProjectLens(project_of(app, home), which).photographs
        assert len(stored) == 7
        half = read_photograph(stored[f"{side}/3.png"])
        assert np.array_equal(half, images[f"{side}03.png"])
    assert not app.warning
