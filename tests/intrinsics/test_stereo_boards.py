"""A board in the photographs of two cameras: order of corners, repeated and mirrored images."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.calibration.checks import warnings_about
from stereocal.cli import main
from stereocal.detection.target import parse_board, parse_target
from stereocal.fit.refine import refine
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.dataset_files import pack_recording, read_dataset, read_recording
from stereocal.frames.pairing import Pairing, pair_names
from stereocal.intrinsics.board_order import SeenBoard, _mirrored, boards_in_one_order, orders_of
from stereocal.intrinsics.boards import BoardSearch, BoardView, find_board
from stereocal.intrinsics.proposed_board import ProposedBoard, proposed_board
from stereocal.intrinsics.stereo_boards import (
    StereoBoards,
    find_stereo_boards,
    found_of,
    lenses_of_boards,
    stereo_boards,
)
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.simulation.simulate import place_bars
from stereocal.system.photograph import read_photograph
from tests.files import write
from tests.further import further
from tests.photographs.ball_bars import BAR_M, RIG
from tests.photographs.board_pairs import photographs, placings, stereo
from tests.photographs.lens import PATTERN, SMALL, AtOnce
from tests.refused import refused
from tests.rigs.fisheyes import draw_fisheye, draw_pairs
from tools.photographs.bars import BarSettings, photograph_bars
from tools.photographs.objects import charuco
from tools.photographs.rendering import PhotographSettings

BOTH = "primary", "secondary"
SQUARE, EVEN = BoardPattern(6, 6, 0.03), BoardPattern(7, 5, 0.03)


def seen(rig: Pose, count: int, pattern: BoardPattern = PATTERN, seed: int = 1) -> list[SeenBoard]:
    """Boards by projection, with the corners in the pattern's order, at 0.1 px."""
    rng = np.random.default_rng(seed)
    middle = pattern.points.mean(axis=0)

    def view(pose: Pose) -> BoardView:
        pixels = SMALL.project(pose.apply(pattern.points - middle))
        noisy = pixels + 0.1 * rng.normal(size=pixels.shape)
        return BoardView("x", SMALL.image_size, np.arange(len(noisy)), noisy)

    return [
        SeenBoard(at, (view(pose), view(rig @ pose)))
        for at, pose in enumerate(placings(rig, count, seed))
    ]


def turned_at_random(boards: list[SeenBoard], pattern: BoardPattern) -> list[SeenBoard]:
    """Each secondary board in any of the orders in which it looks the same."""
    rng, found = np.random.default_rng(0), []
    for frame, (first, second) in boards:
        order = orders_of(pattern)[rng.integers(len(orders_of(pattern)))]
        found.append(SeenBoard(frame, (first, replace(second, ids=order[second.ids]))))
    return found


@pytest.mark.parametrize("roll", [np.pi / 2, np.pi, 2.0])
@pytest.mark.parametrize("pattern", [PATTERN, SQUARE, EVEN])
def test_corners_are_in_one_order_however_cameras_hang(roll: float, pattern: BoardPattern) -> None:
    right = seen(stereo(roll), 6, pattern)
    found = boards_in_one_order(turned_at_random(right, pattern), (SMALL, SMALL), pattern)
    for own, true in zip(found, right, strict=True):
        np.testing.assert_array_equal(own.views[1].ids, true.views[1].ids)


def test_orders_with_which_a_board_looks_the_same() -> None:
    told = BoardPattern(9, 6, 0.03), BoardPattern(8, 6, 0.03, "DICT_4X4_50", 0.02)
    assert [len(orders_of(p)) for p in (PATTERN, EVEN, SQUARE, *told)] == [2, 2, 4, 1, 1]


