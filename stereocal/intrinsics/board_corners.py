"""Find the corners of a board in a photograph with OpenCV, order them and refine them."""

import hashlib
import itertools
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.latest import once
from stereocal.system.photograph import GreyImage

LARGE_PX = 1400
"""Photographs with a longer side are first searched at half their size."""
WINDOW_PX = (2, 15)
CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
BEYOND = (0.2, 0.3, 0.4, 0.5, 0.65)
"""Distances beyond the outermost corners at which the outer squares are looked for, in squares:
many boards are cut or printed with narrow ones. On OpenCV's 26 photographs, with squares cut to
0.4, their contrast is 0.76 or more of the others' at 0.2, and 0.12 at 0.5."""
FINDER_SEED = 1
"""The finder tries corners at random: without it, 2 of 16 photographs of boards gave another answer
when they were searched again."""
OF_OUTER = 0.65
"""Half the refinement's window over the width of the outer squares, so that its diagonal ends
within them: simulated squares of 0.3 to 0.5 gave an RMS error of 0.02 to 0.03 px with it, and 0.3
to 1.0 px with the window of a board of full squares."""
PLAIN = 0.12
"""Most spread of the levels within a square of a chessboard, over the contrast of its squares. It
was 0.030 or less in 94 photographs whose whole grid was found, and 0.047, 0.18 and 0.36 at most in
9 more; where small markers were in the squares, too small to be read, it was 0.205 or more."""
WITHIN = np.linspace(0.25, 0.75, 5)
"""Places within a square at which this is looked at, in squares."""
HALF_CIRCLE = 16
"""Places on half of a circle about a corner."""
ODD_SHARE = 2.0
"""A crossing has this many times as much contrast that is alike at opposite places as that is not;
rendered crossings have 25 times or more, places that the finder took for one up to 1.4 times."""
MINIMUM_CONTRAST = 0.4
"""Contrast of the outer squares, as a fraction of that of the others. Beyond the edge of the
board it was at most 0.23 on the same photographs."""


@dataclass(frozen=True, eq=False)
class Chessboard:
    """A grid of corners as the finder gives it, in the board's own order."""

    corners: FloatArray
    """(n, 2): pixels, to about one pixel, row by row."""
    turned: bool
    """Whether the finder had another order."""
    outer: float
    """How far squares alternate beyond the outermost corners, in squares, at most 0.65; 0 if they
    do not. When asked for one row too many, the finder returns points on the board's edge."""


