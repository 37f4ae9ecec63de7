"""Photographs on the Data page, and what is held: bars, balls, tags, boards, other objects."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.detection.target import BAR, Balls, Tags
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.camera_file import write_camera
from stereocal.formats.dataset_files import pack_dataset, parse_recording
from stereocal.library.calibrations import calibrate
from stereocal.projects.given import ProjectGiven
from stereocal.projects.home import title_of
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph import photograph_size, read_photograph
from stereocal.ui import jobs
from stereocal.ui.holding import held_target
from tests.files import description, encoded, zipped
from tests.further import further
from tests.pages.stored_projects import (
    FEW,
    again,
    drop,
    ended,
    go,
    messages,
    page_of,
    project_of,
    run_job,
    told,
    wait_until,
)
from tests.pages.test_pages import give_zip
from tests.photographs.ball_bars import CAMERA, COLOURS, ball_bars
from tests.photographs.bars import bar_set
from tests.photographs.board_pairs import photographs, stereo
from tests.photographs.lens import SMALL
from tests.rigs.objects import BOARD, recorded
from tools.photographs.videos import write_video

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
    return dict(BARS.cameras.values())


def give_cameras_and_lengths(app: AppTest) -> None:
    drop(app, cameras())
    app.number_input(key="baseline_m_value").set_value(2.0).run()
    app.number_input(key="target_distance_m_value").set_value(0.9).run()


def wait_for_the_cancel(*given: object) -> None:
    """In place of the search."""
    target, *_, progress, earlier = given[3:]
    assert earlier is not None and target is not None
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
    monkeypatch.setattr("stereocal.intrinsics.photograph_search.detect_frames", wait_for_the_cancel)
    monkeypatch.setattr(jobs, "WAIT_S", 0.0)
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
    files |= {f"rig/{name}": content for name, content in cameras().items()}
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
    assert "Recognised: " not in messages(app) and "notes.md: " in messages(app)
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


def test_from_photographs_to_a_data_set(app: AppTest, home: Path) -> None:
    rig = stereo(np.pi / 2)
    files = photographs(rig, 9, 6)
    blank = np.full((SMALL.image_size[1], SMALL.image_size[0]), 110, np.uint8)
    files |= {f"{side}99.png": encoded(blank) for side in ("left", "right")}
    drop(app, files)
    project = project_of(app, home)
    # As the first photographs show, without a click, and said with their picture.
    assert "a chessboard with 8x6 inner corners" in told(app, "markdown")
    assert app.segmented_control(key="held").value == "board"
    sizes = [app.number_input(key=f"board_{way}").value for way in ("columns", "rows")]
    assert sizes == [8, 6]
    # All lengths follow from the squares: none is assumed.
    assert app.button(key="find_boards").disabled
    app.number_input(key="board_square_mm").set_value(30.0).run()
    run_job(app, "find_boards", project, "photographs")
    assert "9 boards of 8x6 inner corners are in photographs of both" in messages(app)
    assert project.settings["held"] == "board"
    assert "Find the boards" not in told(app, "warning")
    assert not [each for each in app.button if each.key in ("held_yes", "held_bar")]
    assert not app.exception
    badges = [item.value for item in app.markdown if "badge" in item.value]
    assert len(badges) == 10 and "refused" in badges[0] and "Frame 99" in badges[0]
    dataset = project.dataset
    assert dataset is not None
    assert dataset.baseline_is_free
    # Upside down or not: to 2 % (measured: 0.2 %), from boards of 0.21 m.
    assert dataset.baseline_m == pytest.approx(rig.baseline, rel=0.02)
    assert {project.inputs.labels[which] for which in CAMERAS} == {"lens from the boards"}
    assert title_of(project).startswith("20 photographs of a board")
    back = pair_to_calibrate(parse_recording(pack_dataset(dataset), "x"))
    assert back.sha256 == dataset.sha256
    # The bar's own controls are gone, and nothing is missing.
    assert not [item for item in app.number_input if item.key == "target_distance_m_value"]
    assert "Complete" in messages(app)
    assert any("a board of" in item.value for item in app.markdown)
    assert "Changed since" not in messages(app)
    app.number_input(key="board_square_mm").set_value(60.0).run()
    assert "Changed since this result: what you hold." in messages(app)
    # Once more, with lenses that are made again: all lengths are twice as large.
    run_job(app, "find_boards", project, "photographs")
    again = project.dataset
    assert again is not None
    assert again.baseline_m == pytest.approx(2 * dataset.baseline_m, rel=1e-6)


def test_pages_of_an_object(app: AppTest, home: Path) -> None:
    """A board's zip of format 2 is stored as any other, to its digest, and opens on each page."""
    data = recorded(BOARD, 8)
    give_zip(app, pack_dataset(data))
    project = project_of(app, home)
    dataset = project.dataset
    assert dataset is not None and dataset.sha256 == data.sha256
    assert "Complete" in messages(app)
    project.keep_calibration(calibrate(dataset), project.inputs)
    project.keep_settings(FEW)
    for page in ("calibrate", "validate", "apply", "check", "data"):
        app.switch_page(f"pages/{page}.py").run()
        assert not app.exception, (page, [item.value for item in app.exception])
        assert not app.error, (page, [item.value for item in app.error])


