"""Each sentence about a data set as a whole, and that sound data hear none."""

from dataclasses import replace

import numpy as np
import pytest

from stereocal.calibration.checks import (
    check_enough_points,
    check_in_front,
    scale_is_plausible,
    warnings_about,
)
from stereocal.calibration.montecarlo import reconstruction_problem
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import BAR_M, PRIMARY, RIG, SECONDARY, correspondences, dataset

SOUND = dataset(20, noise_px=0.3)


def with_points(primary: FloatArray, secondary: FloatArray) -> Pair:
    rows = SOUND.correspondences
    return SOUND.changed(correspondences=replace(rows, primary=primary, secondary=secondary))


def test_sound_data_hear_nothing() -> None:
    check_enough_points(SOUND)
    check_in_front(SOUND, RIG)
    assert scale_is_plausible(SOUND, RIG)
    assert warnings_about(SOUND) == []
    assert calibrate(SOUND).warnings == ()


class TestPoints:
    def test_fewer_than_five_pairs(self) -> None:
        few = SOUND.of_frames([1, 2])
        with refused("4 pairs", " 5 ", "40"):
            check_enough_points(few)
        with refused("4 pairs", " 5 ", "40"):
            calibrate(few)
        rows = SOUND.correspondences
        one = SOUND.where(np.arange(len(rows)) == 3)
        with refused("1 pair", " 5 ", "40"):
            check_enough_points(one)
        five = SOUND.where(np.arange(len(rows)) < 5)
        check_enough_points(five)

    @pytest.mark.parametrize("which", ["primary", "secondary"])
    def test_all_in_one_place(self, which: str) -> None:
        """Within 1 % of the diagonal, which is 20 px in the primary and 16 in the secondary."""
        n = len(SOUND.correspondences)
        diagonal = {"primary": 2000.0, "secondary": 1639.2}[which]
        for fraction, near in ((0.009, True), (0.011, False)):
            side = fraction * diagonal / np.sqrt(2)
            points = {
                "primary": np.array(SOUND.correspondences.primary),
                "secondary": np.array(SOUND.correspondences.secondary),
            }
            points[which] = 500.0 + np.linspace(0, side, n)[:, None] * np.ones(2)
            data = with_points(**points)
            if near:
                with refused(f"{which} camera", f"{fraction * diagonal:.1f} px"):
                    check_enough_points(data)
            else:
                check_enough_points(data)


class TestScale:
    @pytest.mark.parametrize(
        ("factor", "unit", "said"),
        [
            (1 / 1000, "millimetres", "the distance is 1000 times"),
            (1 / 100, "centimetres", "the distance is 100 times"),
            (100, "centimetres", "the baseline is 100 times"),
            (1000, "millimetres", "the baseline is 1000 times"),
        ],
    )
    def test_a_wrong_unit_is_named(self, factor: float, unit: str, said: str) -> None:
        data = SOUND.changed(target_distance_m=min(BAR_M * factor, 999.0))
        with refused(unit, said):
            calibrate(data)


class TestExchangedTargets:
    """A bar longer than the baseline along it: A's ray and B's then meet behind the cameras."""

    pose = Pose.from_angles(Angles(0.05, -0.07, 0.11, 0.13, 3.02), 0.4)

    def data(self, exchanged: int | None) -> Pair:
        rng = np.random.default_rng(3)
        middle = rng.uniform([-0.8, -0.7, 5.0], [0.8, 0.7, 8.0], (15, 3))
        along = rng.normal(0, [0.5, 0.4, 0.3], (15, 3))
        along[6] = 1.0, 0.1, 0.0
        along *= BAR_M / 2 / np.linalg.norm(along, axis=1, keepdims=True)
        points = np.stack([middle - along, middle + along], axis=1).reshape(-1, 3)
        primary, secondary = PRIMARY.project(points), SECONDARY.project(self.pose.apply(points))
        if exchanged is not None:
            a = 2 * exchanged
            secondary[[a, a + 1]] = secondary[[a + 1, a]]
        rows = Correspondences.from_arrays(
            np.repeat(np.arange(15), 2), ["A", "B"] * 15, primary, secondary
        )
        known = Recording.of_two("short", PRIMARY, SECONDARY, 0.4, BAR_M)
        return known.holding(rows).pair(*CAMERAS)

    def test_in_one_frame(self) -> None:
        check_in_front(self.data(None), self.pose)
        with refused("1 of 30 pairs", "frame 6, target A"):
            check_in_front(self.data(6), self.pose)


def test_no_bars_for_the_3d_method() -> None:
    rows = SOUND.correspondences
    only_A = SOUND.where(np.array(rows.target) == 0)
    with refused("A and B", "3D"):
        reconstruction_problem(only_A)
    with refused("A and B", "3D"):
        calibrate(only_A)
    assert scale_is_plausible(only_A, RIG)


@pytest.mark.parametrize("frames", [1, 4, 5])
def test_few_bars(frames: int) -> None:
    rows = correspondences(8, noise_px=0.3)
    keep = (np.array(rows.frame) <= frames) | (np.array(rows.target) == 0)
    said = warnings_about(SOUND.changed(correspondences=rows.where(keep)))
    expected = {1: ["Only 1 frame has both"], 4: ["Only 4 frames have both"], 5: []}[frames]
    assert len(said) == len(expected)
    assert all(text.startswith(start) for text, start in zip(said, expected, strict=True))


def test_a_principal_point_far_from_the_middle_is_named() -> None:
    K = PRIMARY.K.copy()
    K[:2, 2] *= 0.5
    said = warnings_about(SOUND.changed(primary=replace(PRIMARY, K=K)))
    assert len(said) == 1
    assert "primary camera's principal point" in said[0]
    assert "1600x1200" in said[0]
