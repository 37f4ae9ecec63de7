"""Averages of a table of cells over the area of each pixel, blurred.

Each pixel is cut into parts; a part is the average of many samples of the exact cells, and one
weighted sum over the parts is both the pixel's area and the optical blur.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereocal.compiled import FloatArray, compiled, inlined

SAMPLES_PER_PIXEL = 512
"""Samples of a part that an edge crosses, times parts of a pixel along an axis: an edge along the
rows or columns, the worst case, is placed to half of 1/512 px."""
BLUR_REACH = 4.0
"""The blur's kernel ends at so many standard deviations."""


def sample_offsets(parts: int) -> FloatArray:
    """(n, 2) in the unit square: Hammersley's points and their mirror images, all in the square.

    Each coordinate takes n evenly spaced values, symmetric about 1/2.
    """
    bits = int(np.ceil(np.log2(SAMPLES_PER_PIXEL / parts))) - 1
    count = 2**bits
    mirrored = np.array([int(f"{i:0{bits}b}"[::-1], 2) for i in range(count)])
    half = (np.column_stack([np.arange(count), mirrored]) + np.array([0.25, 0.75])) / count
    return np.concatenate([half, 1.0 - half])


def pixel_weights(blur_px: float, parts: int) -> npt.NDArray[np.float32]:
    """Weights of the parts along one axis that a pixel sums: its own area, then the blur."""
    reach = int(np.ceil(BLUR_REACH * blur_px)) * parts
    places = np.arange(-reach, reach + 1) / parts
    blur = np.exp(-0.5 * (places / max(blur_px, 1e-9)) ** 2)
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
    """Average grey (times cover) and cover of each part of each pixel.

    Args:
        s: (h + 1, w + 1) column on the board, in cells, of the pixels' corners; NaN off the plane.
        t: the same for the row.
        cells: (rows, columns) grey levels.
        offsets: (n, 2) places of the samples in the unit square.
        fine: (2, h parts, w parts), filled here.
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
def one_cell(
    s: tuple[float, float, float, float], t: tuple[float, float, float, float], cells: FloatArray
) -> tuple[bool, float, float]:
    """Whether an area sees one grey level only (or nothing of the board), its grey and cover."""
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
def at(corners: tuple[float, float, float, float], a: float, b: float) -> float:
    """A value at (a, b) of a unit square, bilinear between its corners."""
    above = (1.0 - a) * corners[0] + a * corners[1]
    return (1.0 - b) * above + b * ((1.0 - a) * corners[2] + a * corners[3])


@inlined
def part_average(
    s: tuple[float, float, float, float],
    t: tuple[float, float, float, float],
    cells: FloatArray,
    offsets: FloatArray,
    p: int,
    q: int,
    parts: int,
) -> tuple[float, float]:
    """Average grey (times cover) and cover over the part (row p, column q) of a pixel.

    `s` and `t` are the board coordinates of the pixel's corners, bilinear between them.
    """
    rows, columns = cells.shape
    left, right, top, bottom = q / parts, (q + 1) / parts, p / parts, (p + 1) / parts
    same, grey, cover = one_cell(
        (at(s, left, top), at(s, right, top), at(s, left, bottom), at(s, right, bottom)),
        (at(t, left, top), at(t, right, top), at(t, left, bottom), at(t, right, bottom)),
        cells,
    )
    if same:
        return grey, cover
    grey = cover = 0.0
    for n in range(len(offsets)):
        a, b = (q + offsets[n, 0]) / parts, (p + offsets[n, 1]) / parts
        column, row = np.floor(at(s, a, b)), np.floor(at(t, a, b))
        if 0 <= row < rows and 0 <= column < columns:
            grey += cells[int(row), int(column)]
            cover += 1.0
    return grey / len(offsets), cover / len(offsets)


@compiled
def sum_parts(
    fine: npt.NDArray[np.float32], weights: npt.NDArray[np.float32], parts: int
) -> npt.NDArray[np.float32]:
    """Weighted sums of the parts around each pixel, along rows and columns.

    Args:
        fine: (h parts, w parts).
        weights: of an odd number of pixels' parts, along either axis.

    Returns:
        (h - r, w - r) with r whole pixels less, half of them on each side.
    """
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
