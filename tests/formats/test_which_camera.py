"""Which camera of a file is which of a table: by name first, then in their order."""

from collections.abc import Mapping

import numpy as np
import pytest

from stereocal.formats.archives.all_cameras import gather_all
from stereocal.formats.archives.archive import Archive
from stereocal.formats.archives.gather import gather
from stereocal.formats.camera_file import write_camera
from stereocal.formats.exchange.chosen_cameras import camera_indices
from stereocal.formats.exchange.exchange import import_files
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.rig.camera import Camera
from tests.archives import case, focal, kalibr_chain, wand_csv
from tests.refused import refused

WAND = case("wand", "wand.csv")
BASELINE_M = 1.21758
"""Of the two cameras of most cases; their focal lengths are 1500 and 1510 px."""


def read(files: Mapping[str, bytes], cameras: str = "") -> Archive:
    first, _, second = cameras.partition(",")
    return gather(files, ExchangeOptions(cameras=(first, second) if cameras else None, unit="m"))


def lens(focal_px: float, size: tuple[int, int]) -> bytes:
    centre = 0.5 * np.array([[0, 0, size[0]], [0, 0, size[1]], [0, 0, 0]])
    return write_camera(Camera(np.diag([focal_px, focal_px, 1]) + centre, np.zeros(5), size))


@pytest.mark.parametrize(
    ("wanted", "names", "expected"),
    [
        ("2,4", "2 4", [0, 1]),
        ("1,2", "2 4", [0, 1]),  # there is no camera 1: numbers
        ("0,1", "0 1 2", [0, 1]),
        ("1,2", "1 2 3", [0, 1]),
        ("3,1", "1 2 3", [2, 0]),
        ("1,2", "cam0 cam1", [0, 1]),
        ("cam2,cam1", "cam0 cam1 cam2", [2, 1]),
        ("2,0", "cam0 cam1 cam2", [2, 0]),
        ("cam_01,CAM3", "1 2 3", [0, 2]),
        ("right,left", "left right top", [1, 0]),
        ("3,2", "left right top", [2, 1]),
        ("1,2", "0 1 2", "cam1,cam2 or cam0,cam1"),
        ("1,2", "cam0 cam1 cam2", "cam1,cam2 or cam0,cam1"),
        ("1,4", "left right top", "no camera 4"),
        ("0,1", "left right", "no camera 0"),
        (f"1,{'9' * 5000}", "left right", "no camera 9"),
        ("left,up", "left right top", "no camera up"),
    ],
)
def test_by_name_first_then_by_number(wanted: str, names: str, expected: list[int] | str) -> None:
    """Where both have a meaning and the two differ, it is asked."""
    if isinstance(expected, list):
        assert camera_indices(wanted.split(","), names.split(), "f") == expected
        return
    with refused("f: ", expected):
        camera_indices(wanted.split(","), names.split(), "f")


def test_cameras_of_a_toml_file_have_its_order() -> None:
    files = WAND | case("toml_order_of_cameras", "Calib.toml")
    for cameras in ("", "1,2", "side_view,top"):
        assert focal(read(files, cameras)) == (1500.0, 1510.0)
    assert focal(read(files, "top,side_view")) == (1510.0, 1500.0)
    del files["wand.csv"]
    pose = import_files(files, "aniposelib", ExchangeOptions(unit="m")).pose
    expected = [[0.939793, 0, 0.341743], [-0.004866, 0.999899, 0.013381]]
    assert pose.R[:2] == pytest.approx(np.array(expected), abs=1e-6)
    assert pytest.approx(np.array([-1.196101, -0.046832, 0.222822]), abs=1e-6) == pose.T


def test_a_camera_has_the_name_of_its_section_and_its_own() -> None:
    text = case("toml_order_of_cameras", "Calib.toml")["Calib.toml"]
    text = text.replace(b"[side_view]", b"[cam_0]").replace(b"[top]", b"[b]")
    for cameras in ("top,side_view", "b,cam_0"):
        assert focal(read(WAND | {"Calib.toml": text}, cameras)) == (1510.0, 1500.0)


def test_a_camera_that_is_called_a_number() -> None:
    files = WAND | case("caliscope_camera_by_number", "camera_array.toml")
    for cameras in ("", "2,4", "1,2"):
        assert focal(read(files, cameras)) == (1500.0, 1510.0)
    assert focal(read(files, "4,2")) == (1510.0, 1500.0)


