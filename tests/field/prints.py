"""Prints as pictures: a PDF in grey levels, and the paper before a simulated camera."""

from __future__ import annotations

import numpy as np
import pypdfium2

from stereocal.field.printing.paper import Sheet
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from tools.photographs.rendering import (
    Board,
    Photograph,
    PhotographSettings,
    Placed,
    photograph,
    turned,
)

INCH_MM, DPI, FINE = 25.4, 200.0, 4
CAMERA = Camera(
    K=np.array([[2400.0, 0.0, 799.5], [0.0, 2400.0, 599.5], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.1, 0.05, 0.0005, -0.0004, 0.0]),
    image_size=(1600, 1200),
)


def posed(distance_m: float, tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Pose:
    """A sheet nearly in the middle of the view; the tilt is a rotation vector in radians."""
    return Pose(turned(tilt), np.array([0.01, -0.02, distance_m]))


def rasterised(pdf: bytes, dpi: float) -> FloatArray:
    """(h, w): grey levels of the only page, means of 4x4 dots.

    PDFium widens rectangles to whole dots, which is why there are more of them.
    """
    document = pypdfium2.PdfDocument(pdf)
    try:
        assert len(document) == 1
        dots = document[0].render(scale=FINE * dpi / 72.0, grayscale=True).to_numpy()
    finally:
        document.close()
    height, width = (side // FINE for side in dots.shape[:2])
    whole = dots[: height * FINE, : width * FINE].reshape(height, FINE, width, FINE)
    return np.asarray(whole.mean(axis=(1, 3)), dtype=np.float64)


def photographed(sheet: Sheet, pose: Pose) -> Photograph:
    """The whole sheet on a dark wall."""
    return placed_before_camera([(_inked(rasterised(sheet.pdf(), DPI)), pose)])


def placed_before_camera(boards: list[tuple[Board, Pose]]) -> Photograph:
    """What `CAMERA` sees of boards before a dark wall."""
    placed = [Placed(board, pose) for board, pose in boards]
    rng = np.random.default_rng(5)
    return photograph(CAMERA, 70.0, placed, PhotographSettings(), rng)


def cut_target(sheet: Sheet, side_mm: float) -> Board:
    """The first target of a sheet, cut out along the ends of its black squares."""
    picture = rasterised(sheet.pdf(), DPI)
    half = 0.5 * side_mm * DPI / INCH_MM

    def wide(line: FloatArray) -> list[tuple[int, int]]:
        return [run for run in black_runs(line) if run[1] - run[0] > 0.9 * half]

    rows = np.flatnonzero([bool(wide(row)) for row in picture])
    left, middle = wide(picture[rows[5]])[0]
    top, centre = wide(picture[:, (left + middle) // 2])[0]
    cut = picture[top : 2 * centre - top, left : 2 * middle - left]
    return _inked(cut)


def black_runs(line: FloatArray) -> list[tuple[int, int]]:
    """Start and end of each black part of a line of grey levels."""
    steps = np.diff(np.concatenate([[False], line < 128, [False]]).astype(np.int64))
    return [(int(start), int(stop)) for start, stop in np.flatnonzero(steps).reshape(-1, 2)]


def _inked(picture: FloatArray) -> Board:
    ink, white, metres = 25.0, 215.0, 1e-3 * INCH_MM / DPI
    height, width = picture.shape
    return Board(ink + (white - ink) / 255.0 * picture, (width * metres, height * metres))


def on_paper(pixels: FloatArray, pose: Pose) -> FloatArray:
    """Where raw pixels (n, 2) of `CAMERA` lie on the sheet, (n, 2) in mm from its centre."""
    rays = np.column_stack([CAMERA.undistort(pixels), np.ones(len(pixels))])
    to_plane = np.linalg.inv(np.column_stack([pose.R[:, :2], pose.T]))
    flat = rays @ to_plane.T
    metres: FloatArray = flat[:, :2] / flat[:, 2:]
    return 1e3 * metres
