"""Mean residuals over cells of an image: noise averages out, what belongs to a place remains."""

from dataclasses import dataclass

import numpy as np

from stereocal.system.array_types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class ResidualField:
    """Mean residuals over the cells of a grid on the image."""

    image_size: tuple[int, int]
    points: FloatArray
    """(n, 2), px."""
    mean: FloatArray
    """(rows, columns, 2): mean residuals, px; NaN with too few points."""
    count: IntArray
    """(rows, columns): points in each cell."""
    apart: BoolArray
    """(rows, columns): cells known to differ from zero; none if that was not tested."""

    @property
    def centres(self) -> FloatArray:
        """(rows, columns, 2): pixels in the middle of the cells."""
        width, height = self.image_size
        rows, columns = self.count.shape
        u = (np.arange(columns) + 0.5) * width / columns - 0.5
        v = (np.arange(rows) + 0.5) * height / rows - 0.5
        return np.stack(np.meshgrid(u, v), axis=-1)

    @property
    def known(self) -> BoolArray:
        """(rows, columns): cells with a mean."""
        return np.isfinite(self.mean[..., 0])

    @property
    def lengths_px(self) -> FloatArray:
        """(m,): lengths of the means of the cells that are known."""
        return np.asarray(np.linalg.norm(self.mean[self.known], axis=-1))

    @property
    def largest_px(self) -> float:
        """Length of the longest mean; NaN if there are none."""
        return float(self.lengths_px.max()) if self.known.any() else float("nan")


def residual_field(
    points: FloatArray,
    residuals: FloatArray,
    image_size: tuple[int, int],
    grid: tuple[int, int],
    fewest: int,
) -> ResidualField:
    """Residuals (n, 2) at points (n, 2), averaged over cells.

    Args:
        grid: columns and rows.
        fewest: points that a mean needs.
    """
    shape = grid[::-1]
    cells = cells_of(points, image_size, grid)
    count = np.bincount(cells, minlength=grid[0] * grid[1])
    sums = [np.bincount(cells, residuals[:, axis], len(count)) for axis in (0, 1)]
    mean = np.where(count >= fewest, sums / np.maximum(count, 1), np.nan)
    return ResidualField(
        image_size,
        points,
        np.moveaxis(mean, 0, -1).reshape(*shape, 2),
        count.reshape(shape),
        np.zeros(shape, dtype=np.bool_),
    )


def cells_of(points: FloatArray, image_size: tuple[int, int], grid: tuple[int, int]) -> IntArray:
    """(n,): the index of each point's cell, row by row; `grid` has columns and rows."""
    cell = ((points + 0.5) / image_size * grid).astype(np.int64)
    column, row = np.clip(cell, 0, np.array(grid) - 1).T
    return np.asarray(row * grid[0] + column)
