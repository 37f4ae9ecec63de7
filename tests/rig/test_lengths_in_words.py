"""The rig in words, and the question whether its lengths are in metres."""

import numpy as np
import pytest

from stereocal.rig.geometry import Pose
from stereocal.rig.lengths_in_words import METRES_PER, as_held, question_about_units, rig_in_words
from stereocal.rig.pair import Pair
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from tests.rigs.known_rig import BAR_M, BASELINE_M, RIG, dataset
from tests.rigs.objects import BOARD, recorded

DATA = dataset(12)
_FLIP = np.diag([-1.0, 1.0, 1.0])
MIRRORED = Pose(_FLIP @ RIG.R @ _FLIP, _FLIP @ RIG.T)


def in_unit(unit: str) -> tuple[Pair, Pose]:
    """The lengths and the pose of who types numbers of another unit as metres."""
    per = METRES_PER[unit]
    wrong = DATA.changed(baseline_m=BASELINE_M / per, target_distance_m=BAR_M / per)
    return wrong, Pose(RIG.R, RIG.T / per)


def test_a_person_can_check_it() -> None:
    text = rig_in_words(DATA, RIG)
    assert text.startswith("The cameras are 2.37 m apart; a bar of 0.87 m was seen from ")
    near, far = (float(each) for each in text.split("from ")[1].split(" m away")[0].split(" to "))
    assert 5.5 < near < 8 < far < 11  # the bars lie 6 to 10.5 m away
    assert rig_in_words(DATA, None) == "The cameras are 2.37 m apart; the bar is 0.87 m long."
    assert question_about_units(DATA, RIG) == ""


def test_the_side_of_the_secondary_tells_of_mirrored_images() -> None:
    """A mirrored world has the secondary at the other end of the same baseline."""
    side, other = (rig_in_words(DATA, pose).split("is on the ")[1] for pose in (RIG, MIRRORED))
    assert {side.split(" ")[0], other.split(" ")[0]} == {"left", "right"}
    assert side.startswith("right") == (RIG.inverse().T[0] > 0.0)
    assert "mirrored" not in rig_in_words(recorded(BOARD, 4), RIG)
    above = Pose(np.eye(3), np.array([0.1, 2.0, 0.3]))
    assert "mirrored" not in rig_in_words(DATA, above)


def test_a_board_says_what_counts_as_a_bar() -> None:
    assert "two bars" in rig_in_words(recorded(BOARD, 4), RIG)
    assert "two bars" not in rig_in_words(DATA, RIG)
    sentence = "95 % of bars within 1 %, and the bar is sound."
    assert as_held(sentence, DATA) == sentence
    assert "boards within 1 %, and the board is" in as_held(sentence, recorded(BOARD, 4))


@pytest.mark.parametrize("unit", ["cm", "inches"])  # 2370 "m" is refused as millimetres
def test_another_unit_is_asked_about_with_what_the_lengths_would_be(unit: str) -> None:
    question = question_about_units(*in_unit(unit))
    assert f"2.37 and 0.87 m if they are in {unit}" in question
    assert "Are these lengths in metres?" in question


def test_each_length_and_the_depth_is_enough() -> None:
    far = Pose(RIG.R, 8 * RIG.T)
    assert question_about_units(DATA.changed(baseline_m=49.0), None) == ""
    assert question_about_units(DATA.changed(baseline_m=51.0), None)
    assert question_about_units(DATA.changed(target_distance_m=21.0), None)
    assert question_about_units(DATA, far)  # up to 80 m away


def test_a_board_no_arm_holds_is_asked_about_at_any_distance() -> None:
    """Squares in centimetres typed as metres, the baseline being free."""
    true, typed = (RigidObject.of_board(BoardPattern(4, 3, side)) for side in (0.01, 1.0))
    assert question_about_units(recorded(true, 4), RIG) == ""
    assert "if they are in cm" in question_about_units(recorded(true, 4, stated=typed), None)
