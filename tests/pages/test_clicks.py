"""Points clicked on the page Apply, without a browser: what is shown of them, and the tables."""

import io
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.application import ProjectApplication
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.photograph import GreyImage
from stereocal.ui.apply_points import CLICKED
from tests.files import encoded
from tests.matching.test_clicks import LENGTH_M, flight
from tests.pages.stored_projects import drop, go, messages, page_of, pictured, project_of, told
from tests.pages.test_apply import SET_2D, begun, give_sets
from tests.projects.test_recording import rig_text
from tests.rigs.known_rig import PRIMARY, SECONDARY
from tools.photographs.videos import write_video

PLACE = "upload_footage"
PHOTOGRAPHS: dict[str, GreyImage] = {
    f"{side}_{frame:02}.png": np.full(camera.image_size[::-1], 90 + 5 * frame, np.uint8)
    for side, camera in (("left", PRIMARY), ("right", SECONDARY))
    for frame in (1, 2, 3)
}
RIGS = [*flight(1).every.values()]


def give_pictures(app: AppTest, files: Mapping[str, GreyImage]) -> AppTest:
    return drop(app, {name: encoded(image) for name, image in files.items()}, PLACE)


def clicking(app: AppTest, parameters: RigParameters = SET_2D) -> AppTest:
    give_sets(begun(app), parameters, parameters)
    return app.selectbox(key="apply_points").set_value(CLICKED).run()


def pictures(app: AppTest) -> str:
    """What the page says of them."""
    (found,) = (each.label for each in app.expander if each.label.startswith("Pictures: "))
    return str(found).replace("\\", "")


def test_points_lengths_and_tables_of_clicks(app: AppTest, home: Path) -> None:
    give_pictures(clicking(app), PHOTOGRAPHS)
    assert "Click point 1 in one of the pictures." in told(app)
    store = ProjectClicks(project_of(app, home))
    store.act(Act([*flight(3, 0.1).every.values()]))
    app.run().selectbox(key="clicks_track").set_value("tail").run()
    assert re.search(
        r"tail, 0\.\d+ px, below the threshold of 1\.8\d px", messages(app).replace("*", "")
    )
    found = re.search(r"tail to head, mean of 3 frames: ([\d.]+) ± ([\d.]+) m", told(app))
    assert found and abs(float(found[1]) - LENGTH_M) < 0.002 < float(found[2]) < 0.01
    app.button(key="clicks_f").click().run()
    step = re.search(r"tail, frame 1 to tail, frame 2: ([\d.]+) ±", told(app))
    assert step and abs(float(step[1]) - np.hypot(0.08, 0.05)) < 0.02
    app.button(key="clicks_all").click().run()
    assert "6 pairs in 3 frames, none of them ambiguous" in messages(app)
    assert len(app.slider) == 1  # the frames are those of the clicks, no second time of the result
    assert "6 points of 3 frames" in pictured(app)
    assert "known to 1 px until 20 pairs" in told(app, "caption")
    result = ProjectApplication(project_of(app, home)).result
    assert result is not None
    points = pd.read_csv(io.BytesIO(result[1]["points.csv"].read_bytes()))
    assert points["track"].tolist() == ["head", "tail"] * 3
    np.testing.assert_allclose(points["x"], np.repeat([-0.52, -0.44, -0.36], 2), atol=0.003)
    assert points["sigma_z"].min() > 0.005  # of 1 px, not of the targets
    app.button(key="clicks_x").click().run()
    assert "Click tail in one of the pictures." in told(app)
    app.button(key="clicks_u").click().run()
    assert len(store.clicks.every) == 12


def test_clicks_off_the_line_and_pictures_of_another_size(app: AppTest, home: Path) -> None:
    give_pictures(clicking(app), PHOTOGRAPHS)
    clicks = flight(1).every.values()
    off = [replace(each, v=each.v + 12.0 * (each.camera == "secondary")) for each in clicks]
    ProjectClicks(project_of(app, home)).act(Act(off))
    app.run().selectbox(key="clicks_track").set_value("head").run()
    assert "above the threshold of 1.87 px: not the same point" in told(app, "warning")
    app.button(key="clicks_clear").click().run()
    assert pictures(app) == "Pictures: none yet"
    give_pictures(app, {name: image[::2, ::2] for name, image in PHOTOGRAPHS.items()})
    assert "have 800x600 px, its parameters are for 1600x1200 px" in told(app, "error")
    assert len(app.slider) == 1  # other frames can be looked at


