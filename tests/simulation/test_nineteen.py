"""The nineteen synthetic data sets: are they what `sample_data/README.md` says?"""

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.formats.dataset_files import read_dataset
from stereocal.simulation.nineteen import simulate_nineteen

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
