"""Runs of frames whose errors are alike."""

import numpy as np
import pytest

from stereocal.rig.clusters import FEWEST, clusters_of
from stereocal.system.array_types import FloatArray


def residuals(frames: int, length: int, rng: np.random.Generator) -> FloatArray:
    """(frames, 2): half of their variance stays for runs of so many frames."""
    run = (np.arange(frames) + rng.integers(length)) // length
    shared = rng.standard_normal((run.max() + 1, 2))[run]
    return np.asarray(np.sqrt(0.5) * (shared + rng.standard_normal((frames, 2))))


@pytest.mark.parametrize("length", [10, 40])
def test_the_length_of_runs_is_found(length: int) -> None:
    rng = np.random.default_rng(length)
    found = [clusters_of(np.arange(400), residuals(400, length, rng)).length for _ in range(60)]
    # Measured: medians 10 and 39, half of all within 10 and 25 %.
    assert np.median(found) == pytest.approx(length, rel=0.15)
    assert np.mean(np.abs(np.log(np.array(found) / length)) < np.log(1.5)) > 0.6


@pytest.mark.parametrize("frames", [25, 100, 400])
def test_independent_frames_with_consecutive_numbers_are_clusters_of_one(frames: int) -> None:
    rng = np.random.default_rng(frames)
    found = [
        clusters_of(np.arange(frames), rng.standard_normal((frames, 2))).has_runs
        for _ in range(300)
    ]
    assert np.mean(found) < 0.03  # stated: 1 in 100; of 300, three standard errors above that


def test_gaps_cut_runs() -> None:
    rng = np.random.default_rng(3)
    alike = np.repeat(rng.standard_normal((40, 2)), 10, axis=0)
    times = np.arange(400) + 100 * (np.arange(400) >= 205)
    found = clusters_of(times, alike)
    assert found.length == pytest.approx(10, abs=3)
    assert found.of_frames[204] < found.of_frames[205]
    # No run is longer in time than twice the length of likeness.
    spans = [np.ptp(times[found.of_frames == number]) for number in range(found.count)]
    assert max(spans) < 2 * found.length
    assert found.text == f"400 frames, about {found.count} independent ones"


def test_few_frames_keep_several_runs() -> None:
    alike = np.repeat(np.random.default_rng(7).standard_normal((2, 2)), 30, axis=0)
    assert clusters_of(np.arange(60), alike).count >= FEWEST
