"""`intrinsics` and `detect` of photographs of two cameras: in two folders, or in one photograph."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.cli import main
from stereocal.formats.camera_file import read_camera
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.system.photograph import read_photograph
from tests.files import encoded, write
from tests.photographs.board_pairs import photographs, stereo
from tests.photographs.lens import SMALL

OPENCV = Path(__file__).parents[2] / "sample_data" / "boards"
BOARD = ["--board", "8x6", "--square", "0.03", "--repeats", "6"]
WITHIN_PX = 1.5
"""Of a focal length of 905 px from 8 or 9 boards; measured: 0.27 px with nine."""
CALLED = ("left", "right")
LEFT, RIGHT = "GOPR12{:02}.png", "GOPR56{:02}.png"


@pytest.fixture(scope="module")
def taken() -> dict[str, bytes]:
    return photographs(stereo(0.3), 9, 6)


def folders(taken: Mapping[str, bytes], left: str, right: str) -> dict[str, bytes]:
    new = {"left": left, "right": right}
    sides = {name: name.removesuffix(".png")[:-2] for name in taken}
    return {new[sides[name]].format(int(name[-6:-4])): own for name, own in taken.items()}


def near_truth(camera: Camera) -> bool:
    return bool(np.abs(camera.K[[0, 1], [0, 1]] - SMALL.K[[0, 1], [0, 1]]).max() < WITHIN_PX)


def intrinsics(*arguments: object) -> int:
    return main(["intrinsics", *map(str, arguments)])


def test_two_folders_are_a_data_set_of_two(taken: dict[str, bytes], tmp_path: Path) -> None:
    write(folders(taken, f"left/{LEFT}", f"right/{RIGHT}"), tmp_path / "in")
    # As one folder, and as two, whose names tell too.
    for number, given in enumerate([["in"], ["in/left", "in/right"]]):
        out = tmp_path / f"data{number}"
        assert intrinsics(*(tmp_path / name for name in given), *BOARD, "--out", out) == 0
        found = read_recording(out).pair(*CAMERAS)
        assert len(found.correspondences.frames) == 9
        assert near_truth(found.primary) and near_truth(found.secondary)


def test_of_different_counts_or_moments_both_lenses_are_made(
    taken: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = folders(taken, f"left/{LEFT}", f"right/{RIGHT}")
    fewer = {name: own for name, own in files.items() if name != f"right/{RIGHT.format(4)}"}
    # Backwards: as many, but not of the same moments.
    turned = {n: files[f"right/{RIGHT.format(8 - int(n[-6:-4]))}"] for n in files if "right" in n}
    for number, given in enumerate([fewer, files | turned]):
        out = tmp_path / f"out{number}"
        write(given, tmp_path / f"in{number}")
        assert intrinsics(tmp_path / f"in{number}", *BOARD, "--out", out) == 0
        assert sorted(path.name for path in out.iterdir()) == ["primary.json", "secondary.json"]
        lenses = [read_camera((out / f"{which}.json").read_bytes(), which) for which in CAMERAS]
        assert all(map(near_truth, lenses))
    capsys.readouterr()


def test_a_file_holds_the_lens_of_one(
    taken: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "both.json"
    assert intrinsics(OPENCV, "--board", "9x6", "--square", "0.025", "--out", out) == 2
    said = capsys.readouterr().err
    assert not out.exists()
    for word in ("left01", "left14", "right01", "right14", "13", "--out", "--one-camera"):
        assert word in said
    write(folders(taken, "left_{:02}.png", "right_{:02}.png"), tmp_path / "in")
    assert intrinsics(tmp_path / "in", *BOARD, "--one-camera", "--out", out) == 0
    assert near_truth(read_camera(out.read_bytes(), "both"))


def test_opencvs_boards_are_of_two_lenses(tmp_path: Path) -> None:
    board = ["--board", "9x6", "--square", "0.025", "--repeats", "8"]
    assert intrinsics(OPENCV, *board, "--out", tmp_path / "both") == 0
    found = read_recording(tmp_path / "both").pair(*CAMERAS)
    # cv2.calibrateCamera of all photographs of each: 532.1 and 538.4 px.
    assert found.primary.K[0, 0] == pytest.approx(532.1, abs=1.5)
    assert found.secondary.K[0, 0] == pytest.approx(538.4, abs=2.0)


@pytest.mark.parametrize("days", [("monday", "tuesday"), ("2024-05-01", "2024-05-02")])
def test_days_of_one_camera_are_one_lens(
    taken: dict[str, bytes], days: tuple[str, str], tmp_path: Path
) -> None:
    left = [own for name, own in taken.items() if name.startswith("left")]
    files = {f"{days[k // 4]}/img_{k % 4}.png": left[k] for k in range(8)}
    write(files, tmp_path / "in")
    assert intrinsics(tmp_path / "in", *BOARD, "--out", tmp_path / "lens") == 0
    assert near_truth(read_camera((tmp_path / "lens").read_bytes(), "lens"))


@pytest.mark.parametrize("split", ["side-by-side", "top-bottom"])
def test_two_images_in_one_photograph(
    taken: dict[str, bytes], split: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    join = cv2.hconcat if split == "side-by-side" else cv2.vconcat
    images = {name: read_photograph(own, name) for name, own in taken.items()}
    joined = {f"{k}.png": join([images[f"{s}{k:02}.png"] for s in CALLED]) for k in range(9)}
    given = tmp_path / "in"
    write({name: encoded(np.asarray(image)) for name, image in joined.items()}, given)
    assert intrinsics(given, *BOARD, "--out", tmp_path / "lens.json") == 2
    assert f"--split {split}" in capsys.readouterr().err and not (tmp_path / "lens.json").exists()
    whole = ["--split", split, "--out"]
    assert intrinsics(given, *BOARD, *whole, tmp_path / "lenses") == 0
    detected = tmp_path / "detected"
    assert main(["detect", str(given), "--target", "board:8x6:0.03", *whole, str(detected)]) == 0
    for out in (tmp_path / "lenses", detected):
        found = read_recording(out).pair(*CAMERAS)
        assert found.primary.image_size == SMALL.image_size
        assert len(found.correspondences.frames) == 9
        assert near_truth(found.primary) and near_truth(found.secondary)