def halved(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """The photograph at half the size."""
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.asarray(half, dtype=np.uint8)


def find_chessboard(
    grey: npt.NDArray[np.uint8], columns: int, rows: int, thorough: bool = True
) -> Chessboard | None:
    """The inner corners of a chessboard, of a whole one if there is one.

    Args:
        thorough: search exhaustively, which takes 2 s if there is no board; it also finds a part
            of a larger board.

    Uses OpenCV's sector based finder (Duda & Frese 2018): 0.09 s at half the size and 0.35 s at
    full size of a photograph of 2336x1728 px. A thorough search ends with the classical finder,
    which finds some boards at the rim of a fisheye that the other does not; it took 70 s on noise
    of that size, 0.4 s at half the size with its quick check first.

    What was found is kept: the corners of a proposed board are asked for again by its search, and
    by each search with squares of another size.
    """
    content = hashlib.sha256(grey.tobytes()).hexdigest()
    key = f"{content} {grey.shape} {columns}x{rows} {thorough}"
    return once("board", key, lambda: _find_chessboard(grey, columns, rows, thorough))


def _find_chessboard(
    grey: npt.NDArray[np.uint8], columns: int, rows: int, thorough: bool
) -> Chessboard | None:
    """What `find_chessboard` gives, searched anew."""
    small, scaled = (halved(grey), 2.0) if max(grey.shape) > LARGE_PX else (grey, 1.0)
    sector, classic = cv2.findChessboardCornersSB, cv2.findChessboardCorners
    tries = [(sector, grey, 1.0, 0)]
    if thorough:
        tries.append((sector, grey, 1.0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE))
        tries.append((classic, small, scaled, CLASSIC))
    if scaled > 1.0:
        tries.insert(0, (sector, small, scaled, 0))
    best = None
    for finder, image, scale, flags in tries:
        cv2.setRNGSeed(FINDER_SEED)
        is_found, corners = finder(image, (columns, rows), flags=flags)
        if is_found and len(corners) == rows * columns:
            raw = np.asarray(corners, dtype=np.float64).reshape(rows, columns, 2)
            # Pixel centres are integers: the middle of pixels 0 and 1 is 0.5.
            grid = scale * raw + 0.5 * (scale - 1.0)
            if finder is classic and goes_on(grid, grey):
                continue
            best = Chessboard(*in_board_order(grid, grey), outer_squares(grid, grey))
            if best.outer:
                break
    return best


def outer_squares(grid: FloatArray, grey: GreyImage) -> float:
    """How far black and white squares alternate beyond the outermost corners of a grid, in
    squares: the last of `BEYOND`, or 0."""
    return max(
        (*itertools.takewhile(lambda squares: _alternate(grid, grey, squares), BEYOND),),
        default=0.0,
    )


def _alternate(grid: FloatArray, grey: GreyImage, beyond: float) -> bool:
    """Whether black and white alternate on all four sides at a distance in squares."""
    return not any(margin < 0.0 for margin in _margins(_with_more(grid, 2 * beyond), grey))


def goes_on(grid: FloatArray, grey: GreyImage) -> bool:
    """Whether squares alternate on a side beyond those next to a grid: it is a part of a board.

    Asked for 7x6 corners, the classical finder found a part of a board of 9x6 in 9 of 13
    photographs; two cameras may find different ones.
    """
    wider = _with_more(_with_more(grid, 1.0), 0.4)  # the outermost squares may be as narrow
    return any(margin > 0.0 for margin in _margins(wider, grey))


def _with_more(grid: FloatArray, squares: float) -> FloatArray:
    """A grid with a row more before the first and after the last, at this distance, and columns."""
    for _ in range(2):
        step = squares * (grid[[0, -1]] - grid[[1, -2]])
        grid = np.concatenate([grid[:1] + step[:1], grid, grid[-1:] + step[1:]]).swapaxes(0, 1)
    return grid


def _margins(grid: FloatArray, grey: GreyImage) -> list[float]:
    """The contrast of the outermost squares less the least one, on the four sides; NaN out of
    view."""
    level, like_first = _squares(grid, grey)
    inner = np.s_[1:-1, 1:-1]
    usual = _contrast(level[inner], like_first[inner])
    sides = (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1])
    contrasts = [_contrast(level[side], like_first[side]) * np.sign(usual) for side in sides]
    return [contrast - MINIMUM_CONTRAST * abs(usual) for contrast in contrasts]


def _contrast(level: FloatArray, like_first: BoolArray) -> float:
    """Difference in level between squares of the two colours; NaN if either is not in view."""
    one, other = level[like_first], level[~like_first]
    if np.isnan(one).all() or np.isnan(other).all():
        return float("nan")
    return float(np.nanmedian(one) - np.nanmedian(other))


