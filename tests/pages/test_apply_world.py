"""The fold "World frame" of the Apply page."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.matching.application import POINTS
from stereocal.matching.reconstruction import name_of_world
from stereocal.projects.application import ProjectApplication
from stereocal.rig.geometry import Pose
from tests.field.world_tables import lines_csv, survey_csv
from tests.pages.stored_projects import project_of, told
from tests.pages.test_apply import SET_3D, with_files
from tests.rigs.worlds import Place, plumb_lines, surveyed, world_of_cameras


@pytest.fixture
def app(app: AppTest) -> AppTest:
    return with_files(app)


@pytest.fixture
def place() -> Place:
    rng = np.random.default_rng(4)
    return Place(SET_3D, SET_3D, world_of_cameras(rng), rng)


def give(app: AppTest, path: Path) -> AppTest:
    return app.file_uploader(key="upload_world").upload(path.name, path.read_bytes()).run()


def points(app: AppTest, home: Path) -> tuple[pd.DataFrame, Pose | None]:
    result = ProjectApplication(project_of(app, home)).result
    assert result is not None
    outcome, files = result
    return pd.read_csv(io.BytesIO(files[POINTS].read_bytes())), outcome.world


def test_points_in_the_frame_of_plumb_lines(
    app: AppTest, home: Path, place: Place, tmp_path: Path
) -> None:
    before, world = points(app, home)
    assert world is None and "coordinates" not in before
    (tmp_path / "plumb.csv").write_bytes(lines_csv(plumb_lines(place)))
    give(app, tmp_path / "plumb.csv")
    assert "World frame of 4 plumb lines: the vertical is known within" in told(app, "success")
    assert "Points are in the world frame." in told(app, "success")
    after, world = points(app, home)
    assert world is not None
    assert np.degrees(np.arccos(world.R[2] @ place.up)) < 0.2
    moved = world.apply(before[["x", "y", "z"]])
    np.testing.assert_allclose(after[["x", "y", "z"]], moved, atol=1e-9)
    assert (after["coordinates"] == name_of_world(world)).all()
    assert any("--world world.json" in str(code.value) for code in app.code)
    for view in ("Tables", "A known length"):
        app.segmented_control(key="apply_view").set_value(view).run()
    assert "coordinates" not in app.selectbox(key="apply_way").options
    app.selectbox(key="world_x_axis").set_value("baseline").run()
    turned = points(app, home)[1]
    assert turned is not None
    assert turned.apply(SET_3D.pose.inverse().T)[1] == pytest.approx(0, abs=1e-9)
    own = told(app, "success")
    app.number_input(key="world_sigma_px").set_value(3.0).run()
    assert told(app, "success") != own  # other bounds, by the noise as stated
    app.number_input(key="world_sigma_px").set_value(None).run()
    assert told(app, "success") == own
    app.button(key="forget_world").click().run()
    assert points(app, home)[1] is None
    assert "Points are in the world frame." not in told(app, "success")


def test_a_survey_its_residuals_and_a_mirrored_one(
    app: AppTest, home: Path, place: Place, tmp_path: Path
) -> None:
    (tmp_path / "survey.csv").write_bytes(survey_csv(surveyed(place, 6)))
    give(app, tmp_path / "survey.csv")
    assert "World frame of 6 surveyed points" in told(app, "success")
    assert "P4" in list(app.dataframe[0].value["Point"])
    app.selectbox(key="world_origin").set_value("P2").run()
    assert not app.error
    table = pd.read_csv(tmp_path / "survey.csv")
    table[["x", "y"]] = table[["y", "x"]].to_numpy()
    table.to_csv(tmp_path / "mirrored.csv", index=False)
    give(app, tmp_path / "mirrored.csv")
    assert "left-handed" in told(app, "error")
    assert "in the primary camera's frame" in told(app, "error")
    assert points(app, home)[1] is None