def test_videos_one_after_the_other_of_cameras_started_by_hand(
    app: AppTest, home: Path, tmp_path: Path
) -> None:
    pytest.importorskip("av")
    clicking(app, replace(SET_2D, start_frame=3))
    for name, preset in (("b.mp4", "superfast"), ("left.mp4", "ultrafast")):
        assert pictures(app) == "Pictures: none yet"
        path = write_video(tmp_path / name, [k / 25 for k in range(12)], preset=preset)
        drop(app, {name: path.read_bytes()}, PLACE)
        if name == "b.mp4":
            assert "Which camera took b.mp4?" in told(app)
            app.button(key="whose_video_1").click().run()
            assert "b.mp4 is that of the secondary camera: give the video of another" in told(app)
    assert "have 160x96 px" in told(app, "error")  # of other cameras, but read
    assert pictures(app) == "Pictures: left.mp4, b.mp4, 9 frames"
    app.number_input(key="clicks_later_secondary").set_value(5).run()
    assert pictures(app) == "Pictures: left.mp4, b.mp4, 7 frames"
    app.number_input(key="clicks_later_secondary").set_value(50).run()
    assert "no frames of the same moment" in told(app, "warning")
    # Another tab has them too, as long as the server runs.
    app = page_of(project_of(app, home), "apply")
    app.number_input(key="clicks_later_secondary").set_value(0).run()
    assert pictures(app) == "Pictures: left.mp4, b.mp4, 12 frames"


def test_one_video_for_both_cameras_and_a_damaged_one(app: AppTest, tmp_path: Path) -> None:
    pytest.importorskip("av")
    clicking(app)
    sound = write_video(tmp_path / "left.mp4", [0.0, 0.04, 0.08], preset="ultrafast").read_bytes()
    for right, told_of in ((sound, "the same video"), (b"no video", "right.mp4: ")):
        drop(app, {"left.mp4": sound, "right.mp4": right}, PLACE)
        assert told_of in told(app, "warning")
        assert pictures(app) == "Pictures: none yet"


def test_a_pair_after_a_rig_has_its_own_clicks_pictures_and_names(app: AppTest, home: Path) -> None:
    begun(app).file_uploader(key="upload_set_matching").upload("r.json", rig_text().encode()).run()
    app.selectbox(key="apply_points_of_rig").set_value(CLICKED).run()
    drop(app, {f"{name}.mp4": name.encode() for name in ("red", "green", "blue")}, PLACE)
    assert "Which camera took" in told(app)
    go(app, "data")
    assert not app.exception and "Which camera took" not in told(app)
    go(app, "apply")
    give_pictures(app, PHOTOGRAPHS)
    store = ProjectClicks(project_of(app, home))
    store.act(Act([replace(e, camera=f"{1 + (e.camera != 'primary')}") for e in RIGS]))
    app.run().button(key="forget_rig").click().run()
    give_sets(app, SET_2D, SET_2D).selectbox(key="apply_points").set_value(CLICKED).run()
    app.button(key="clicks_clear").click().run()
    unnamed = {
        name.replace("left", "x").replace("right", "y"): image
        for name, image in PHOTOGRAPHS.items()
    }
    give_pictures(app, unnamed)
    assert "Which photographs are the primary camera's?" in told(app)
    assert next(e for e in app.expander if e.label.startswith("Pictures: ")).proto.expanded
    app.button(key="whose_0").click().run()
    assert not app.exception and "Click point 1 in one of the pictures." in told(app)
    assert app.button(key="clicks_u").disabled and len(store.clicks.every) == len(RIGS)


def flown(frames: int, hidden: int) -> dict[str, GreyImage]:
    """Photographs of the flight, in which each end has a texture of its own; the secondary does not
    show those of one frame."""
    images = {}
    noise = np.random.default_rng(3).normal(0.0, 1.0, (2, 31, 31))
    textures = [cv2.GaussianBlur(each, (0, 0), 2.0) for each in noise]
    textures = [np.clip(128 + 400 * each, 0, 255).astype(np.uint8) for each in textures]
    clicks = flight(frames).every.values()
    for name, camera, own in (("left", PRIMARY, CAMERAS[0]), ("right", SECONDARY, CAMERAS[1])):
        for frame in range(1, frames + 1):
            image = np.full(camera.image_size[::-1], 90, np.uint8)
            for texture, track in zip(textures, ("head", "tail"), strict=True):
                (at,) = (e for e in clicks if e.key == (frame, own, track))
                u, v = round(at.u) - 15, round(at.v) - 15
                if not (frame == hidden and own == CAMERAS[1]):
                    image[v : v + 31, u : u + 31] = texture
            images[f"{name}_{frame:02}.png"] = image
    return images


def test_one_key_accepts_the_proposals_of_many_frames(app: AppTest, home: Path) -> None:
    give_pictures(clicking(app), flown(7, hidden=6))
    store = ProjectClicks(project_of(app, home))
    store.act(Act([*flight(1).every.values()]))
    app.run()
    assert app.button(key="clicks_g").disabled  # nothing is proposed where all is clicked
    app.button(key="clicks_f").click().run()
    app.button(key="clicks_g").click().run()
    assert "Frame 6 was not accepted. In doubt there: head and tail." in told(app, "warning")
    assert app.slider[0].value == 6 and app.button(key="clicks_g").disabled
    found = store.clicks.every
    assert {frame for frame, *_ in found} == {1, 2, 3, 4, 5}
    truth = flight(5).every
    for key, click in found.items():
        assert np.hypot(click.u - truth[key].u, click.v - truth[key].v) < 2.0
        assert click.source == ("clicked" if click.frame == 1 else "followed")
        assert click.origin == (None if click.frame == 1 else 1)
    assert len(store.acts) == 2
    app.button(key="clicks_u").click().run()  # one act, undone at once
    assert {frame for frame, *_ in store.clicks.every} == {1}
