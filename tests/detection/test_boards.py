"""Boards in photographs: where their corners are, in which order, and what is refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.intrinsics.board_corners import in_board_order, outer_squares
from stereocal.intrinsics.boards import BoardView, Refused, find_board, find_boards
from stereocal.rig.geometry import Pose
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.tasks import StoppedError
from tests.files import encoded
from tests.photographs.lens import PATTERN, SQUARES, AtOnce, corners_of, facing, photographed
from tests.refused import refused
from tools.photographs.rendering import Board, Photograph, chessboard

TELLABLE = BoardPattern(8, 5, 0.03)
"""9x6 squares: turned by 180 degrees, black and white are exchanged."""


def found(image: Photograph, pattern: BoardPattern = PATTERN) -> BoardView:
    view = find_board(image, pattern, "x.png")
    assert isinstance(view, BoardView), view
    return view


def nearest_order(corners: FloatArray, truth: FloatArray) -> FloatArray:
    """Errors, for a board that looks the same turned by 180 degrees."""
    errors = (corners - truth, corners[::-1] - truth)
    return min(errors, key=lambda error: float(np.abs(error).max()))


def narrow_board(width: float, beside: float) -> Board:
    """The board with outermost squares cut to a fraction of the others; grey level beside it."""
    whole = chessboard(SQUARES, PATTERN.square_m)
    cells = np.kron(whole.cells, np.ones((20, 20)))
    cut = 20 + round(20 * (1 - width))
    inside = np.zeros(cells.shape, dtype=bool)
    inside[cut:-cut, cut:-cut] = True
    return Board(np.where(inside, cells, beside), whole.size_m)


class TestCorners:
    @pytest.mark.parametrize(
        ("bits", "blur", "tilt"), [(8, 0.7, 0.0), (8, 0.7, 0.8), (12, 0.7, 0.3), (16, 1.5, 0.5)]
    )
    def test_against_truth(self, bits: int, blur: float, tilt: float) -> None:
        pose = facing(spin=0.2, tilt=tilt)
        view = found(photographed(pose, bits=bits, blur_px=blur))
        error = nearest_order(view.corners, corners_of(pose))
        # The finder alone is off by up to 0.2 px; measured after the refinement: RMS 0.014 to
        # 0.026 px, largest 0.08 px.
        assert np.sqrt((error**2).mean()) < 0.04
        assert np.abs(error).max() < 0.15

    @pytest.mark.parametrize("axis", [0, 1])
    @pytest.mark.parametrize("extra", ["before", "behind"])
    def test_edge_of_the_outermost_squares_is_no_row_of_corners(
        self, axis: int, extra: str
    ) -> None:
        """OpenCV takes it for one, asked for 11x9, in 1 of 30 photographs of 11x8 with a border."""
        pose = facing(spin=0.4)
        image = photographed(pose)
        grid = corners_of(pose).reshape(6, 8, 2)
        assert outer_squares(grid, image) == 0.65
        grid = np.moveaxis(grid, axis, 0)
        edge = 2 * grid[:1] - grid[1:2] if extra == "before" else 2 * grid[-1:] - grid[-2:-1]
        more = [edge, grid] if extra == "before" else [grid, edge]
        assert not outer_squares(np.moveaxis(np.concatenate(more), 0, axis), image)

    @pytest.mark.parametrize("beside", [205.0, 90.0])
    @pytest.mark.parametrize("width", [0.3, 0.5])
    def test_board_with_narrow_outer_squares(self, width: float, beside: float) -> None:
        """Cut or printed narrow, on light or dark ground; so are OpenCV's own photographs."""
        pose = facing(spin=0.4)
        view = found(photographed(pose, board=narrow_board(width, beside)))
        error = nearest_order(view.corners, corners_of(pose))
        # Measured: RMS 0.01 to 0.03 px; with windows that reach beyond the squares 0.2 to 0.6.
        assert np.sqrt((error**2).mean()) < 0.05

    @pytest.mark.parametrize("tilt", [1.45, np.pi / 2 - 0.01])
    def test_board_seen_edge_on_is_refused(self, tilt: float) -> None:
        refused = find_board(photographed(facing(tilt=tilt)), PATTERN, "x.png")
        assert isinstance(refused, Refused)
        assert "edge-on" in refused.reason or "no board with 8x6" in refused.reason


