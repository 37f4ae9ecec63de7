"""What is this file? And files given together: the usable ones are taken, the others named."""

import numpy as np
import pytest

from stereocal.formats.camera_file import write_camera, write_opencv_camera
from stereocal.formats.dropped import Dropped, sort_files
from stereocal.formats.recognition import recognise
from stereocal.frames.which_camera import which_camera
from tests.files import encoded, zipped
from tests.pages.test_pages import FIELD
from tests.photographs.lens import SMALL

GREY = np.full((60, 80), 110, np.uint8)
FTYP = b"\0\0\0\x18ftyp"
SUFFIXES = (".png", ".JPG", ".tif", ".bmp", ".pgm")
WAND = b"\n".join(b"1.5,2.5,3.5,4.5,5.5,6.5,7.5,8.5" for _ in range(4))


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        *((f"a{suffix}", encoded(GREY, suffix), "photograph") for suffix in SUFFIXES),
        ("named like a table.csv", encoded(GREY, ".png"), "photograph"),
        ("without an ending", encoded(GREY, ".jpg"), "photograph"),
        ("cut off.png", b"no photograph", "photograph"),  # its reader says what is wrong
        ("a.MP4", FTYP + b"isom", "video"),
        ("a.mov", FTYP + b"qt  ", "video"),
        ("a.avi", b"RIFF\0\0\0\0AVI LIST", "video"),
        ("a.mkv", b"\x1aE\xdf\xa3", "video"),
        ("a.zip", zipped({"x": b"x"}), "zip"),
        ("primary.json", write_camera(SMALL), "camera"),
        ("a.yml", write_opencv_camera(SMALL), "camera"),
        ("damaged.yaml", b"a: [", "camera"),
        ("dataset.json", b'{"format": "stereocal-dataset/1"}', "data set"),
        ("rig.json", b'{"format": "stereocal-rig/1"}', "rig"),
        ("points.csv", (FIELD / "correspondences.csv").read_bytes(), "table"),
        ("wand", WAND, "table"),
        ("wand.dat", WAND.replace(b",", b"\t"), "table"),
        ("photo.heic", FTYP + b"heic", None),
        ("IMG_1.CR2", b"II*\0raw", None),
        ("a.webp", b"RIFF\0\0\0\0WEBP", None),
        ("report.pdf", b"%PDF-1.7", None),
        ("table.xlsx", zipped({"[Content_Types].xml": b""}), None),
        ("plan.json", b'{"format": "stereocal-plan/1"}', None),
        ("notes.md", b"bring the bar", None),
        ("Calib.qca.txt", b"<?xml version='1.0'?>\n<calibration a='1'>\n<camera c='3'/>", None),
        ("table.csv", b"<html><body>a,b\n1,2\n</body></html>", None),
        ("empty.png", b"", None),
    ],
)
def test_content_first_ending_second(name: str, content: bytes, kind: str | None) -> None:
    found = recognise(name, content)
    assert found.kind == kind
    assert (found.problem == "") == (kind is not None)


def sort(files: dict[str, bytes]) -> Dropped[bytes]:
    return sort_files(files.items(), lambda _, content: content)


def test_the_rest_is_taken_and_each_other_file_is_named() -> None:
    good = encoded(GREY)
    inside = {"field/left/2.png": good, "field/left/10.png": b"cut", "__MACOSX/field/._2.png": b"x"}
    given = sort(
        {
            "Left 1.PNG": good,
            "cut.png": good[:40],
            "IMG.heic": FTYP + b"heic",
            ".DS_Store": b"x",
            "primary.json": write_camera(SMALL),
            "day.zip": zipped({**inside, "field/again.zip": zipped({"x": b"x"})}),
            "flat right.zip": zipped({"1.png": good}),
        }
    )
    # A flat zip is a folder: its name may tell the camera.
    assert {*given.photographs} == {"Left 1.PNG", "field/left/2.png", "flat right/1.png"}
    assert given.of("camera").keys() == {"primary.json"}
    assert given.in_words == "3 photographs, 1 camera file"
    named = ("cut.png", "IMG.heic", "field/left/10.png", "field/again.zip")
    assert len(given.problems) == len(named)
    assert all(any(name in each for each in given.problems) for name in named)


def test_files_of_both_cameras_with_the_same_names() -> None:
    """As an uploader gives those of two folders; a file that is given twice is one file."""
    one, other = (encoded(GREY + k, ".png") for k in (0, 1))
    files = [("IMG_1.png", one), ("lens.json", b"{}"), ("IMG_1.png", other), ("IMG_1.png", one)]
    found = sort_files(files, lambda _, content: content)
    assert found.photographs == {"IMG_1.png": one, "other/IMG_1.png": other}
    open_series = [series.names for series in which_camera(found.photographs).open]
    assert open_series == [("IMG_1.png",), ("other/IMG_1.png",)]


def test_a_photograph_of_another_size_is_named_with_what_to_do() -> None:
    files = {f"{side}{n}.png": encoded(GREY) for side in ("left", "right") for n in range(4)}
    files["left2.png"], files["right3.png"] = encoded(GREY.T), encoded(GREY[:50])
    turned, small = sort(files).problems
    assert "left2.png: it has 60x80 px" in turned and "without being turned" in turned
    assert "right3.png: it has 80x50 px" in small and "the others" in small
    # Cameras may differ.
    files = {f"left{n}.png": encoded(GREY) for n in range(4)}
    files |= {f"right{n}.png": encoded(GREY.T) for n in range(4)}
    assert not sort(files).problems
