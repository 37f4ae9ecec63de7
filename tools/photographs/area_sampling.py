"""Average the cells of a board over the area of each pixel, with optical blur.

Each pixel is divided into parts. A part where cells meet is sampled. A weighted sum over the parts
then applies the pixel area and the blur together.
"""

import numpy as np
import numpy.typing as npt

from stereocal.rig.compiled import compiled, inlined
from stereocal.system.array_types import FloatArray

SAMPLES, LATTICE = 233, 144
"""Samples of a part where cells meet, and the step that spreads them (Fibonacci numbers)."""
BLUR_REACH = 4.0
"""Half width of the blur kernel, in standard deviations."""

Corners = tuple[float, float, float, float]
"""A coordinate on the board at the corners of a pixel, or of a part of it."""


def sample_offsets() -> FloatArray:
    """(SAMPLES, 2): a Fibonacci lattice in the unit square."""
    i = np.arange(SAMPLES)
    return (np.column_stack([i, i * LATTICE % SAMPLES]) + 0.5) / SAMPLES


def pixel_weights(blur_px: float, parts: int) -> npt.NDArray[np.float32]:
    """Weights of the parts along one axis: the pixel area convolved with the blur."""
    reach = int(np.ceil(BLUR_REACH * blur_px)) * parts
    offsets = np.arange(-reach, reach + 1) / parts
    blur = np.exp(-0.5 * (offsets / max(blur_px, 1e-9)) ** 2)
    weights = np.convolve(blur / blur.sum(), np.full(parts, 1.0 / parts))
    return weights.astype(np.float32)


@compiled
def fill_parts(
    s: FloatArray,
    t: FloatArray,
    cells: FloatArray,
    offsets: FloatArray,
    parts: int,
    fine: npt.NDArray[np.float32],
) -> None:
    """Average grey level (times coverage) and coverage of each part of each pixel.

    Args:
        s: (h + 1, w + 1): column on the board, in cells, of the pixel corners; NaN off the plane.
        t: the same for the row.
        cells: (rows, columns) grey levels.
        offsets: (n, 2) positions of the samples in the unit square.
        fine: (2, h parts, w parts), written.
    """
    for i in range(s.shape[0] - 1):
        for j in range(s.shape[1] - 1):
            across = s[i, j], s[i, j + 1], s[i + 1, j], s[i + 1, j + 1]
            down = t[i, j], t[i, j + 1], t[i + 1, j], t[i + 1, j + 1]
            same, grey, cover = one_cell(across, down, cells)
            for p in range(parts):
                for q in range(parts):
                    if not same:
                        grey, cover = part_average(across, down, cells, offsets, p, q, parts)
                    fine[0, i * parts + p, j * parts + q] = grey
                    fine[1, i * parts + p, j * parts + q] = cover


@inlined
def one_cell(s: Corners, t: Corners, cells: FloatArray) -> tuple[bool, float, float]:
    """Whether an area sees a single grey level (or no board), its grey level and its coverage."""
    rows, columns = cells.shape
    first_column, last_column = np.floor(min(s)), np.floor(max(s))
    first_row, last_row = np.floor(min(t)), np.floor(max(t))
    if not (last_column >= 0 and first_column < columns and last_row >= 0 and first_row < rows):
        return True, 0.0, 0.0
    if first_column < 0 or last_column >= columns or first_row < 0 or last_row >= rows:
        return False, 0.0, 0.0
    grey = cells[int(first_row), int(first_column)]
    for row in range(int(first_row), int(last_row) + 1):
        for column in range(int(first_column), int(last_column) + 1):
            if cells[row, column] != grey:
                return False, 0.0, 0.0
    return True, grey, 1.0


@inlined
def at(corners: Corners, a: float, b: float) -> float:
    """Bilinear interpolation at (a, b) in a unit square."""
    above = (1.0 - a) * corners[0] + a * corners[1]
    return (1.0 - b) * above + b * ((1.0 - a) * corners[2] + a * corners[3])


@inlined
def bilinear(corners: Corners) -> Corners:
    """Coefficients of 1, a, b and ab of what `at` interpolates."""
    first, across, down, last = corners
    return first, across - first, down - first, first - across - down + last


@inlined
def part_average(
    s: Corners, t: Corners, cells: FloatArray, offsets: FloatArray, p: int, q: int, parts: int
) -> tuple[float, float]:
    """Average grey level (times coverage) and coverage of the part (row p, column q) of a pixel."""
    left, right, top, bottom = q / parts, (q + 1) / parts, p / parts, (p + 1) / parts
    across = at(s, left, top), at(s, right, top), at(s, left, bottom), at(s, right, bottom)
    down = at(t, left, top), at(t, right, top), at(t, left, bottom), at(t, right, bottom)
    same, grey, cover = one_cell(across, down, cells)
    if same:
        return grey, cover
    grey, seen, (rows, columns) = 0.0, 0, cells.shape
    s0, s1, s2, s3 = bilinear(across)
    t0, t1, t2, t3 = bilinear(down)
    for n in range(len(offsets)):
        a, b = offsets[n]
        column, row = s0 + a * s1 + b * (s2 + a * s3), t0 + a * t1 + b * (t2 + a * t3)
        if 0 <= row < rows and 0 <= column < columns:  # not off the board, and not NaN
            grey += cells[int(row), int(column)]
            seen += 1
    return grey / len(offsets), seen / len(offsets)


@compiled
def sum_parts(
    fine: npt.NDArray[np.float32], weights: npt.NDArray[np.float32], parts: int
) -> npt.NDArray[np.float32]:
    """Weighted sums of the parts (h parts, w parts) around each pixel: (h - r, w - r), smaller by
    half of r on each side. The weights are those of r + 1 pixels, for both axes."""
    reach = len(weights) // parts - 1
    height, width = fine.shape[0] // parts - reach, fine.shape[1] // parts - reach
    down = np.zeros((height, fine.shape[1]), dtype=np.float32)
    for i in range(height):
        for k in range(len(weights)):
            for x in range(fine.shape[1]):
                down[i, x] += weights[k] * fine[i * parts + k, x]
    summed = np.empty((height, width), dtype=np.float32)
    for i in range(height):
        for j in range(width):
            total = np.float32(0.0)
            for k in range(len(weights)):
                total += weights[k] * down[i, j * parts + k]
            summed[i, j] = total
    return summed
