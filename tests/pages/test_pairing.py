"""How photographs with ordinary names are paired on the Data page, and cameras that count for
themselves."""

import io
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from PIL import Image

from stereocal.cli import main
from stereocal.detection.detect import detect_targets
from stereocal.frames import search
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.photograph import GreyImage
from stereocal.system.taken import EXIF
from tests.files import zipped
from tests.further import of_a_whole_soak
from tests.pages.stored_projects import (
    dashboard,
    drop,
    ended,
    go,
    messages,
    page_of,
    project_of,
    run_job,
    told,
)
from tests.photographs.bars import bar_set
from tools.photographs.started_by_hand import START_S, write_sample

NAMES = ("primary/IMG_{}.png", "secondary/DSC_0{}.png")
FIRST = (1001, 231)


def png(image: GreyImage, seconds: float | None) -> bytes:
    tags = Image.Exif()
    tags[0x0110] = "One"  # Pillow writes no PNG without a tag of its own
    if seconds is not None:
        at = datetime.fromtimestamp(seconds, UTC)
        tags.get_ifd(EXIF).update({0x9003: f"{at:%Y:%m:%d %H:%M:%S}", 0x9291: f"{at:%f}"})
    packed = io.BytesIO()
    Image.fromarray(image).save(packed, "PNG", exif=tags)
    return packed.getvalue()


def stored(home: Path, frames: int, *lost: int, timed: bool) -> ProjectPhotographs:
    """A project with photographs of the bar; the secondary camera did not take some."""
    bars, store = bar_set(frames), ProjectPhotographs(Project.create(home))
    moments = 1.7e9 + np.cumsum(np.random.default_rng(1).lognormal(2.5, 0.7, frames))
    files = {}
    for camera, (pattern, first) in enumerate(zip(NAMES, FIRST, strict=True)):
        for i, pair in enumerate(bars.pairs):
            if camera == 0 or i not in lost:
                seconds = float(moments[i]) + 12.4 * camera if timed else None
                name = pattern.format(first + i)
                files[name] = store.keep(name, png((pair.primary, pair.secondary)[camera], seconds))
    store.add(files)
    store.project.keep_settings({"held": "bar2x2"})
    store.project.give(bars.cameras)
    return store


def twos(store: ProjectPhotographs) -> list[tuple[int, int]]:
    """The numbers of the moments of each pair; the primary's first."""
    return [
        (int(row.pair.primary[-8:-4]) - FIRST[0], int(row.pair.secondary[-8:-4]) - FIRST[1])
        for row in store.rows
    ]


def without(frames: int, *lost: int) -> Sequence[tuple[int, int]]:
    return [(i, i) for i in range(frames) if i not in lost]


def test_by_time_and_a_slip_in_order_is_mended_by_one_press(home: Path) -> None:
    store = stored(home, 7, 2, timed=True)
    app = page_of(store.project, "data")
    assert "6 pairs by the time taken; the clocks are 12.4 s apart" in messages(app)
    slip = "IMG_1003 has no partner: one photograph is missing in the secondary after DSC_0232"
    assert slip in messages(app)
    assert twos(store) == without(7, 2)
    app.segmented_control(key="pair_way").set_value("order").run()
    assert "6 pairs in order" in messages(app)
    assert f"The times say otherwise: {slip}" in messages(app)
    assert twos(store)[2:] == [(2, 3), (3, 4), (4, 5), (5, 6)]
    app.button(key="pair_mend").click().run()
    assert twos(store) == without(7, 2)
    assert "The times say otherwise" not in messages(app)
    app.button(key="pair_back_primary/IMG_1003.png").click().run()
    assert len(twos(store)) == 6 and twos(store) != without(7, 2)
    for _ in range(3):
        app.button(key="pair_undo").click().run()
    assert store.proposal.way == "time" and not store.can_undo_choice
    assert twos(store) == without(7, 2)
    app.button(key="pair_exchange").click().run()
    assert store.rows[0].pair.primary == "secondary/DSC_0231.png"
    app.button(key="pair_undo").click().run()
    assert twos(store) == without(7, 2)


