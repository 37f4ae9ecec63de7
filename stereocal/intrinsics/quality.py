"""Quality of a lens calibration: coverage of the image, systematic residuals, advice."""

from __future__ import annotations

import math

import numpy as np

from stereocal.intrinsics.boards import BoardSearch
from stereocal.intrinsics.calibrate_lens import (
    PARAMETERS,
    RECOMMENDED_VIEWS,
    LensCalibration,
    LensSettings,
    held_out_px,
)
from stereocal.rig.camera import Camera
from stereocal.rig.residual_field import ResidualField, cells_of, residual_field

COVERAGE_CELLS = 10
FIELD_CELLS = (16, 12)
MINIMUM_IN_CELL = 5
WELL_COVERED = 0.6
SURE_FOCAL = 2e-3
"""Relative standard error of a focal length above which there is a warning."""
LEVEL = 0.02
"""Relative difference of the errors of two lens models below which they count as equal."""
SYSTEMATIC = 2.0
"""Ratio of the cell means to the value expected from noise above which there is a warning."""


def coverage(search: BoardSearch) -> float:
    """Fraction of the image's 10 by 10 cells that contain a corner of any board."""
    corners = np.concatenate([view.corners for view in search.views])
    cells = cells_of(corners, search.image_size, (COVERAGE_CELLS, COVERAGE_CELLS))
    return len(np.unique(cells)) / COVERAGE_CELLS**2


def lens_residuals(calibration: LensCalibration) -> ResidualField:
    """Found minus projected corners, averaged over cells of the image.

    Noise averages out; a lens that the model does not describe or a board that is not flat remains.
    """
    return residual_field(
        np.concatenate([view.corners for view in calibration.search.views]),
        np.concatenate(calibration.residuals),
        calibration.search.image_size,
        FIELD_CELLS,
        MINIMUM_IN_CELL,
    )


def typical_and_noise_px(calibration: LensCalibration) -> tuple[float, float]:
    """Root mean square length of the cells' means, and what it would be of independent residuals;
    NaN if there are none.
    """
    field = lens_residuals(calibration)
    if not field.known.any():
        return float("nan"), float("nan")
    variance = float((np.concatenate(calibration.residuals) ** 2).sum(axis=1).mean())
    noise = np.sqrt((variance / field.count[field.known]).mean())
    return float(np.sqrt(np.square(field.lengths_px).mean())), float(noise)


def advice(calibration: LensCalibration) -> list[str]:
    """Warnings with what to do, one sentence each; empty if there are none."""
    search = calibration.search
    messages = []
    if outlying := calibration.outlying:
        messages.append(
            f"{_list(outlying)} fit{'s' * (len(outlying) == 1)} the lens much worse than the "
            "others: look at them, and leave them out if they are blurred or the board is bent."
        )
    if few := _few_boards(calibration):
        messages.append(few)
    covered = coverage(search)
    if covered < WELL_COVERED:
        messages.append(
            f"The corners cover {100 * covered:.0f} % of the image; elsewhere the distortion is "
            "extrapolated. Take photographs with the board at the edges and in the corners."
        )
    relative = calibration.standard_errors[:2] / calibration.values[:2]
    if relative.max() > SURE_FOCAL:
        messages.append(
            f"The focal length is known to {100 * relative.max():.1f} % only: tilt the board by 30 "
            "to 50 degrees in different directions, and take more photographs."
        )
    typical, noise = typical_and_noise_px(calibration)
    if typical > SYSTEMATIC * noise:
        messages.append(
            f"Systematic residuals of {typical:.2f} px are common to many photographs: "
            "the board may be bent, or the lens needs another model."
        )
    return messages


def _few_boards(calibration: LensCalibration) -> str | None:
    """What it costs that draws had to be smaller than set; None if they were not."""
    views, size = len(calibration.search.views), calibration.per_draw
    if size >= calibration.settings.subset:
        return None
    ratio = math.sqrt(RECOMMENDED_VIEWS / views)
    return (
        f"{views} boards are few: each draw took {size} of them, and the standard errors are about "
        f"{ratio:.1f} times those of {RECOMMENDED_VIEWS} such boards. Take more photographs if "
        "you can."
    )


def hint(calibration: LensCalibration) -> str | None:
    """A possible improvement where nothing is wrong; None if there is none."""
    k3 = PARAMETERS.index("k3")
    if calibration.settings.fix_k3 or calibration.camera.is_fisheye:
        return None
    if abs(calibration.values[k3]) > calibration.standard_errors[k3]:
        return None
    return (
        "The coefficient k3 does not differ significantly from 0. It does no harm, but holding it "
        "at 0 makes k1 and k2 more precise."
    )


def note_on_model(search: BoardSearch, settings: LensSettings) -> str:
    """Which lens model describes the boards better, with the error of both on held-out boards."""
    px = held_out_px(search, settings)
    if not all(math.isfinite(value) for value in px.values()):
        return ""
    names = {"brown": "the usual lens (brown)", "fisheye": "the fisheye"}
    better = min(px, key=lambda model: px[model])
    figures = ", ".join(f"{names[model]} {value:.3f} px" for model, value in px.items())
    if px[better] > (1 - LEVEL) * px[settings.model]:
        return f"Held-out boards: {figures}. The chosen model is as good as the other, or better."
    return f"Held-out boards: {figures}. Use the lens model {better}."


def largest_shift_px(camera: Camera) -> float:
    """The largest displacement of an image point by the distortion, px; NaN if unknown."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 21), np.linspace(-0.5, height - 0.5, 21))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    shift = np.linalg.norm(camera.undistort_to_pixels(pixels) - pixels, axis=1)
    return float(np.nanmax(shift)) if np.isfinite(shift).any() else float("nan")


def _list(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return shown if len(names) <= 5 else f"{shown} and {len(names) - 5} more"
