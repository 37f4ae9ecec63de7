"""A lens calibration for the user: sentences, table, advice, coverage, residuals, preview."""

import math

import cv2
import numpy as np
import pandas as pd

from stereocal.detection.intensity import eight_bits
from stereocal.intrinsics.boards import BoardSearch, BoardView
from stereocal.intrinsics.calibrate_lens import RECOMMENDED_VIEWS, LensCalibration
from stereocal.intrinsics.lens_fit import LensSettings, better_model, held_out_px
from stereocal.rig.camera import Camera
from stereocal.rig.residual_field import ResidualField, cells_of, residual_field
from stereocal.system.numbers import decimals_of, with_error
from stereocal.system.photograph import FileContent, read_photograph

COVERAGE_CELLS = 10
FIELD_CELLS = (16, 12)
MINIMUM_IN_CELL = 5
WELL_COVERED = 0.6
SURE_FOCAL = 2e-3
"""Relative standard error of a focal length above which there is a warning."""
SYSTEMATIC = 2.0
"""Ratio of the cell means to the value expected from noise above which there is a warning."""
LENS_COLUMNS = ("parameter", "value", "standard error", "spread of draws", "all at once")
PREVIEW_WIDTH = 900
ORANGE_BGR = (0, 159, 230)


def lens_answer(lens: LensCalibration) -> str:
    """A sentence with the focal length and its quality."""
    fx, sigma = lens.values[0], lens.standard_errors[0]
    views = len(lens.search.views)
    turned = sum(view.turned for view in lens.search.views)
    boards = "1 board" if turned == 1 else f"{turned} boards"
    order = f" The corner order of {boards} was corrected." if turned else ""
    return (
        f"The focal length fx is {with_error(fx, sigma)} px; corners fit to {lens.error_px:.3f} px "
        f"(root mean square). {len(lens.drawn)} draws of {lens.per_draw} out of {views} "
        f"photographs; the corners cover {100 * coverage(lens.search):.0f} % of the image.{order}"
    )


def lens_rows(lens: LensCalibration) -> list[tuple[str, str, str, str, str]]:
    """A row of `LENS_COLUMNS` for each parameter; digits by the standard error."""
    rows = []
    for k, name in enumerate(lens.settings.parameters):
        if lens.settings.free[k] == 0:
            rows.append((name, "0", "held at 0", "", "0"))
            continue
        digits = decimals_of(lens.standard_errors[k])
        value, sigma, spread, of_all = (
            f"{values[k]:.{digits}f}"
            for values in (lens.values, lens.standard_errors, lens.spread, lens.of_all)
        )
        rows.append((f"{name} (px)" if k < 4 else name, value, sigma, spread, of_all))
    return rows


def lens_fit_table(lens: LensCalibration) -> pd.DataFrame:
    """The rows for the screen."""
    titles = [title.capitalize() for title in LENS_COLUMNS]
    return pd.DataFrame(lens_rows(lens), columns=titles).set_index("Parameter")


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
        more = f" and {len(outlying) - 5} more" if len(outlying) > 5 else ""
        messages.append(
            f"{', '.join(outlying[:5])}{more} fit{'s' * (len(outlying) == 1)} the lens much worse "
            "than the others: look at them, and leave them out if they are blurred or the board is "
            "bent."
        )
    views, size = len(search.views), calibration.per_draw
    if size < calibration.settings.subset:
        messages.append(
            f"{views} boards are few: each draw took {size} of them, and the standard errors are "
            f"about {math.sqrt(RECOMMENDED_VIEWS / views):.1f} times those of {RECOMMENDED_VIEWS} "
            "such boards. Take more photographs if you can."
        )
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


def hint(calibration: LensCalibration) -> str | None:
    """A possible improvement where nothing is wrong; None if there is none."""
    if calibration.settings.fix_k3 or calibration.camera.is_fisheye:
        return None
    if abs(calibration.values[-1]) > calibration.standard_errors[-1]:  # of k3
        return None
    return (
        "The coefficient k3 does not differ significantly from 0. It does no harm, but holding it "
        "at 0 makes k1 and k2 more precise."
    )


def note_on_model(search: BoardSearch, settings: LensSettings) -> str:
    """Which lens model describes the boards better, with the error of both on held-out boards."""
    px = held_out_px(search, settings)
    if not any(np.isfinite(errors_px).all() for errors_px in px.values()):
        return ""
    names = {"brown": "the usual lens (brown)", "fisheye": "the fisheye"}
    errors = {model: float(np.sqrt(np.square(errors_px).mean())) for model, errors_px in px.items()}
    figures = ", ".join(
        f"{names[model]} {f'{error:.3f} px' if math.isfinite(error) else 'none'}"
        for model, error in errors.items()
    )
    if (better := better_model(px, settings.model)) == settings.model:
        return f"Held-out boards: {figures}. The chosen model is as good as the other, or better."
    return f"Held-out boards: {figures}. Use the lens model {better}."


def largest_shift_px(camera: Camera) -> float:
    """The largest displacement of an image point by the distortion, px; NaN if unknown."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 21), np.linspace(-0.5, height - 0.5, 21))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    shift = np.linalg.norm(camera.undistort_to_pixels(pixels) - pixels, axis=1)
    return float(np.nanmax(shift)) if np.isfinite(shift).any() else float("nan")


def preview(path: FileContent, camera: Camera, view: BoardView | None) -> tuple[bytes, bytes]:
    """Two JPEG images: the photograph with the found corners marked, and undistorted (same K)."""
    grey = eight_bits(read_photograph(path))
    if camera.is_fisheye:
        undistorted = cv2.fisheye.undistortImage(grey, camera.K, camera.distortion, Knew=camera.K)
    else:
        undistorted = cv2.undistort(grey, camera.K, camera.distortion)
    scale = PREVIEW_WIDTH / grey.shape[1]
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    marked, straight = (
        cv2.resize(image, None, fx=scale, fy=scale, interpolation=how)
        for image in (cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), undistorted)
    )
    corners = np.empty((0, 2)) if view is None else view.corners
    for u, v in (corners + 0.5) * scale:
        cv2.circle(marked, (int(16 * u), int(16 * v)), 16 * 4, ORANGE_BGR, 1, cv2.LINE_AA, 4)
    first, second = (
        bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1])
        for image in (marked, straight)
    )
    return first, second