@pytest.mark.parametrize("lost", [(5,), (2, 9)])
def test_without_times_slips_are_seen_by_the_targets(lost: tuple[int, ...], home: Path) -> None:
    store = stored(home, 16, *lost, timed=False)
    app = page_of(store.project, "data")
    pairs = 16 - len(lost)
    assert f"{pairs} pairs in order" in messages(app)
    assert not [each for each in app.button if each.key == "pair_clear"]  # they are not the same
    run_job(app, "find_targets", store.project, "photographs")
    names = " and ".join(f"IMG_{FIRST[0] + i}" for i in lost)
    assert f"The secondary camera has no photograph for {names}." in messages(app)
    assert "press *Find the targets*" not in told(app, "warning")  # they were searched for
    assert messages(app).count("No target is seen by both cameras") <= 1
    assert "lies along the epipolar lines" not in messages(app) + told(app, "caption")
    assert len(app.warning) == 1 and "frames" not in told(app, "info", "caption")
    # The press shows the frames of the right pairs, and searches those photographs that were in no
    # pair before.
    with patch.object(search, "detect_targets", wraps=detect_targets) as searched:
        app.button(key="pair_mend_found").click().run()
        ended(store.project, "photographs")
        app.run()
    assert twos(store) == without(16, *lost) and searched.call_count == len(lost)
    assert store.frames and sum(frame.use for frame in store.frames) == pairs
    assert "no photograph for" not in messages(app) and f"{pairs} are used" in messages(app)


def test_edited_pairs_return_with_the_way_before(home: Path) -> None:
    store = stored(home, 4, 3, timed=False)
    edited = [store.rows[1]]
    store.keep_rows(edited)
    app = page_of(store.project, "data")
    app.button(key="pair_exchange").click().run()
    assert len(store.rows) == 3
    app.button(key="pair_undo").click().run()
    assert store.rows == edited


def test_photographs_of_one_camera_given_for_both_are_named_and_removed(home: Path) -> None:
    store, bars = ProjectPhotographs(Project.create(home)), bar_set(6)
    images = [png(pair.primary, None) for pair in bars.pairs]
    for side in ("left", "right"):
        names = [f"{side}_{i}.png" for i in range(len(images))]
        store.add({name: store.keep(name, own) for name, own in zip(names, images, strict=True)})
    app = page_of(store.project, "data")
    assert "left_0 and right_0" in told(app, "warning")
    app.button(key="pair_clear").click().run()
    assert not store.photographs and not app.exception


def test_data_brings_them_into_step_and_says_how(home: Path, tmp_path: Path) -> None:
    assert main(["sample", "by_hand", "--out", str(tmp_path)]) == 0
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    lines = files["points.csv"].splitlines(keepends=True)
    early = [line for line in lines[1:] if int(line.split(b",")[0]) < 200]
    files["points.csv"] = b"".join([lines[0], *early])
    app = go(drop(dashboard("data"), {"recording.zip": zipped(files)}), "data")
    assert "The cameras were started by hand" in [str(each.value) for each in app.subheader]
    assert any("one frame off" in str(each.value) for each in app.markdown)
    recording = project_of(app, home).recording
    assert recording is not None
    assert recording.start_frames == {"1": 0, "2": 41, "3": -118}
    app.toggle(key="show_offsets").set_value(True).run()
    assert not app.exception


@of_a_whole_soak  # the command takes these steps in tests/frames/test_by_motion.py
def test_videos_of_cameras_started_by_hand(home: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    given = tmp_path / "given"
    write_sample(given)
    project = Project.create(home)
    project.keep_settings({"held": "balls", "held_balls": "red,yellow"})
    app = page_of(project, "data")
    drop(app, {path.name: path.read_bytes() for path in given.iterdir()})
    ended(project, "video")
    app.run()
    assert "By their sound" in told(app, "warning")
    run_job(app, "videos_by_hand", project, "video")
    assert app.segmented_control(key="video_by_hand").value is True
    assert "Until then, the first with the first" in told(app)
    app.button(key="find_targets").click().run()
    ended(project, "photographs")
    app.run()
    assert not app.exception
    assert "by the motion" in told(app) and "The sound agrees" in told(app)
    frames = ProjectPhotographs(project).frames or []
    first, second = (int(name.split("/")[1][:6]) for name in frames[5].files)
    assert abs((first - second) / 15 - START_S) < 1 / 30
    assert sum(frame.use for frame in frames) > 60
