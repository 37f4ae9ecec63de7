"""Rendered photographs: is everything where and as bright as it is said to be?"""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.simulation.simulate import field_rig
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY
from tools.photographs.rendering import (
    Board,
    PhotographSettings,
    Picture,
    Placed,
    expose,
    paint,
    turned,
    x_corner_board,
)

STRAIGHT = Camera(
    np.array([[1000.0, 0.0, 50.0], [0.0, 1000.0, 50.0], [0.0, 0.0, 1.0]]), np.zeros(5), (101, 101)
)


def painted(camera: Camera, placed: Placed, blur_px: float, grey: float = 120.0) -> Picture:
    """A board before a grey background."""
    width, height = camera.image_size
    picture = np.full((height, width), grey, dtype=np.float32)
    paint(picture, camera, placed, blur_px)
    return picture


def x_corner(centre: FloatArray, angle: float, blur_px: float, side: int) -> FloatArray:
    """The image (side, side) of an X-corner seen straight on, in closed form: -1 to 1.

    Blur turns the sign of each edge into an error function; Gauss-Legendre quadrature, exact to
    1e-6 here, averages the smooth product over each pixel.
    """
    y, x = np.mgrid[:side, :side].astype(np.float64)
    nodes, weights = leggauss(8)
    total = np.zeros((side, side))
    for i, first in zip(0.5 * nodes, 0.5 * weights, strict=True):
        for j, second in zip(0.5 * nodes, 0.5 * weights, strict=True):
            du, dv = x + i - centre[0], y + j - centre[1]
            across = np.cos(angle) * du + np.sin(angle) * dv
            down = np.cos(angle) * dv - np.sin(angle) * du
            scale = blur_px * np.sqrt(2.0)
            total += first * second * erf(across / scale) * erf(down / scale)
    return total


def shift_between(
    picture: FloatArray, slopes: tuple[FloatArray, FloatArray], expected: FloatArray
) -> FloatArray:
    """By how much (2,) a picture is shifted against the expected one, by least squares."""
    matrix = -np.column_stack([slope.ravel() for slope in slopes])
    return np.asarray(np.linalg.lstsq(matrix, (picture - expected).ravel(), rcond=None)[0])


@pytest.mark.parametrize("blur_px", [0.3, 0.8, 3.0])
def test_x_corner_lies_where_the_camera_projects_it(blur_px: float) -> None:
    rng = np.random.default_rng(5)
    inner = slice(30, 71)
    for angle in (0.0, 0.01, np.pi / 4, np.arctan(0.5), *rng.uniform(0.0, np.pi / 2, 2)):
        T = np.append(rng.uniform(-5e-4, 5e-4, 2), 1.0)
        pose = Pose(turned((0.0, 0.0, angle)), T)
        picture = painted(STRAIGHT, Placed(x_corner_board(0.2, 40.0, 200.0), pose), blur_px).astype(
            float
        )
        centre = STRAIGHT.project(T[None])[0]
        expected = 120.0 - 80.0 * x_corner(centre, angle, blur_px, 101)
        slopes = (
            np.gradient(expected, axis=1)[inner, inner],
            np.gradient(expected, axis=0)[inner, inner],
        )
        shift = shift_between(picture[inner, inner], slopes, expected[inner, inner])
        # Measured 0.0005 px at most, at a blur of 0.3 px.
        assert np.abs(shift).max() < 0.001
        # Of a contrast of 160; measured 0.3 at most.
        assert np.abs(picture - expected)[inner, inner].max() < 0.6


def densely_sampled(
    camera: Camera, placed: Placed, corner: tuple[int, int], side: int, blur_px: float
) -> FloatArray:
    """A window (side, side) of a picture by plain means: 16x16 exact rays a pixel, then SciPy.

    The board must cover the window and 4 px around it.
    """
    density, pad = 16, 4
    offsets = (np.arange((side + 2 * pad) * density) + 0.5) / density - 0.5 - pad
    pixels = np.stack(np.meshgrid(corner[0] + offsets, corner[1] + offsets), -1).reshape(-1, 2)
    rays = np.column_stack([camera.undistort(pixels), np.ones(len(pixels))])
    pose, cells = placed.camera_from_board, placed.board.cells
    normal = pose.R[:, 2]
    points = rays * (normal @ pose.T / (rays @ normal))[:, None]
    places = (points - pose.T) @ pose.R[:, :2] / placed.board.size_m + 0.5
    columns, rows = np.floor(places * cells.shape[::-1]).astype(int).T
    fine = cells[rows, columns].reshape(len(offsets), -1)
    soft = gaussian_filter(fine, blur_px * density, truncate=4.0)
    means = soft.reshape(side + 2 * pad, density, side + 2 * pad, density).mean(axis=(1, 3))
    return np.asarray(means[pad:-pad, pad:-pad], dtype=np.float64)


