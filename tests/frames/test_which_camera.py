"""Which camera files belong to: told by folders and names, else asked about once."""

import pytest

from stereocal.frames.which_camera import numbered_cameras, which_camera, which_of
from tests.frames.test_pairing import STYLES

IMG = [f"IMG_{number}.jpg" for number in range(1001, 1026)]
DSC = [f"DSC_{number:04}.JPG" for number in range(231, 256)]
PLACED = {f"primary/{name}": "primary" for name in IMG}
PLACED |= {f"secondary/{name}": "secondary" for name in DSC}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        *STYLES.values(),
        ("frame{n}_0.png", "frame{n}_1.png"),
        ("Bar at noon {n} 1.png", "Bar at noon {n} 2.png"),
        ("Left Camera {n}.JPG", "Right Camera {n}.JPG"),
        ("A/DSC {n}.png", "B/IMG {n}.png"),
    ],
)
def test_folders_and_names_tell(first: str, second: str) -> None:
    numbers = (2, 10, 31)
    names = {first.format(n=n): "primary" for n in numbers}
    names |= {second.format(n=n): "secondary" for n in numbers}
    sides = which_camera(names)
    assert {**sides.known} == names and not sides.open


@pytest.mark.parametrize(
    ("names", "series"),
    [
        (IMG + DSC, ["DSC_0231 to DSC_0255 (25)", "IMG_1001 to IMG_1025 (25)"]),
        (IMG, ["IMG_1001 to IMG_1025 (25)"]),
        # A counter that jumps: the second camera is of the same make.
        ([*IMG, *(f"IMG_{n}.jpg" for n in range(4310, 4335))], ["IMG_1001", "IMG_4310"]),
        # The names of a folder that holds both cameras name a place.
        ([f"right wing/{name}" for name in IMG + DSC], ["DSC_0231", "IMG_1001"]),
        ([f"img_{n}.png" for n in range(25)], ["img_0 to img_24 (25)"]),
        ([*IMG, *DSC, "cover.jpg"], ["DSC_0231", "IMG_1001"]),
    ],
)
def test_what_names_do_not_tell_is_one_question(names: list[str], series: list[str]) -> None:
    sides = which_camera(names)
    assert not sides.known and len(sides.open) == len(series)
    assert all(str(own).startswith(start) for own, start in zip(sides.open, series, strict=True))
    asked = {name for own in sides.open for name in own.names}
    assert {*names} - asked == {*names} & {"cover.jpg"}


@pytest.mark.parametrize(
    ("name", "known", "camera"),
    [
        ("left.json", {}, "primary"),
        ("cam2.yaml", {"cam1.yaml": "primary"}, "secondary"),
        ("cam2.yaml", {"cam1.yaml": "secondary"}, None),
        ("cam2.yaml", {}, None),
        ("DSC.json", PLACED, "secondary"),
        ("DSC_0300.jpg", {n: s for n, s in PLACED.items() if s == "primary"}, "secondary"),
        # Of the same make as those that are known: it may be either camera's.
        ("IMG_0300.jpg", {n: s for n, s in PLACED.items() if s == "primary"}, None),
        ("nikon.json", PLACED, None),
    ],
)
def test_files_that_go_with_others(name: str, known: dict[str, str], camera: str | None) -> None:
    assert which_camera([name], known, one_by_one=True).known.get(name) == camera  # type: ignore[arg-type]


def test_any_number_of_named_cameras() -> None:
    names = {
        "left07.png": "left",
        "day/Mid/1.png": "mid",
        "cam1_7.png": "1",
        "camera_2/3.png": "2",
        "1/5.png": "1",
        "leftover.png": None,
        "07.png": None,
    }
    found = which_of(names, ["left", "mid", "1", "2"])
    assert found == {name: camera for name, camera in names.items() if camera}


def test_photographs_of_four_cameras_are_not_taken_for_those_of_two() -> None:
    names = [f"int_cam0{c}_img/cam0{c}_0{n}_int.jpg" for c in (1, 2, 3, 4) for n in range(1, 8)]
    assert [*numbered_cameras(names)] == ["cam01", "cam02", "cam03", "cam04"]
    folders = [f"GoPro {c}/IMG_{n}.jpg" for c in (1, 2, 3) for n in range(5)]
    assert {len(own) for own in numbered_cameras(folders).values()} == {5}
    assert not numbered_cameras([f"cam_{n:04}.jpg" for n in range(25)])  # one camera's frames
    assert not numbered_cameras(names[:14]) and not numbered_cameras([*names, "field.jpg"])
