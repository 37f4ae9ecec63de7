"""The lens both ways, against OpenCV."""

from typing import Any, ClassVar

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.formats.camera_file import read_camera, write_opencv_camera
from stereocal.rig.camera import CAMERAS, Camera, camera_in_words
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY, SECONDARY

K = np.array([[1190.6, 2.3, 612.8], [0.0, 1171.9, 530.1], [0.0, 0.0, 1.0]])
NO_SKEW = np.array([[1190.6, 0.0, 612.8], [0.0, 1171.9, 530.1], [0.0, 0.0, 1.0]])
LENSES = {
    0: [],
    4: [-0.22, 0.14, 0.0011, -0.0016],
    5: [-0.22, 0.25, 0.0005, -0.0004, -0.24],
    8: [0.31, -0.12, 0.0008, -0.0006, 0.02, 0.52, -0.05, 0.01],
    12: [0.31, -0.12, 0.0008, -0.0006, 0.02, 0.52, -0.05, 0.01, 2e-3, -1e-3, 1.5e-3, 5e-4],
    14: [0.31, -0.12, 8e-4, -6e-4, 0.02, 0.52, -0.05, 0.01, 2e-3, -1e-3, 1.5e-3, 5e-4, 0.02, -0.03],
}


def camera_with(coefficients: int, matrix: FloatArray = K) -> Camera:
    return Camera(matrix, np.array(LENSES[coefficients]), (1280, 1024))


def grid(width: int = 1280, height: int = 1024) -> FloatArray:
    """Pixels over the whole image, the corners too."""
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 24), np.linspace(-0.5, height - 0.5, 18))
    return np.column_stack([u.ravel(), v.ravel()])


class TestThereAndBack:
    @pytest.mark.parametrize("coefficients", LENSES)
    def test_pixels_and_normalised_points(self, coefficients: int) -> None:
        camera = camera_with(coefficients)
        back = camera.distort(camera.undistort(grid()))
        # Newton ends at 1e-13 on the plane z = 1, which is 1e-10 px; measured: 5e-13 px.
        np.testing.assert_allclose(back, grid(), rtol=0, atol=1e-9)
        rays = np.random.default_rng(3).uniform(-0.4, 0.4, (200, 2))
        back = camera.undistort(camera.distort(rays))
        # 1e-12 on the plane z = 1 is 1e-9 px; measured: 3e-16.
        np.testing.assert_allclose(back, rays, rtol=0, atol=1e-12)

    @given(
        st.floats(-0.25, 0.25),
        st.floats(-0.05, 0.05),
        st.floats(-3e-3, 3e-3),
        st.floats(-3e-3, 3e-3),
        st.floats(-1279, 1279),
        st.floats(-1023, 1023),
    )
    @settings(max_examples=60)
    def test_any_ordinary_lens(
        self, k1: float, k2: float, p1: float, p2: float, u: float, v: float
    ) -> None:
        camera = Camera(K, np.array([k1, k2, p1, p2]), (1280, 1024))
        pixel = np.abs([[u, v]])
        back = camera.distort(camera.undistort(pixel))
        np.testing.assert_allclose(back, pixel, rtol=0, atol=1e-9)


class TestProject:
    points = np.random.default_rng(4).uniform([-2, -1.5, 4], [2, 1.5, 9], (100, 3))

    @pytest.mark.parametrize("coefficients", LENSES)
    def test_agrees_with_opencv(self, coefficients: int) -> None:
        camera = camera_with(coefficients, NO_SKEW)
        lens = np.array(LENSES[coefficients] or [0.0] * 4)
        expected, _ = cv2.projectPoints(self.points, np.zeros(3), np.zeros(3), NO_SKEW, lens)
        # The same formula with the division done before: 1e-16 of 1000 px; measured: 2e-13 px.
        np.testing.assert_allclose(
            camera.project(self.points), np.asarray(expected).reshape(-1, 2), rtol=0, atol=1e-10
        )

    @pytest.mark.parametrize("coefficients", [0, 5])
    def test_behind_the_camera_is_nan(self, coefficients: int) -> None:
        points = np.array([[0.1, 0.2, 5.0], [0.1, 0.2, -5.0], [0.1, 0.2, 0.0]])
        found = camera_with(coefficients).project(points)
        assert np.isfinite(found[0]).all()
        assert np.isnan(found[1:]).all()