@pytest.mark.parametrize("tilt", [*further(0.4), 1.05])
@pytest.mark.parametrize("camera", [PRIMARY, field_rig().secondary], ids=["wide", "long"])
def test_tilted_board_through_the_lens_equals_dense_sampling(camera: Camera, tilt: float) -> None:
    width, height = camera.image_size
    rng = np.random.default_rng(round(10 * tilt))
    for pixel in (np.array([70.3, 60.6]), np.array([width - 81.2, 0.4 * height])):
        T = 8.0 * np.append(camera.undistort(pixel)[0], 1.0)
        R = turned((tilt, 0.0, 0.0)) @ turned((0.0, 0.0, rng.uniform(0.0, 3.0)))
        placed = Placed(x_corner_board(80.0 * 8.0 / camera.K[0, 0]), Pose(R, T))
        picture = painted(camera, placed, 0.8)
        centre = camera.project(T[None])[0]
        left, top = (int(v) for v in np.round(centre) - 5)
        expected = densely_sampled(camera, placed, (left, top), 11, 0.8)
        rendered = picture[top : top + 11, left : left + 11].astype(float)
        # Contrast 170. Measured 0.7 at most.
        assert np.abs(rendered - expected).max() < 1.5
        slopes = (np.gradient(expected, axis=1), np.gradient(expected, axis=0))
        # Measured 0.0018 px at most; the peer places edges to 1/32 px.
        assert np.abs(shift_between(rendered, slopes, expected)).max() < 0.004


def test_pixels_average_what_they_see() -> None:
    """A chessboard finer than the pixels looks evenly grey; a board's light is its area's."""
    cells = np.indices((100, 100)).sum(axis=0) % 2 * 200.0
    pose = Pose(turned((0.0, 0.0, 0.3)), np.array([0.0, 0.0, 1.0]))
    fine = painted(STRAIGHT, Placed(Board(cells, (0.05, 0.05)), pose), 0.5)
    # Four cells a pixel; measured 0.085 at most off their mean.
    assert fine[40:61, 40:61].mean() == pytest.approx(100.0, abs=0.01)
    assert np.abs(fine[40:61, 40:61] - 100.0).max() < 0.3
    # Turned by any angle, a board of 20.6 x 10.3 px of grey 220 before 100 adds its area's light.
    board = Placed(Board(np.full((1, 1), 220.0), (0.0206, 0.0103)), pose)
    for blur_px in (0.0, 0.7, 2.0):
        added = (painted(STRAIGHT, board, blur_px, 100.0) - 100.0).sum()
        assert added == pytest.approx(120.0 * 20.6 * 10.3, rel=2e-5)  # measured 3e-6


def test_board_from_behind_shows_no_pattern_and_boards_behind_the_camera_are_refused() -> None:
    behind = Pose(turned((0.0, np.pi, 0.0)), np.array([0.0, 0.0, 1.0]))
    picture = painted(STRAIGHT, Placed(x_corner_board(0.05, 40.0, 200.0), behind), 0.5)
    np.testing.assert_allclose(picture[40:61, 40:61], 120.0, atol=1e-3)
    with refused("board", "front"):
        painted(
            STRAIGHT, Placed(x_corner_board(0.05), Pose(np.eye(3), np.array([0, 0, -1.0]))), 0.5
        )


def test_noise_has_the_stated_variance() -> None:
    for grey, settings in (
        (60.0, PhotographSettings(full_well_e=10_000.0, read_noise=2.0, vignetting=0.0)),
        (180.0, PhotographSettings(full_well_e=2_000.0, read_noise=0.0, vignetting=0.0, bits=12)),
        (120.0, PhotographSettings(full_well_e=np.inf, read_noise=8.0, vignetting=0.0, bits=16)),
    ):
        image = expose(np.full((400, 500), grey, np.float32), settings, np.random.default_rng(1))
        levels = image * (255.0 / (2**settings.bits - 1))
        rounding = (255.0 / (2**settings.bits - 1)) ** 2 / 12.0
        # A grey level of g holds g / 255 of the full well: its photon noise in grey levels.
        photons = grey * 255.0 / settings.full_well_e
        # 200,000 pixels: the variance is known to 0.3 %.
        assert levels.var() == pytest.approx(photons + settings.read_noise**2 + rounding, rel=0.015)
        assert levels.mean() == pytest.approx(grey, abs=0.05)
