"""The sample photographs on all pages, and photographs that cannot be used, without a browser."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.lens import ProjectLens
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from tests.pages import test_cameras as cameras
from tests.pages import test_photographs as data
from tests.pages.stored_projects import messages
from tests.pages.test_cameras import boards as boards
from tests.pages.test_photographs import BARS, FILES, give_cameras_and_lengths

Grey = npt.NDArray[np.uint8]


def png(image: Grey) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def jpeg(content: bytes) -> bytes:
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return bytes(cv2.imencode(".jpg", image)[1])


def huge_png() -> bytes:
    """A PNG whose header claims 60,000 x 60,000 px."""
    claimed = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    parts = [(b"IHDR", claimed), (b"IDAT", zlib.compress(b"\0" * 1000)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(part)) + kind + part + struct.pack(">I", zlib.crc32(kind + part))
        for kind, part in parts
    )


def bad_images(good: bytes) -> dict[str, tuple[bytes, str]]:
    """Files that are no usable photograph, by what is wrong with them, and what is said."""
    image = cv2.imdecode(np.frombuffer(good, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    whole = jpeg(good)
    return {
        "cut.jpg": (whole[: len(whole) // 2], "cut off"),
        "text.png": (b"frame,target\n1,A\n", "this is not a readable photograph"),
        "huge.png": (huge_png(), "60000"),
        "black.png": (png(np.zeros_like(image)), "black|no board"),
        "white.png": (png(np.full_like(image, 255)), "white|no board"),
    }


def said(app: AppTest) -> str:
    texts = [str(item.value) for kind in (app.caption, app.markdown) for item in kind]
    return (messages(app) + " " + " ".join(texts)).replace("\\", "")


def test_sample_photographs_fill_all_pages(app: AppTest, home: Path) -> None:
    app.button(key="demo_photographs").click().run()
    app.switch_page("pages/data.py").run()
    assert app.segmented_control(key="data_how").value == "Photographs"
    assert "50 photographs. 25 pairs by name" in said(app)
    assert app.number_input(key="baseline_m_value").value == 4.5
    assert not app.button(key="find_targets").disabled
    project = Project.open(home, app.session_state["project_id"])
    assert all(project.cameras)
    assert project.inputs.missing == ["the table of points"]
    assert "Still missing: the targets in the photographs (press *Find the targets*)" in said(app)
    for which in CAMERAS:
        assert len(ProjectLens(project, which).photographs) == 25
    app.switch_page("pages/cameras.py").run()
    assert "25 photographs of the primary camera are here" in said(app)
    assert app.number_input(key="board_columns").value == 18


def data_page(app: AppTest) -> AppTest:
    app.switch_page("pages/data.py").run()
    return app.segmented_control(key="data_how").set_value("Photographs").run()


def test_bad_photographs_of_the_bar_refuse_their_own_frame(app: AppTest, home: Path) -> None:
    """Each kind in a frame of its own."""
    data_page(app)
    sound = dict(FILES)
    hidden = BARS.pairs[5].secondary.copy()
    u, v = BARS.pairs[5].centres_secondary[0].astype(int)
    hidden[max(v - 45, 0) : v + 45, max(u - 45, 0) : u + 45] = 110
    expected = {}
    bad = bad_images(FILES["primary/left1.png"])
    for number, (name, (content, sentence)) in enumerate(bad.items(), start=1):
        del sound[f"primary/left{number}.png"]
        sound[f"primary/left{number}{Path(name).suffix}"] = content
        expected[number] = sentence
    sound["secondary/right6.png"] = png(np.asarray(hidden, np.uint8))
    sound["secondary/right7.png"] = png(np.zeros((200, 300), np.uint8))
    expected |= {6: "Only one target was found", 7: "it has 300x200 px"}
    data.upload_zip(app, sound)
    give_cameras_and_lengths(app)
    data.find(app, home)
    frames = data.store_of(app, home).frames
    assert frames is not None and [frame.state for frame in frames] == ["refused"] * 7
    for frame in frames:
        assert any(part in frame.reason for part in expected[frame.frame].split("|")), frame
        assert frame.reason in said(app)
    assert len(data.store_of(app, home).photographs) == 14


def cameras_page(app: AppTest) -> AppTest:
    return app.switch_page("pages/cameras.py").run()


@pytest.mark.parametrize(
    ("count", "sentence"),
    [
        (1, "The board was found in 1 photograph: at least 8 are needed"),
        (3, "The board was found in 3 photographs: at least 8 are needed"),
    ],
)
def test_too_few_boards(
    count: int, sentence: str, app: AppTest, home: Path, boards: dict[str, bytes]
) -> None:
    cameras_page(app)
    cameras.upload(app, dict(list(boards.items())[:count]))
    app.number_input(key="board_columns").set_value(8).run()
    app.number_input(key="board_rows").set_value(6).run()
    cameras.calibrate(app)
    assert sentence in said(app)
    store = cameras.store_of(app, home)
    assert len(store.photographs) == count and store.search is not None