def _squares(grid: FloatArray, grey: GreyImage) -> tuple[FloatArray, BoolArray]:
    """(rows - 1, columns - 1): level in the middle of each square, NaN outside the image, and
    whether it has the colour of the first."""
    middles = 0.25 * (grid[:-1, :-1] + grid[:-1, 1:] + grid[1:, :-1] + grid[1:, 1:])
    height, width = grey.shape
    u, v = np.moveaxis(np.rint(middles).astype(np.int64), -1, 0)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    level = grey[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(np.float64)
    return np.where(inside, level, np.nan), _like_first(u.shape)


def _like_first(shape: tuple[int, ...]) -> BoolArray:
    """Which squares (rows, columns) have the colour of the first."""
    return np.asarray(np.add.outer(*map(np.arange, shape)) % 2 == 0)


def plain_squares(grid: FloatArray, grey: npt.NDArray[np.uint8]) -> bool:
    """Whether squares of both colours between corners (rows, columns, 2) px are of one level."""
    along, down = (shares.ravel()[:, None] for shares in np.meshgrid(WITHIN, WITHIN))
    above, below = (
        row[:, :-1, None] * (1 - along) + row[:, 1:, None] * along for row in (grid[:-1], grid[1:])
    )
    u, v = np.moveaxis((above * (1 - down) + below * down).astype(np.float32), 3, 0)
    flat = len(u), -1
    levels = cv2.remap(grey, u.reshape(flat), v.reshape(flat), cv2.INTER_LINEAR).reshape(u.shape)
    spread, like_first = levels.std(axis=2, dtype=np.float64), _like_first(u.shape[:2])
    largest = max(np.median(spread[like_first]), np.median(spread[~like_first]))
    low, high = np.percentile(levels, [5, 95])
    return bool(largest <= PLAIN * (high - low))


def in_board_order(grid: FloatArray, grey: npt.NDArray[np.uint8]) -> tuple[FloatArray, bool]:
    """Corners in the board's own order, (n, 2) row by row, from a grid (rows, columns, 2).

    The finder may return a board mirrored, turned by 180 degrees or, if square, by 90. The lens is
    not affected, since every board has its own pose, but the numbering must agree between
    photographs. The order is right-handed seen from the front; of the candidates, the one with a
    black square behind the first corner, or, if the colours are symmetric, the one whose first row
    runs most to the right. Returns whether the order was changed too.
    """
    candidates = [grid, grid[::-1, ::-1]]
    if grid.shape[0] == grid.shape[1]:
        candidates += [np.swapaxes(grid, 0, 1)[::-1], np.swapaxes(grid, 0, 1)[:, ::-1]]
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] <= 0:  # not right-handed
        candidates = [candidate[:, ::-1] for candidate in candidates]
    darkness = []
    for candidate in candidates:
        level, like_first = _squares(candidate, grey)
        darkness.append(np.nanmean(level[~like_first]) - np.nanmean(level[like_first]))
    distinct = max(darkness) > 0 > min(darkness)
    left = [
        candidate
        for candidate, dark in zip(candidates, darkness, strict=True)
        if dark > 0 or not distinct
    ]
    best = max(left, key=lambda candidate: float(candidate[0, -1, 0] - candidate[0, 0, 0]))
    return best.reshape(-1, 2).copy(), best is not grid


def find_charuco(
    grey: npt.NDArray[np.uint8],
    squares: tuple[int, int],
    square_and_marker_m: tuple[float, float],
    dictionary: str,
) -> tuple[IntArray, FloatArray]:
    """Numbers (n,) and corners (n, 2) of the visible corners of a ChArUco board.

    With an even number of rows the layout from before OpenCV 4.6 is tried too.
    """
    ids: IntArray = np.empty(0, dtype=np.int64)
    corners: FloatArray = np.empty((0, 2))
    printed = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    for legacy in (False, True) if squares[1] % 2 == 0 else (False,):
        board = cv2.aruco.CharucoBoard(squares, *square_and_marker_m, printed)
        board.setLegacyPattern(legacy)
        pixels, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if numbers is not None and len(numbers) > len(ids):
            ids = np.asarray(numbers, dtype=np.int64).ravel()
            corners = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    return ids, corners


def refine_corners(image: GreyImage, corners: FloatArray, reach_px: float) -> FloatArray:
    """The corners (n, 2) to a few hundredths of a pixel; nothing else is printed within `reach_px`.

    The finder alone has a common shift of up to 0.2 px on tilted boards. Larger windows are
    better: with corners 22 to 61 px apart the error was 0.050 to 0.067 px with a half window of 3,
    and 0.020 to 0.025 px with 12.
    """
    half = int(np.clip(reach_px, *WINDOW_PX))
    source = image if image.dtype == np.uint8 else image.astype(np.float32)
    refined = cv2.cornerSubPix(
        source,
        corners.astype(np.float32).reshape(-1, 1, 2).copy(),
        (half, half),
        (-1, -1),
        (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4),
    )
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def are_crossings(grey: npt.NDArray[np.uint8], corners: FloatArray, radius_px: float) -> BoolArray:
    """(n,): whether the grey levels on a circle about each corner (n, 2) are those of a crossing of
    squares: alike at opposite places, rather than opposite as at an edge."""
    turns = np.linspace(0.0, 2 * np.pi, 2 * HALF_CIRCLE, endpoint=False)
    circle = max(radius_px, WINDOW_PX[0]) * np.column_stack([np.cos(turns), np.sin(turns)])
    u, v = np.moveaxis((corners[:, None] + circle).astype(np.float32), 2, 0)
    levels = cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    one, other = np.split(levels.astype(np.float64), 2, axis=1)
    return np.asarray((one + other).std(axis=1) > ODD_SHARE * (one - other).std(axis=1))