class TestNoInverse:
    def test_a_lens_that_folds_back_is_nan_beyond_the_fold(self) -> None:
        """r (1 - 0.5 r^2) is at most 0.544, at r = 0.816: no ray lands further out."""
        camera = Camera(np.diag([500.0, 500.0, 1.0]), np.array([-0.5, 0, 0, 0]), (1280, 1024))
        inside, outside = np.array([[200.0, 0.0]]), np.array([[300.0, 0.0]])
        r = camera.undistort(inside)[0, 0]
        assert r * (1 - 0.5 * r**2) == pytest.approx(0.4, abs=1e-12)
        assert np.isnan(camera.undistort(outside)).all()
        both = camera.undistort(np.vstack([inside, outside]))
        # A point that cannot be inverted must not keep the others from being found.
        np.testing.assert_allclose(both[0], camera.undistort(inside)[0], rtol=0, atol=1e-12)
        assert np.isnan(both[1]).all()

    @pytest.mark.parametrize("k1", [-0.5, -1.0, -3.0])
    def test_solutions_that_no_lens_has_are_not_taken(self, k1: float) -> None:
        """Beyond the fold the cubic still has a root, on the other side of the image."""
        camera = Camera(np.diag([500.0, 500.0, 1.0]), np.array([k1, 0, 0, 0]), (1280, 1024))
        fold = 1 / np.sqrt(-3 * k1)
        furthest = 500 * fold * 2 / 3
        along = np.array([np.cos(0.7), np.sin(0.7)])
        inside = np.linspace(0, 0.99 * furthest, 40)[:, None] * along
        outside = np.linspace(1.01 * furthest, 3 * furthest, 40)[:, None] * along
        found = camera.undistort(np.vstack([inside, outside]))
        assert np.isfinite(found[:40]).all()
        assert np.hypot(*found[:40].T).max() < fold
        assert np.isnan(found[40:]).all()


class TestRefusals:
    good: ClassVar[dict[str, Any]] = {"K": K, "distortion": np.zeros(5), "image_size": (1280, 1024)}

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"K": np.eye(4)}, "3x3"),
            ({"K": K.T}, "[0, fy, cy]"),
            ({"K": 2 * K}, "[0, fy, cy]"),
            ({"K": np.diag([0.0, 1.0, 1.0])}, "fx = 0 "),
            ({"K": np.diag([1.0, -1.0, 1.0])}, "fy = -1 "),
            ({"K": K * np.nan}, "NaN"),
            ({"distortion": np.array([np.inf, 0, 0, 0])}, "NaN"),
            ({"distortion": np.zeros(3)}, "3 distortion"),
            ({"distortion": np.zeros(6)}, "6 distortion"),
            ({"image_size": (0, 1024)}, " 0x1024 px"),
            ({"image_size": (1280, -1)}, "1280x-1 px"),
        ],
    )
    def test_what_is_no_camera(self, change: dict[str, Any], said: str) -> None:
        with refused(said):
            Camera(**{**self.good, **change})

    def test_json_there_and_back(self) -> None:
        back = Camera.from_json(SECONDARY.to_json(), "here")
        np.testing.assert_array_equal(back.K, SECONDARY.K)
        np.testing.assert_array_equal(back.distortion, SECONDARY.distortion)
        assert back.image_size == SECONDARY.image_size


def test_a_rational_lens_of_140_degrees_is_undistorted_in_its_whole_image() -> None:
    """Eight coefficients as of OpenCV's rational model, of a lens that is nearly equidistant."""
    lens = [0.5177316, 0.0405462, 3e-4, -2e-4, 2.568208e-4, 0.8113298, 0.1286591, 3.096235e-3]
    matrix = np.array([[703.0, 0.0, 953.2], [0.0, 705.1, 728.9], [0.0, 0.0, 1.0]])
    read = read_camera(write_opencv_camera(Camera(matrix, np.array(lens), (1920, 1440))), "x.yml")
    pixels = grid(1920, 1440)
    rays = read.undistort(pixels)
    assert np.hypot(*rays.T).max() > np.tan(np.radians(75.0))
    found, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(len(rays))]),
        np.zeros(3),
        np.zeros(3),
        matrix,
        np.array(lens),
    )
    np.testing.assert_allclose(found.reshape(-1, 2), pixels, rtol=0, atol=1e-9)


def test_undistorted_points_belong_to_who_asked() -> None:
    """They are kept for the next who asks for the same ones."""
    pixels = np.array([[100.0, 200.0], [900.0, 50.0]])
    first = PRIMARY.undistort(pixels)
    expected = first.copy()
    first[:] = 0.0
    np.testing.assert_array_equal(PRIMARY.undistort(pixels), expected)
    assert (SECONDARY.undistort(pixels) != expected).any()


def test_cameras_are_called_by_their_names() -> None:
    assert camera_in_words("primary") == "the primary camera"
    assert camera_in_words(*CAMERAS, begins=True) == "The primary and the secondary camera"
    # The names of a rig stay as they are.
    assert camera_in_words("Left", begins=True) == "Camera Left"
    assert camera_in_words("1", "2", "3") == "cameras 1, 2 and 3"