@pytest.mark.parametrize("count", [0, 5, 8, 12, 14])
def test_a_mirrored_lens_images_what_is_mirrored(count: int) -> None:
    """Each of OpenCV's coefficients, with a skew, to rounding: 2e-13 px."""
    distortion = np.array(
        [0.1, -0.05, 0.003, 0.004, 0.01, 0.02, 0.03, 0.01, 0.02, 0.01, 0.015, 0.03, 0.02, 0.05]
    )
    K = SMALL.K.copy()
    K[0, 1] = 3.0
    lens = replace(SMALL, K=K, distortion=distortion[:count])
    points = np.random.default_rng(3).uniform([-0.4, -0.3, 1.0], [0.4, 0.3, 1.0], (50, 3))
    view = BoardView("one", SMALL.image_size, np.arange(50), lens.project(points))
    (seen_boards,), mirrored = _mirrored([SeenBoard(0, (view, view))], lens)
    corners = mirrored.project(points * [-1.0, 1.0, 1.0])
    assert np.allclose(seen_boards.views[1].corners, corners, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("pattern", [PATTERN, BoardPattern(9, 6, 0.02)])
def test_a_mirrored_camera_is_named(pattern: BoardPattern) -> None:
    """Its boards look sound, one by one: right-handed, and in an order that the colours allow."""
    grid = np.arange(len(pattern.points)).reshape(pattern.rows, pattern.columns)
    boards = []
    for frame, (first, second) in seen(stereo(0.1), 10, pattern):
        corners = np.array([SMALL.image_size[0] - 1.0, 0]) + [-1.0, 1.0] * second.corners
        view = replace(second, corners=corners, ids=grid[::-1].ravel()[second.ids])
        boards.append(SeenBoard(frame, (first, view)))
    with refused("mirrored"):
        boards_in_one_order(boards, (SMALL, SMALL), pattern)


def test_a_board_at_the_same_place_counts_once() -> None:
    boards = seen(stereo(0.0), 6)
    again = boards[2]
    rng = np.random.default_rng(5)
    first, second = (
        replace(view, corners=view.corners + 0.2 * rng.normal(size=view.corners.shape))
        for view in again.views
    )
    every = [*boards, SeenBoard(17, (first, second))]
    found = found_boards(every)
    assert found.repeated == {17: 2}
    assert "17 (as 2)" in found.sentence
    assert [len(search.views) for search in found.searches.values()] == [6, 6]
    unused = found_of(found, dict.fromkeys(BOTH, SMALL)).unused
    assert unused == tuple(
        f"{name}17.png: the board stands where it does in frame 2" for name in BOTH
    )
    # A third camera that sees only the later of them has something new to tell.
    of_three = [(at, (*views, views[0] if at == 17 else None)) for at, views in every]
    assert not found_boards(of_three, (*BOTH, "third")).repeated


def found_boards(
    boards: Sequence[tuple[int, tuple[BoardView | None, ...]]], cameras: tuple[str, ...] = BOTH
) -> StereoBoards:
    """As found in photographs of these boards, by frame and camera."""
    moments = {at: {camera: f"{camera}{at}.png" for camera in cameras} for at, _ in boards}
    searches = {
        camera: BoardSearch(
            PATTERN,
            tuple(
                replace(view, name=moments[at][camera])
                for at, views in boards
                if (view := views[k]) is not None
            ),
        )
        for k, camera in enumerate(cameras)
    }
    return stereo_boards(Pairing(moments), searches)


def assert_near(found: Pose, rig: Pose) -> None:
    """To 0.3 degrees and 1 %; measured: 0.02 degrees and 0.04 %."""
    assert np.degrees(Rotation.from_matrix(found.R @ rig.R.T).magnitude()) < 0.3
    assert found.baseline == pytest.approx(rig.baseline, rel=0.01)


def mirror(paths: Iterable[Path]) -> None:
    for path in paths:
        cv2.imwrite(str(path), read_photograph(path)[:, ::-1])


UPSIDE_DOWN = stereo(np.pi - 0.1)


@cache
def of_eight_boards() -> dict[str, bytes]:
    """Photographs of eight boards, the secondary camera upside down; not to be changed."""
    return photographs(UPSIDE_DOWN, 8, 3)


def test_photographs_to_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Upside-down secondary, one board hidden in half, one photographed twice."""
    files = of_eight_boards()
    again = {f"{side}08.png": files[f"{side}02.png"] for side in ("left", "right")}
    write(files | again, tmp_path)
    half = read_photograph(tmp_path / "right04.png").copy()
    half[:, : half.shape[1] // 2] = 120
    cv2.imwrite(str(tmp_path / "right04.png"), half)
    out = tmp_path / "found"
    command = ["detect", str(tmp_path), "--target", "board:8x6:0.03", "--out", str(out)]
    assert main(command) == 0
    told = "".join(capsys.readouterr())
    assert "7 boards of 8x6 inner corners are in photographs of both" in told
    assert "right04.png: no board with 8x6 inner corners is completely visible" in told
    assert "counts once: left out 8 (as 2)" in told
    data = pair_to_calibrate(read_recording(out))
    result = refine(data)
    known = data.primary.uncertainty
    assert known is not None
    assert {*known.without} == {*map(str, result.frames), "left04.png"}
    unknowns = result.unknowns
    C = unknowns.covariance(result.information / result.design_effect)
    as_of_other_boards = unknowns.M @ C @ unknowns.M.T
    assert not np.allclose(result.covariance, as_of_other_boards, rtol=0.05)
    assert_near(result.pose, UPSIDE_DOWN)


def test_a_charuco_board_seen_in_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In every third frame a part is hidden."""
    rig = stereo(np.pi - 0.2)
    write(photographs(rig, 7, 2, charuco(PATTERN.square_m), hidden=240), tmp_path)
    out = tmp_path / "found"
    command = ["detect", str(tmp_path), "--out", str(out), "--target"]
    assert main([*command, "charuco:8x6:0.03:4X4_50:0.022"]) == 0
    data = pair_to_calibrate(read_recording(out))
    counts = np.unique(data.correspondences.frame, return_counts=True)[1]
    assert counts.min() < 40 < counts.max() == 48
    assert_near(refine(data).pose, rig)
    assert main([*command, "charuco:6x8:0.03:4X4_50:0.022"]) == 2
    assert "shows one with 8x6: exchange columns and rows" in capsys.readouterr().err
    mirror(tmp_path.glob("left*.png"))
    assert main([*command, "charuco:8x6:0.03:4X4_50:0.022"]) == 2
    assert "left00.png is mirrored" in capsys.readouterr().err


def test_a_table_with_the_lenses_of_the_data_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without baseline in dataset.json it is free; the table alone is written."""
    check_of_the_size = "stereocal.intrinsics.boards._refuse_other_size"  # takes most of the time
    monkeypatch.setattr(check_of_the_size, lambda *_, **__: None)
    files = of_eight_boards()
    first = [f"{side}{at:02}.png" for side in ("left", "right") for at in range(5)]
    write({name: files[name] for name in first}, tmp_path)
    whole = tmp_path.with_name("whole")
    assert main(["intrinsics", *map(str, sorted(tmp_path.glob("*.png"))), "--board", "8x6",
                 "--square", "0.03", "--repeats", "4", "--out", str(whole)]) == 0  # fmt: off
    recording = read_recording(whole)
    assert list(recording.cameras) == ["primary", "secondary"]
    table = tmp_path / "points.csv"
    for name, content in pack_recording(recording).items():
        if name != "points.csv":
            (tmp_path / name).write_bytes(content)
    command = ["detect", str(tmp_path), "--target", "board:8x6:0.03", "--out", str(table)]
    assert main(command) == 0
    assert table.read_bytes() == (whole / "points.csv").read_bytes()
    mirror(tmp_path.glob("right*.png"))
    assert main(command) == 2
    assert "photographs of one camera are mirrored" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("board:9x6:3", ("centimetres",)),
        ("board:9x6:1", ("10 m", "centimetres")),
        ("board:9x6", ('"9x6"',)),
        ("board:9:0.03", ("18x12",)),
        ("board:9x6:0.03:7", ("board:9x6:0.03:7",)),
        ("charuco:9x6:0.03", ("charuco:9x6:0.03",)),
        ("charuco:9x6:0.03:4X4_5000:0.02", ("4X4_5000",)),
        ("charuco:9x6:0.03:4X4_50:0.04", ("markers",)),
    ],
)
def test_wrong_boards(text: str, said: tuple[str, ...]) -> None:
    with refused(*said):
        parse_board(text)


def test_boards_and_bars_are_told_apart() -> None:
    board = parse_board("charuco:9x6:0.03:4X4_50:0.022")
    assert board is not None
    assert board.pattern() == BoardPattern(9, 6, 0.03, "DICT_4X4_50", 0.022)
    assert parse_board("tags:4X4_50:3,7") is None
    with refused("board:9x6"):
        parse_target("boards")


@pytest.fixture(scope="module")
def files() -> dict[str, Path]:
    if "STEREOCAL_REAL_DATA" not in os.environ:
        pytest.skip("STEREOCAL_REAL_DATA names no folder of recordings")
    folder = Path(os.environ["STEREOCAL_REAL_DATA"], "opencv_boards")
    return {path.name: path for path in sorted(folder.glob("*.jpg"))}


class TestOpencvsSample:
    """13 pairs of 640x480 px, a board of 9x6 inner corners."""

    def test_the_size_is_found(self, files: dict[str, Path]) -> None:
        assert proposed_board(dict([*files.items()][:3])) == ProposedBoard(9, 6)

    def test_all_boards_serve(self, files: dict[str, Path]) -> None:
        """Narrow squares on one side."""
        pattern = BoardPattern(9, 6, 0.03)
        about = pair_names(files), files, dict.fromkeys(BOTH), pattern
        boards = find_stereo_boards(*about, AtOnce(), lambda _: None)
        assert len(boards.seen) == 13
        assert not boards.refused and not boards.repeated
        for search in boards.searches.values():
            corners = [view.corners.astype(np.float32) for view in search.views]
            points = [pattern.points.astype(np.float32)] * 13
            rms, *_ = cv2.calibrateCamera(points, corners, (640, 480), np.eye(3), np.zeros(5))
            # Measured: 0.181 and 0.187 px. OpenCV's own corners fit to 0.25 (sector based finder),
            # 0.195 and 0.207 (classical, windows of 5 px), 0.41 and 0.46 (windows of 11 px).
            assert rms < 0.195

    def test_columns_and_rows_exchanged_are_the_same_board(self, files: dict[str, Path]) -> None:
        """The corners are the same, in an order of their own in both photographs."""
        image = read_photograph(files["left03.jpg"])
        found = [find_board(image, BoardPattern(*size, 0.03), "x") for size in ((9, 6), (6, 9))]
        one, other = (view.corners for view in found if isinstance(view, BoardView))
        apart = np.linalg.norm(one[:, None] - other[None], axis=2).min(axis=1)
        assert apart.max() < 0.01


def test_sizes_of_lens_files_and_photographs() -> None:
    found = found_boards(seen(stereo(0.0), 3))
    with refused("primary", "640x480", "800x600"):
        found_of(found, {"primary": replace(SMALL, image_size=(800, 600)), "secondary": SMALL})


def test_large_2x2_targets_are_no_board(tmp_path: Path) -> None:
    """In one photograph of each pair the finder has a grid of 4x3."""
    rng = np.random.default_rng(25)
    scene = place_bars(RIG, rng, 4, BAR_M, (1.2, 2.5))
    bar, settings = BarSettings(board_m=0.25), PhotographSettings()
    pairs = list(photograph_bars(scene, (80.0, 80.0), bar, settings, rng))
    for image in (pairs[1].primary, pairs[3].secondary):
        path = tmp_path / "bar.png"
        cv2.imwrite(str(path), image)
        assert proposed_board({path.name: path}) is None


@pytest.mark.parametrize(
    ("squares", "dictionary", "marker"),
    [((6, 8), "DICT_6X6_50", 0.8), *further(((9, 7), "DICT_4X4_50", 0.73))],
)
def test_a_charuco_board_is_proposed(
    squares: tuple[int, int], dictionary: str, marker: float, tmp_path: Path
) -> None:
    """Columns, rows, dictionary and the markers' side, from photographs one of which is cut."""
    printed = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard(squares, 0.03, 0.03 * marker, printed)
    drawn = board.generateImage((56 * squares[0], 56 * squares[1]), marginSize=14)
    h, w = drawn.shape
    seen = np.array([[20, 8], [w - 40, 28], [w - 8, h - 20], [8, h - 40]], np.float32)
    whole = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    image = cv2.warpPerspective(
        drawn, cv2.getPerspectiveTransform(whole, seen), (w, h), borderValue=150.0
    )
    files = {}
    for name, image_of in (("a", image), ("b", image), ("c", image[: 3 * h // 4])):
        files[name] = tmp_path / f"{name}.png"
        cv2.imwrite(str(files[name]), image_of)
    found = proposed_board(files)
    assert found is not None
    assert (found.columns, found.rows) == (squares[0] - 1, squares[1] - 1)
    assert found.dictionary == dictionary
    # To 2 px of 56 a square: the corners of markers lie on their outermost pixels.
    assert found.marker == pytest.approx(marker, abs=0.04)


def test_fisheyes_are_taken_for_what_they_are_and_used_to_75_degrees(tmp_path: Path) -> None:
    """Boards up to 100 degrees from the axis; the lenses come from the same photographs."""
    rng = np.random.default_rng(1)
    rig = Pose(Rotation.from_rotvec([0.02, 0.2, 0.03]).as_matrix(), np.array([-0.3, 0.01, 0.02]))
    lenses = draw_fisheye(rng), draw_fisheye(rng)
    boards = draw_pairs(lenses, rig, BoardPattern(5, 4, 0.03), 10, 0.1, rng)
    found = {name: lens.camera for name, lens in lenses_of_boards(boards, None, AtOnce()).items()}
    assert all(camera.is_fisheye for camera in found.values())
    recording = found_of(boards, found).recording
    beyond = recording.beyond_view
    assert min(beyond.values()) > 5
    write(pack_recording(recording), tmp_path)
    result = refine(pair_to_calibrate(read_recording(tmp_path)))
    assert_near(result.pose, rig)
    # Written with the points far out, as other programs do: they are left out, and counted.
    whole = ["frame,camera,target,u,v"]
    for frame, views in boards.seen.items():
        for which, view in views.items():
            rows = zip(view.ids, view.corners.tolist(), strict=True)
            whole += [f"{frame},{which},{target},{u},{v}" for target, (u, v) in rows]
    (tmp_path / "points.csv").write_text("\n".join(whole))
    again = read_dataset(tmp_path)
    assert again.recording.beyond_view == beyond
    assert f"Left out: {beyond['primary']} points of the primary camera" in warnings_about(again)[0]
