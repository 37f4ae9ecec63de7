"""How far a lens can be trusted: where the corners lay, what the lens leaves over, what to do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import PARAMETERS, LensCalibration
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray, IntArray

COVERAGE_CELLS = 10
FIELD_CELLS = (16, 12)
FEWEST_IN_CELL = 5
WELL_COVERED = 0.6
SURE_FOCAL = 2e-3
"""Standard error of a focal length, as a part of it, above which a person is told."""
SYSTEMATIC = 2.0
"""Means of the cells so many times larger than noise would leave are told."""


@dataclass(frozen=True, eq=False)
class ResidualField:
    """Mean residuals over the cells of a grid on the image."""

    image_size: tuple[int, int]
    mean: FloatArray
    """(rows, columns, 2): found less projected corners, in px; NaN with fewer than
    `FEWEST_IN_CELL` corners."""
    count: IntArray
    """(rows, columns): corners in each cell."""
    noise_px: float
    """Length that the means would have if the residuals were independent."""

    @property
    def centres(self) -> FloatArray:
        """(rows, columns, 2): pixels in the middle of the cells."""
        width, height = self.image_size
        rows, columns = self.count.shape
        u = (np.arange(columns) + 0.5) * width / columns - 0.5
        v = (np.arange(rows) + 0.5) * height / rows - 0.5
        return np.stack(np.meshgrid(u, v), axis=-1)

    @property
    def typical_px(self) -> float:
        """Root mean square length of the means; NaN without any."""
        lengths = np.linalg.norm(self.mean, axis=-1)
        known = lengths[np.isfinite(lengths)]
        return float(np.sqrt((known**2).mean())) if known.size else float("nan")

    @property
    def largest_px(self) -> float:
        """The longest of the means; NaN without any."""
        lengths = np.linalg.norm(self.mean, axis=-1)
        return float(np.nanmax(lengths)) if np.isfinite(lengths).any() else float("nan")


def coverage(search: BoardSearch) -> float:
    """Part of the image's cells, 10 by 10, that have a corner of some board."""
    corners = np.concatenate([view.corners for view in search.views])
    cells = _cells(corners, search.image_size, (COVERAGE_CELLS, COVERAGE_CELLS))
    return len(np.unique(cells)) / COVERAGE_CELLS**2


def residual_field(calibration: LensCalibration) -> ResidualField:
    """What the lens leaves over, averaged by place in the image.

    Noise averages out; what stays is the same in many photographs: a lens that the model does not
    describe, or a board that is not flat.
    """
    corners = np.concatenate([view.corners for view in calibration.search.views])
    residuals = np.concatenate(calibration.residuals)
    columns, rows = FIELD_CELLS
    cells = _cells(corners, calibration.search.image_size, FIELD_CELLS)
    count = np.bincount(cells, minlength=rows * columns)
    sums = [np.bincount(cells, residuals[:, axis], rows * columns) for axis in (0, 1)]
    enough = count >= FEWEST_IN_CELL
    divisor = np.where(enough, count, 1)
    mean = np.where(enough, sums / divisor, np.nan)
    variance = float((residuals**2).sum(axis=1).mean())
    noise = np.sqrt((variance / divisor[enough]).mean()) if enough.any() else np.nan
    return ResidualField(
        calibration.search.image_size,
        np.moveaxis(mean, 0, -1).reshape(rows, columns, 2),
        count.reshape(rows, columns),
        float(noise),
    )


def advice(calibration: LensCalibration) -> list[str]:
    """What a person should know or do, in sentences; empty when all is well."""
    search = calibration.search
    told = []
    if outlying := calibration.outlying:
        told.append(
            f"{_list(outlying)} fit{'s' * (len(outlying) == 1)} the lens much worse than the "
            "others: look at them, and leave them out if they are blurred or the board is bent."
        )
    covered = coverage(search)
    if covered < WELL_COVERED:
        told.append(
            f"The corners reach {100 * covered:.0f} % of the image: where none was, the distortion "
            "is a guess. Take photographs with the board at the edges and in the corners."
        )
    relative = calibration.standard_errors[:2] / calibration.values[:2]
    if relative.max() > SURE_FOCAL:
        told.append(
            f"The focal length is known to {100 * relative.max():.1f} % only: tilt the board by 30 "
            "to 50 degrees in different directions, and take more photographs."
        )
    field = residual_field(calibration)
    if field.typical_px > SYSTEMATIC * field.noise_px:
        told.append(
            f"The lens leaves {field.typical_px:.2f} px that are the same in many photographs: the "
            "board may be bent, or the lens needs another model."
        )
    return told


def hint(calibration: LensCalibration) -> str | None:
    """What could be done better, where nothing is wrong."""
    k3 = PARAMETERS.index("k3")
    if calibration.settings.fix_k3:
        return None
    if abs(calibration.values[k3]) > calibration.standard_errors[k3]:
        return None
    return (
        "The coefficient k3 cannot be told from 0 here. It does no harm, but k1 and k2 are surer "
        "when it is held at 0."
    )


def largest_shift_px(camera: Camera) -> float:
    """How far the distortion moves a point of the image, at most, in px; NaN if nowhere known."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 21), np.linspace(-0.5, height - 0.5, 21))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    shift = np.linalg.norm(camera.undistort_to_pixels(pixels) - pixels, axis=1)
    return float(np.nanmax(shift)) if np.isfinite(shift).any() else float("nan")


def turned_count(search: BoardSearch) -> int:
    """How many boards were found in the reverse order and put right."""
    return sum(view.turned for view in search.views)


def _cells(corners: FloatArray, image_size: tuple[int, int], cells: tuple[int, int]) -> IntArray:
    """(n,): the number of the cell, row by row, that each corner lies in."""
    place = ((corners + 0.5) / image_size * cells).astype(np.int64)
    column, row = np.clip(place, 0, np.array(cells) - 1).T
    return np.asarray(row * cells[0] + column)


def _list(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return shown if len(names) <= 5 else f"{shown} and {len(names) - 5} more"