@pytest.fixture
def balls(home: Path) -> Project:
    """A project with six pairs of photographs of two balls, and the lenses."""
    project = Project.create(home)
    store = ProjectPhotographs(project)
    files, _ = ball_bars(6, 7)
    store.add({name: store.keep(name, content) for name, content in files.items()})
    lens = write_camera(CAMERA)
    project.give({"primary": ("p.json", lens), "secondary": ("s.json", lens)})
    return project


def test_balls_are_stated_and_found_and_tags_are_stated(balls: Project) -> None:
    app = page_of(balls, "data")
    # Proposed with its picture; the user has not answered yet.
    assert "bar with two coloured balls" in told(app, "markdown")
    assert isinstance(held_target(balls), Balls) and "held" not in balls.settings
    app.button(key="held_yes").click().run()
    assert balls.settings["held"] == "balls" and "bar with two coloured balls" not in told(
        app, "markdown"
    )
    app.text_input(key="held_balls").set_value("").run()
    assert "Click ball A" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_balls").set_value("red,blurple").run()
    assert "blurple" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_balls").set_value(COLOURS.partition(":")[2]).run()
    assert "Both balls are found here" in messages(app)
    run_job(app, "find_targets", balls, "photographs")
    frames = ProjectPhotographs(balls).frames
    assert frames is not None and all(frame.use for frame in frames)
    assert isinstance(held_target(balls), Balls)
    assert "Changed since" not in messages(app)
    app.segmented_control(key="held").set_value("tags").run()
    assert "Changed since this result: what you hold" in messages(app) and not app.exception
    app.text_input(key="held_tags").set_value("4X4_50:3").run()
    assert "tags:4X4_50:3,7" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_tags").set_value("4X4_50:3,7").run()
    assert held_target(balls) == Tags("4X4_50", (3, 7))
    assert not app.button(key="find_targets").disabled and not app.exception


def test_a_bar_is_no_board_that_lies_about(app: AppTest, home: Path) -> None:
    """A chessboard lies before the primary; its photographs come first, the others later."""
    files = BARS.files()
    lying = np.kron(np.indices((5, 7)).sum(axis=0) % 2, np.ones((14, 14))) * 170 + 30
    for name in files:
        if "primary" in name:
            image = read_photograph(files[name], name).copy()
            image[350:432, 10:124] = 200
            image[356:426, 18:116] = lying
            files[name] = encoded(image)
    drop(app, {name: files[name] for name in files if "primary" in name})
    project = project_of(app, home)
    assert not [each for each in app.button if each.key == "held_yes"]
    drop(app, {name: files[name] for name in files if "secondary" in name})
    assert "bar with two 2x2 targets" in told(app, "markdown")
    assert app.segmented_control(key="held").value == "bar2x2"
    assert app.number_input(key="target_distance_m_value")
    # Whoever says that it is a board is asked once it is not found.
    app.segmented_control(key="held").set_value("board").run()
    assert not [each for each in app.button if each.key == "held_yes"]
    app.number_input(key="board_square_mm").set_value(30.0).run()
    run_job(app, "find_boards", project, "photographs")
    app.button(key="held_bar").click().run()
    assert held_target(project) == BAR and project.settings["held"] == "bar2x2"


def test_tags_are_printed_before_there_is_a_project(app: AppTest) -> None:
    app.segmented_control(key="print_what").set_value("tags").run()
    assert any("Print at 100 %" in item.value for item in app.markdown)
    app.number_input(key="print_tag_mm").set_value(300.0).run()
    assert "do not fit on A4" in messages(app)
    app.text_input(key="print_tags").set_value("4X4_50:3").run()
    assert "tags:4X4_50:3,7" in messages(app)


def test_photographs_and_videos_of_both_cameras_are_split(
    app: AppTest, home: Path, tmp_path: Path
) -> None:
    images = {
        name: read_photograph(own, name) for name, own in photographs(stereo(0.3), 4, 6).items()
    }
    joined = [
        np.hstack([images[f"{side}{k:02}.png"] for side in ("left", "right")]) for k in range(4)
    ]
    drop(app, {f"{k}.png": encoded(image) for k, image in enumerate(joined)})
    # Primary, secondary, both, none.
    app.button(key="whose_2").click().run()
    store = store_of(app, home)
    assert [(row.pair.primary, row.pair.secondary) for row in store.rows] == [
        (f"left/{k}.png", f"right/{k}.png") for k in range(4)
    ]
    assert np.array_equal(read_photograph(store.photographs["right/2.png"]), images["right02.png"])
    store.clear()
    pytest.importorskip("av")
    video = write_video(
        tmp_path / "a.mp4",
        range(4),
        draw=lambda k: np.asarray(joined[k], np.uint8),
        preset="ultrafast",
    )
    drop(app, {"stereo.mp4": video.read_bytes()})
    app.button(key="video_of_both").click().run()
    ended(store.project, "video")
    frames = store.photographs
    assert {name.partition("/")[0] for name in frames} == {*CAMERAS} and len(frames) == 8
    size = joined[0].shape[1] // 2, joined[0].shape[0]
    assert {photograph_size(file) for file in frames.values()} == {size}


def test_chapters_are_not_two_cameras(app: AppTest, tmp_path: Path) -> None:
    pytest.importorskip("av")
    video = write_video(tmp_path / "a.mp4", range(4), preset="ultrafast").read_bytes()
    drop(app, {"GX010123.MP4": video, "GX020123.MP4": video})
    assert "GX010123.MP4 and GX020123.MP4 are chapters" in told(app, "warning")
    assert not [each for each in app.button if str(each.key).startswith("whose_video")]
