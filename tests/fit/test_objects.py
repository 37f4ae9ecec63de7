"""The refined method and the screening on objects with more than two targets."""

import numpy as np
import pytest

from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.parameter_file import of_file
from stereocal.fit.refine import refine
from stereocal.fit.screening.misplaced_target import misplaced_target
from stereocal.fit.screening.screen import screen
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.rig.rigid_object import RigidObject
from tests.further import further
from tests.rigs import known_rig
from tests.rigs.mistakes import misplaced
from tests.rigs.objects import BOARD, WAND, recorded

EXACT_LENSES = RefineSettings(lenses=dict.fromkeys(CAMERAS, LensPrior(0, 0)))


def angles_off(data: Pair) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the five angles, and their stated standard errors."""
    found = refine(data, EXACT_LENSES)
    off = np.array(found.pose.angles) - np.array(known_rig.ANGLES)
    return off, np.sqrt(np.diag(of_file(found.covariance, found.pose)))[:5]


def test_exact_points_give_the_exact_rig() -> None:
    for own in (WAND, BOARD):
        off, _ = angles_off(recorded(own, noise_px=0.0))
        assert np.abs(off).max() < 1e-8


def test_the_middle_marker_makes_the_rig_better_known() -> None:
    """With 50 % more points: measured 2 % of the yaw, which the lengths give, else 15 to 20 %."""
    with_m, without = (
        angles_off(recorded(WAND, 60, seen=np.tile([True, m, True], (60, 1))))[1]
        for m in (True, False)
    )
    assert (with_m < without).all()
    assert (with_m < 0.9 * without).sum() == 4


@pytest.mark.parametrize("bend_px", [0.1, *further(0.0)])
def test_stated_errors_of_boards_are_true(bend_px: float) -> None:
    """A board is one cluster: an error that its corners share makes the stated errors larger.

    Root mean square of z over 20 recordings and 5 angles, with 14 boards each; of 40: 0.80 and
    1.15, and 3.2 for the second if corners are taken for independent. It is below 1 because the
    lengths are exact here, and their stated errors are not 0.
    """
    z = [
        np.divide(*angles_off(recorded(BOARD, 14, 0.1, seed, bend_px=bend_px)))
        for seed in range(20)
    ]
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_a_placing_is_left_out_whole() -> None:
    data = recorded(BOARD, 14)
    rows = data.correspondences
    found = screen(misplaced(data, (rows.frame == 5) & (rows.target < 20), [0.0, 6.0]))
    assert found.left_out == (5,)
    assert not found.exchanged
    assert 5 not in found.dataset.correspondences.frames


@pytest.mark.parametrize("own", [WAND, BOARD])
def test_a_placing_that_is_turned_in_one_camera_is_named(own: RigidObject) -> None:
    found = screen(recorded(own, 14).with_targets_exchanged([3, 9]))
    assert found.left_out == (3, 9)
    assert found.exchanged == (3, 9)


def test_all_methods_take_an_object() -> None:
    found = calibrate(recorded(BOARD, 14))
    assert found.errors["2d"].reprojection_px.shape == (14 * 35,)
    assert found.errors["3d"].length.shape == (28,)
    # Lengths of 0.72 m, 6 to 10 m away, at 0.1 px; measured: 0.24 %.
    assert found.errors["3d"].mean_length < 4e-3
    assert not [text for text in found.warnings if "arget" in text and "not where" in text]


def wrong(target: int, off_m: float) -> RigidObject:
    points = WAND.points.copy()
    points[target, 0] += off_m
    return RigidObject(WAND.names, points, WAND.sigma_m)


@pytest.mark.parametrize("target", [0, 1, 2])
def test_a_target_that_is_not_where_it_was_said_is_named(target: int) -> None:
    """With a baseline known to 0.13 %, 8 mm on a wand of 750 mm."""
    data = recorded(WAND, 40, 0.05, stated=wrong(target, 0.008))
    text = misplaced_target(refine(data, EXACT_LENSES))
    assert text.startswith(f"Target {WAND.names[target]} is not where it is said to be")
    assert "mm, stated" in text


def test_without_a_baseline_the_images_cannot_tell_which() -> None:
    data = recorded(WAND, 40, 0.05, stated=wrong(1, 0.008))
    text = misplaced_target(refine(data.changed(baseline_sigma_m=np.inf), EXACT_LENSES))
    assert "cannot tell" in text and "(A, M or B)" in text


def test_a_wand_as_it_is_said_to_be_is_not_accused() -> None:
    """Of 8 sound recordings; each compares three distances at 4.5 standard errors, of which one in
    6,000 recordings is accused by chance."""
    for seed in range(8):
        assert not misplaced_target(refine(recorded(WAND, 24, 0.1, seed), EXACT_LENSES))
