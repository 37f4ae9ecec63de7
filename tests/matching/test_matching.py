"""Matching: the right pairs, the least total cost, and what is said of each pair."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.matching.matching import assign, match_points, purpose_warning, refuse_different_rigs
from stereocal.matching.pair_candidates import pairs_within
from stereocal.rig.camera import pixel_scales
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import ANGLES, BASELINE_M, PRIMARY, RIG, SECONDARY, SEEDS, images

RIG_2D = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, matching_threshold_px=0.8)


def cloud(points: int, seed: int, noise_px: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Images of random points in the common view, in the same order."""
    rng = np.random.default_rng(seed)
    first, second = images(rng.uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5], (points, 3)))
    return (
        first + noise_px * rng.standard_normal(first.shape),
        second + noise_px * rng.standard_normal(second.shape),
    )


def candidates(
    seed: int, rows: int, columns: int, threshold: float
) -> tuple[FloatArray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A table of costs, and its entries within the threshold as lists."""
    cost = np.random.default_rng(seed).uniform(0.0, 2.0, (rows, columns))
    i, j = np.nonzero(cost <= threshold)
    return cost, (i, j, cost[i, j])


class TestAssignment:
    @given(SEEDS, st.integers(1, 4), st.integers(1, 4), st.floats(0.2, 1.8))
    @settings(max_examples=60)
    def test_the_least_total_cost_of_all_assignments(
        self, seed: int, rows: int, columns: int, threshold: float
    ) -> None:
        """Against every assignment there is, with a pair left out costing the threshold."""
        cost, found = candidates(seed, rows, columns, threshold)
        kept = assign(*found, threshold)
        total = found[2][kept].sum() + threshold * (min(rows, columns) - len(kept))
        capped = np.minimum(cost, threshold)
        flat = capped if rows <= columns else capped.T
        best = min(
            flat[range(len(flat)), list(order)].sum()
            for order in itertools.permutations(range(flat.shape[1]), len(flat))
        )
        assert total == pytest.approx(best, abs=1e-12)
        assert len(set(found[0][kept])) == len(set(found[1][kept])) == len(kept)

    def test_a_pair_at_the_gate_is_taken(self) -> None:
        zero = np.zeros(2, dtype=np.int64)
        assert len(assign(zero[:1], zero[:1], np.array([1.0]), 1.0)) == 1
        assert len(assign(np.array([0, 1]), zero, np.array([1.0, 1.0]), 1.0)) == 1


class TestCandidates:
    def test_errors_and_runners_up_are_those_of_all_pairs(self) -> None:
        first, second = cloud(40, 1, noise_px=0.5)
        second = second[:31]
        i, j = (each.ravel() for each in np.indices((40, 31)))
        table = RIG_2D.reprojection_errors(first[i], second[j]).mean(axis=1).reshape(40, 31)
        row, column, errors, of_first, of_second = pairs_within(
            RIG.R,
            RIG.T,
            PRIMARY.undistort(first),
            SECONDARY.undistort(second),
            pixel_scales((PRIMARY, SECONDARY)),
            20.0,
            0.0,
            np.inf,
        )
        expected = np.nonzero(table <= 20.0)
        np.testing.assert_array_equal((row, column), expected)
        # Sums in another order; measured: 3e-13 px.
        np.testing.assert_allclose(errors, table[expected], rtol=0, atol=1e-9)
        filled = np.where(np.isnan(table), np.inf, table)
        np.testing.assert_allclose(of_first, np.sort(filled, axis=1)[:, :2], atol=1e-9)
        np.testing.assert_allclose(of_second, np.sort(filled, axis=0)[:2].T, atol=1e-9)

    @pytest.mark.parametrize("sides", [(0, 5), (5, 0), (0, 0), (1, 1)])
    def test_few_points_or_none(self, sides: tuple[int, int]) -> None:
        first, second = cloud(5, 3)
        found = match_points(RIG_2D, first[: sides[0]], second[: sides[1]])
        assert len(found) == min(sides)
        assert np.isnan(found.runner_up_px).all()
        assert not found.ambiguous.any()


class TestMatches:
    @given(SEEDS)
    @settings(max_examples=20)
    def test_exact_points_find_their_partners_in_any_order(self, seed: int) -> None:
        first, second = cloud(25, seed)
        order = np.random.default_rng(seed).permutation(25)
        found = match_points(RIG_2D, first, second[order], 1e-6)
        np.testing.assert_array_equal(order[found.secondary], np.arange(25))
        assert found.error_px.max() < 1e-8
        assert not found.ambiguous.any()

    def test_noisy_points_with_missing_ones(self) -> None:
        first, second = cloud(60, 5, noise_px=0.2)
        found = match_points(RIG_2D, first[10:], second[:50])
        # Ten points on each side have no partner, and some of them find a wrong one.
        assert (found.primary + 10 == found.secondary).sum() >= 32  # of 40; measured: 34
        unsure = found.runner_up_px <= 0.8
        np.testing.assert_array_equal(found.ambiguous, unsure)
        assert 0 < unsure.sum() < len(found)

    def test_depth_is_a_second_gate(self) -> None:
        first, second = cloud(50, 7)
        depth = RIG_2D.reconstruct(first, second)[:, 2]
        found = match_points(RIG_2D, first, second, 1e-6, (7.0, 8.0))
        np.testing.assert_array_equal(found.primary, np.flatnonzero((depth >= 7) & (depth <= 8)))

    def test_the_threshold_is_the_files_own_or_the_one_given(self) -> None:
        first, second = cloud(30, 8, noise_px=0.3)
        own = match_points(RIG_2D, first, second)
        same = match_points(replace(RIG_2D, matching_threshold_px=None), first, second, 0.8)
        np.testing.assert_array_equal(own.secondary, same.secondary)
        with refused("threshold"):
            match_points(replace(RIG_2D, matching_threshold_px=None), first, second)


class TestPurposeAndRig:
    def test_the_wrong_purpose_is_a_sentence(self) -> None:
        measuring = replace(RIG_2D, method="3d")
        both = replace(RIG_2D, method="imported")
        assert "3D set" in (purpose_warning(measuring, "matching") or "")
        assert "2D set" in (purpose_warning(RIG_2D, "reconstruction") or "")
        assert purpose_warning(RIG_2D, "matching") is None
        assert purpose_warning(measuring, "reconstruction") is None
        assert purpose_warning(both, "matching") is purpose_warning(both, "reconstruction") is None

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"primary": SECONDARY}, ("1600x1200", "1280x1024")),
            ({"primary": replace(PRIMARY, K=PRIMARY.K * [[1.2], [1.2], [1]])}, ("focal",)),
            ({"pose": Pose.from_angles(ANGLES, 3.0)}, ("2.37 m", "3 m")),
            ({"pose": Pose.from_angles(ANGLES._replace(yaw=0.5), BASELINE_M)}, ("14.9 degrees",)),
            ({"pose": Pose.from_angles(ANGLES._replace(epsilon=2.8), BASELINE_M)}, ("degrees",)),
        ],
    )
    def test_other_rigs_are_refused(self, change: dict[str, object], said: tuple[str, ...]) -> None:
        with refused("rigs", *said):
            refuse_different_rigs(RIG_2D, replace(RIG_2D, **change))  # type: ignore[arg-type]

    def test_sets_of_one_recording_accuse_its_lengths_and_not_another_rig(self) -> None:
        one = replace(RIG_2D, inputs={"sha256": "ab"})
        other = replace(one, pose=Pose.from_angles(ANGLES._replace(yaw=0.5), BASELINE_M))
        with refused("recording", "14.9 degrees", "lens"):
            refuse_different_rigs(one, other)
