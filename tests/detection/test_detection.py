"""The two targets of a photograph: found, doubtful or refused; many photographs at once."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from stereocal.detection.detect import Detection, detect_targets
from stereocal.simulation.simulate import field_rig
from tests.detection.boards import Board, picture
from tools.photographs.backgrounds import outdoors
from tools.photographs.bars import BarSettings, photograph_bars, place_visible_bars
from tools.photographs.rendering import Photograph, PhotographSettings

SIZE = (700, 400)
LEFT = Board((170.3, 200.2), 80.0, 0.3, 0.5, 1.0)
RIGHT = Board((520.3, 170.2), 90.0, 1.0, 0.3, 2.0)


def scene(boards: Sequence[Board], noise: float = 2.0, blur: float = 1.0) -> Photograph:
    blurred = [replace(board, blur=blur) for board in boards]
    return picture(blurred, SIZE, noise, seed=1)


@pytest.fixture(scope="module")
def usual() -> Photograph:
    return scene([LEFT, RIGHT])


def chessboard_scene(rows: int, columns: int, square: int) -> Photograph:
    image = np.full((SIZE[1], SIZE[0]), 150, dtype=np.uint8)
    for i, j in np.ndindex(rows, columns):
        top, left = 60 + i * square, 200 + j * square
        image[top : top + square, left : left + square] = 200 if (i + j) % 2 else 40
    turn = cv2.getRotationMatrix2D((350, 200), 10, 1)
    soft = cv2.GaussianBlur(cv2.warpAffine(image, turn, SIZE, borderValue=150), (0, 0), 1)
    noise = np.random.default_rng(2).normal(size=soft.shape) * 2
    return np.asarray(np.clip(soft + noise, 0, 255), dtype=np.uint8)


def grain(height: int, width: int) -> Photograph:
    return np.random.default_rng(0).integers(0, 255, (height, width), np.uint8)


def centres(detection: Detection) -> npt.NDArray[np.float64]:
    assert detection.targets is not None
    return np.array([corner.centre for corner in detection.targets])


def test_two_boards_are_found_left_to_right(usual: Photograph) -> None:
    detection = detect_targets(usual)
    assert (detection.state, detection.reason, detection.doubts) == ("found", None, ())
    assert detection.image_size == SIZE
    # The stated sigma is 0.006 px.
    np.testing.assert_allclose(centres(detection), [LEFT.centre, RIGHT.centre], atol=0.03)


def test_a_steep_bar_goes_from_top_to_bottom(usual: Photograph) -> None:
    detection = detect_targets(np.ascontiguousarray(usual.T[:, ::-1]))
    assert np.diff(centres(detection)[:, 1])[0] > 0


@pytest.mark.parametrize("factor, kind", [(257, np.uint16), (16, np.uint16), (1 / 255, np.float64)])
def test_any_depth_gives_the_same(usual: Photograph, factor: float, kind: type) -> None:
    again = detect_targets((usual.astype(float) * factor).astype(kind))
    assert again.state == "found"
    np.testing.assert_allclose(centres(again), centres(detect_targets(usual)), atol=0.002)


@pytest.mark.parametrize(
    "image, reason",
    [
        (lambda: np.zeros((300, 400), np.uint8), "too few candidates"),
        (lambda: np.full((300, 400), 255, np.uint8), "saturated"),
        (lambda: np.full((300, 400), 77, np.uint8), "too few candidates"),
        (lambda: np.zeros((3, 3), np.uint8), "too few candidates"),
        (lambda: np.zeros((1, 5000), np.uint16), "too few candidates"),
        (lambda: grain(300, 400), "too few candidates"),
        (lambda: grain(18, 18), "too few candidates"),
        (lambda: scene([LEFT]), "too few candidates"),
        (lambda: scene([LEFT, Board((710.0, 170.0), 90.0, 1.0, 0.3, 2.0)]), "too few candidates"),
        (lambda: scene([LEFT, Board((690.0, 170.0), 90.0, 1.0, 0.3, 2.0)]), "cut by the border"),
        (lambda: scene([LEFT, RIGHT, Board((350.0, 320.0), 85.0, 0.1, 0.2)]), "ambiguous"),
        (lambda: scene([LEFT, RIGHT], blur=40.0), "blurred"),
        (lambda: chessboard_scene(6, 4, 40), "too few candidates"),
        (lambda: chessboard_scene(3, 3, 60), "too few candidates"),
        (lambda: chessboard_scene(2, 3, 60), "too few candidates"),
    ],
)
def test_what_is_refused_and_why(image: Callable[[], Photograph], reason: str) -> None:
    detection = detect_targets(image())
    assert (detection.state, detection.reason) == ("refused", reason)
    assert detection.sentence.endswith(".")


@pytest.mark.parametrize(
    "boards, blur, word",
    [
        ([LEFT, Board((672.0, 170.0), 90.0, 1.0, 0.3, 2.0)], 1.0, "border"),
        ([LEFT, RIGHT], 11.0, "blurred"),
    ],
)
def test_doubts_are_said(boards: list[Board], blur: float, word: str) -> None:
    detection = detect_targets(scene(boards, blur=blur))
    assert detection.state == "doubtful"
    assert word in detection.sentence


def test_each_doubtful_target_has_one_reason_with_what_was_measured(usual: Photograph) -> None:
    overexposed = np.clip(usual.astype(float) * 1.5, 0, 255).astype(np.uint8)
    for image, words in (
        (scene([LEFT, RIGHT], blur=11.0), ("blurred: its edges are",)),
        (overexposed, ("overexposed",)),
    ):
        detection = detect_targets(image)
        assert detection.state == "doubtful"
        assert len(detection.doubts) <= 2
        assert all(any(word in doubt for word in words) for doubt in detection.doubts)


def test_a_chessboard_beside_the_bar_does_not_matter(usual: Photograph) -> None:
    image = usual.copy()
    image[290:390, 250:450] = chessboard_scene(6, 4, 40)[100:200, 200:400]
    np.testing.assert_allclose(
        centres(detect_targets(image)), [LEFT.centre, RIGHT.centre], atol=0.03
    )


def test_the_bar_in_the_field_among_clutter() -> None:
    rng = np.random.default_rng(12)
    rig = field_rig()
    scene = place_visible_bars(rig, rng, 1, 0.9)
    backgrounds = outdoors(rig, rng)
    bar = BarSettings(tilt_rad=(0.0, 1.0))
    for pair in photograph_bars(scene, backgrounds, bar, PhotographSettings(read_noise=3.0), rng):
        for which in ("primary", "secondary"):
            found = centres(detect_targets(getattr(pair, which)))
            truth = getattr(pair, f"centres_{which}")
            off = min(np.abs(found - truth).max(), np.abs(found - truth[::-1]).max())
            assert off < 0.06  # the stated sigmas are 0.005 to 0.02 px