def test_lenses_go_to_the_points_of_the_same_name() -> None:
    files = case("table_names_other_cameras", "xypts.csv", "camera_array.toml")
    found = read(files)
    assert focal(found) == (1510.0, 1520.0)
    assert found.baseline_m == pytest.approx(2.403, abs=1e-3)
    assert "cam2 and cam3" in found.remarks[0]
    # A table without names: in their order.
    del files["xypts.csv"]
    assert focal(read(WAND | files)) == (1500.0, 1510.0)


@pytest.mark.parametrize("cameras", ["", "left,right"])
def test_lenses_whose_files_have_the_cameras_names_in_their_own(cameras: str) -> None:
    """The right camera comes first in the table."""
    table = b"frame,camera,target,x,y\n" + b"".join(
        b"%d,%s,%s,%d,%d\n" % (frame, camera, target, 300 + 9 * frame + k, 200 + 5 * frame)
        for frame in range(4)
        for camera in (b"right", b"left")
        for k, target in enumerate((b"A", b"B"))
    )
    focals = {"left": 500.0, "right": 600.0}
    files = {f"calib_{name}.json": lens(f, (640, 480)) for name, f in focals.items()}
    order = cameras.split(",") if cameras else ["right", "left"]
    found = read({"points.csv": table, **files}, cameras)
    assert focal(found) == tuple(focals[name] for name in order)


def test_files_of_single_cameras_by_their_names() -> None:
    table = case("table_names_other_cameras", "xypts.csv")
    lenses = {k: lens(1000.0 + k, (1920, 1080)) for k in (3, 2, 9)}
    named, other = ({f"{of}{k}.json": lenses[k] for k in (3, 2)} for of in ("cam", "lens"))
    assert focal(read(table | named)) == (1002.0, 1003.0)
    assert focal(read(table | other)) == (1003.0, 1002.0)
    assert focal(read(WAND | named | {"top.json": lenses[9]}, "top,cam3")) == (1009.0, 1003.0)


@pytest.mark.parametrize(
    ("named", "sizes"), [("123", [1600, 1280, 1280]), ("210", [1280, 1280, 1600])]
)
def test_all_cameras_of_a_table_by_its_names(named: str, sizes: list[int]) -> None:
    """The file has cameras 0, 1 and 2; a table of cameras 1, 2 and 3 has them in their order."""
    rows = [line.split(",") for line in wand_csv().decode().splitlines()[1:]]
    columns = [range(2), range(2, 4), range(2, 4)][:: 1 if named == "123" else -1]
    rows = [[row[k + at] for at in (0, 4) for own in columns for k in own] for row in rows]
    head = [f"pt{end}_cam{k}_{axis}" for end in (1, 2) for k in named for axis in "XY"]
    files = {
        "t.csv": "\n".join(map(",".join, [head, *rows])).encode(),
        "camchain.yaml": kalibr_chain(),
    }
    found = gather_all(files, ExchangeOptions(), "x", {"B": 0.87}).recording
    assert [camera.image_size[0] for camera in found.cameras.values()] == sizes


def test_lenses_without_a_pose() -> None:
    """Caliscope writes "null" for what it has not found yet."""
    found = read(WAND | case("caliscope_null_pose", "camera_array.toml"))
    assert focal(found) == (1500.0, 1510.0)
    assert found.baseline_m is None


def test_all_points_of_an_adjustment_in_a_file() -> None:
    """Caliscope's older file has 80,000 characters of them."""
    text = case("toml_order_of_cameras", "Calib.toml")["Calib.toml"].decode()
    points = ", ".join(["[0.300000, nan]", "[12.5, -3e-7]"] * 20_000)
    text += f"[point_estimates]\ncamera_indices = [{'0, ' * 9000}]\nimg = [{points}]\n"
    found = read(WAND | {"config.toml": text.encode()})
    assert focal(found) == (1500.0, 1510.0)
    assert found.baseline_m == pytest.approx(BASELINE_M, abs=1e-5)


def test_a_camera_profile_of_argus() -> None:
    files = case("argus_camera_profile", "wand-clicker_profile.txt", "cameras.csv")
    found = read(WAND | {"p.txt": files["wand-clicker_profile.txt"]})
    assert focal(found) == (1500.0, 1510.0)
    assert (camera := found.secondary) is not None
    assert camera.distortion.tolist() == [-0.1, 0.05, 0.0005, -0.0004, 0.0]
    assert (camera.K[:2, 2].tolist(), camera.image_size) == ([966.5, 534.5], (1920, 1080))
    assert focal(read(WAND | {"p.txt": files["wand-clicker_profile.txt"]}, "2,1")) == (1510, 1500)
    assert focal(read(WAND | {"cameras.csv": files["cameras.csv"]})) == (1500.0, 1500.0)