class TestOrder:
    @pytest.mark.parametrize("spin", [0.0, 1.5, np.pi, -0.7])
    def test_colours_tell_the_first_corner(self, spin: float) -> None:
        squares = (9, 6)
        pose = facing(spin=spin)
        view = found(photographed(pose, squares), TELLABLE)
        # Black stands top left, so white stands behind the first inner corner but one: the square
        # at row 1, column 1 is black again.
        np.testing.assert_allclose(view.corners, corners_of(pose, squares), rtol=0, atol=0.2)

    @given(
        st.sampled_from([(6, 8), (5, 8), (6, 6), (5, 5), (7, 7)]),
        st.booleans(),
        st.booleans(),
        st.booleans(),
        st.floats(-3.1, 3.1),
    )
    @settings(max_examples=60)
    def test_any_order_gives_the_same(
        self,
        shape: tuple[int, int],
        upside_down: bool,
        mirrored: bool,
        transposed: bool,
        spin: float,
    ) -> None:
        rows, columns = shape
        squares = (columns + 1, rows + 1)
        pose = facing(spin=spin, tilt=0.2)
        truth = corners_of(pose, squares).reshape(rows, columns, 2)
        image = checkered(truth)
        grid = truth[::-1] if upside_down else truth
        grid = grid[:, ::-1] if mirrored else grid
        grid = np.swapaxes(grid, 0, 1) if transposed and rows == columns else grid
        first, _ = in_board_order(truth, image)
        again, changed = in_board_order(grid, image)
        np.testing.assert_array_equal(again, first)
        assert changed == (not np.array_equal(grid.reshape(-1, 2), first))


def checkered(grid: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """An image with a spot of the right colour in the middle of each square between the corners."""
    image = np.full((480, 640), 128, dtype=np.uint8)
    middles = 0.25 * (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:])
    for row, column in np.ndindex(middles.shape[:2]):
        u, v = np.rint(middles[row, column]).astype(int)
        image[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2] = 255 * ((row + column) % 2)
    return image


def charuco_board(squares: tuple[int, int]) -> Board:
    """A ChArUco board with a white border of one square; eight cells a square."""
    printed = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard(squares, 0.03, 0.0225, printed)
    # Drawn large, one pixel of each cell taken: OpenCV 4.9 rounds small markers to wrong places.
    large = drawn.generateImage((80 * squares[0], 80 * squares[1]), marginSize=0)
    pixels = large[5::10, 5::10]
    cells = np.pad(np.asarray(pixels, dtype=np.float64) * 0.7 + 30, 8, constant_values=210.0)
    return Board(cells, ((squares[0] + 2) * 0.03, (squares[1] + 2) * 0.03))


CHARUCO = BoardPattern(8, 6, 0.03, "DICT_4X4_50", 0.0225)


class TestCharuco:
    @pytest.mark.parametrize("spin", [0.2, 3.0, -1.4])
    def test_against_truth(self, spin: float) -> None:
        pose = facing(spin=spin)
        image = photographed(pose, board=charuco_board((9, 7)))
        view = found(image, CHARUCO)
        error = view.corners - corners_of(pose)[view.ids]
        assert len(view.ids) >= 40
        # Measured: RMS 0.02 to 0.03 px.
        assert np.sqrt((error**2).mean()) < 0.08

    def test_part_of_the_board_will_do(self) -> None:
        pose = Pose(facing().R, np.array([0.17, 0.05, 0.6]))
        view = found(photographed(pose, board=charuco_board((9, 7))), CHARUCO)
        assert 8 <= len(view.ids) < 48
        error = view.corners - corners_of(pose)[view.ids]
        assert np.abs(error).max() < 0.3

    def test_chessboard_is_no_charuco_board(self) -> None:
        refused = find_board(photographed(facing()), CHARUCO, "x.png")
        assert isinstance(refused, Refused) and "too few" in refused.reason


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of a ChArUco board: a chessboard is looked for in larger sizes too, for 1 s."""
    path = tmp_path_factory.mktemp("boards")
    board = charuco_board((9, 7))
    for at in range(5):
        image = photographed(facing(spin=0.3 * at), board=board)
        (path / f"{at:02}.png").write_bytes(encoded(image))
    return path


@pytest.fixture
def half_size(tmp_path: Path) -> Path:
    """A chessboard in 320x240 px, in which the boards that are not there are soon looked for."""
    path = tmp_path / "00.png"
    path.write_bytes(encoded(cv2.resize(photographed(facing()), None, fx=0.5, fy=0.5)))
    return path


def photographs(folder: Path) -> dict[str, Path]:
    return {path.name: path for path in sorted(folder.iterdir())}


class TestManyPhotographs:
    def test_progress_and_cancel(self, folder: Path) -> None:
        seen: list[tuple[int, int]] = []

        def cancel(done: int, total: int) -> None:
            seen.append((done, total))
            if done == 2:
                raise StoppedError

        with pytest.raises(StoppedError):
            find_boards(photographs(folder), CHARUCO, AtOnce(), cancel)
        assert seen == [(1, 5), (2, 5)]

    @pytest.mark.parametrize("size", ["9x7", "7x6"])
    def test_size_wrong_by_one_is_told(self, half_size: Path, size: str) -> None:
        wrong = BoardPattern.parse(size, 0.03)
        with refused("00.png", size, "8x6"):
            find_boards({"00.png": half_size}, wrong, AtOnce())
