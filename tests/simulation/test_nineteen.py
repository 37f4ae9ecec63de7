"""The nineteen synthetic data sets: are they what `sample_data/README.md` says?"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.formats.dataset_files import read_dataset
from stereocal.simulation.nineteen import (
    BAR_SIGMA_M,
    BARS_M,
    BASELINE_SIGMA_M,
    BASELINES_M,
    simulate_nineteen,
)

SHIPPED = Path(__file__).parents[2] / "sample_data" / "nineteen"


def test_shipped_ones_are_what_the_code_makes() -> None:
    """To the last printed digit of a pixel; another processor may round 0.0005 px otherwise."""
    made = simulate_nineteen(0)
    folders = sorted(SHIPPED.iterdir())
    assert [folder.name for folder in folders] == [f"{i:02d}" for i in range(1, 20)]
    for folder, (scene, dataset) in zip(folders, made, strict=True):
        shipped, truth = read_dataset(folder), json.loads((folder / "truth.json").read_text())
        rows, again = shipped.correspondences, dataset.correspondences
        assert np.abs(rows.primary - again.primary).max() < 1.1e-3
        assert np.abs(rows.secondary - again.secondary).max() < 1.1e-3
        assert shipped.primary.to_json() == dataset.primary.to_json()
        assert shipped.secondary.to_json() == dataset.secondary.to_json()
        assert shipped.baseline_m == dataset.baseline_m
        assert shipped.target_distance_m == dataset.target_distance_m
        assert (shipped.baseline_sigma_m, shipped.target_distance_sigma_m) == (0.005, 0.0005)
        assert truth["T"] == pytest.approx(scene.rig.pose.T.tolist(), abs=1e-9)
        assert truth["target_distance_m"] == pytest.approx(scene.bar_length_m, abs=1e-12)


def test_lengths_span_the_papers_ranges_with_the_errors_of_a_range_finder() -> None:
    made = simulate_nineteen(0)
    for at, (read, limits) in enumerate(
        (
            ([d.baseline_m for _, d in made], BASELINES_M),
            ([d.target_distance_m for _, d in made], BARS_M),
        )
    ):
        assert (min(read), max(read)) == limits
        assert len(set(read)) == 19
        assert read == [round(length, 3) for length in read]
        true = [(s.rig.pose.baseline, s.bar_length_m)[at] for s, _ in made]
        sigma = (BASELINE_SIGMA_M, BAR_SIGMA_M)[at]
        # 19 errors of unit size: their standard deviation is 1 +- 0.17.
        assert 0.5 < np.std((np.array(read) - true) / sigma) < 1.5


@pytest.mark.parametrize("seed", range(5))
def test_lenses_are_off_as_a_lab_leaves_them_and_the_same_everywhere(seed: int) -> None:
    made = simulate_nineteen(seed, datasets=3, frames=4)
    for side in ("primary", "secondary"):
        true, given = getattr(made[0][0].rig, side), getattr(made[0][1], side)
        focal = given.K[[0, 1], [0, 1]] / true.K[[0, 1], [0, 1]] - 1
        assert (np.abs(focal) > 0.00099).all()
        assert (np.abs(focal) < 0.00301).all()
        assert 2.98 < np.hypot(*(given.K - true.K)[:2, 2]) < 5.02
        assert all(getattr(d, side).to_json() == given.to_json() for _, d in made)
    assert made[0][1].primary.to_json() != made[0][1].secondary.to_json()
