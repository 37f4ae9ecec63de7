"""The refined set of a pair of a rig is the rig's, and so are its errors."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.fit.least_squares.small_steps import FACTOR, rig_at, step_between
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.parameter_file import of_file
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.rig_file import RigFile
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording
from stereocal.simulation.rigs import simulated_rig
from stereocal.workflow.pair_of_rig import data_of_pair, settings_of_pair
from stereocal.workflow.run import Run

PAIRS = [("c1", "c2"), ("c2", "c3"), ("c3", "c1")]


@cache
def run_of(seed: int) -> Run:
    truth = simulated_rig(np.random.default_rng(seed), 3, 120)
    truth.recording.points[truth.recording.frame == 11] += [30.0, 0.0]
    return Run(truth.recording, truth.settings)


def rig_of(seed: int) -> tuple[Recording, RigFile]:
    run = run_of(seed)
    return run.recording, run.bare_rig


def refined_of(pair: CameraPair) -> tuple[RefinedResult, RefineSettings]:
    recording, rig = rig_of(5)
    dataset = data_of_pair(recording, pair, rig)
    settings = settings_of_pair(dataset, pair, rig)
    return refine(dataset, settings), settings


@pytest.mark.parametrize("pair", PAIRS)
def test_the_refined_set_of_a_pair_is_the_rigs(pair: CameraPair) -> None:
    _, rig = rig_of(5)
    found, _ = refined_of(pair)
    of_rig = rig.pair(*pair)
    assert step_between(found.at, rig_at(of_rig))[:FACTOR] == pytest.approx(0.0, abs=1e-9)
    assert found.bar_factor == pytest.approx(rig.q[FACTOR], rel=1e-12)
    stated = (of_rig.uncertainties or {})["covariance"]["matrix"]
    own = of_file(found.covariance, found.pose)[: len(stated), : len(stated)]
    sigmas = np.sqrt(np.diag(stated))
    unit = np.where(sigmas > 0.0, sigmas, 1.0)
    assert own / np.outer(unit, unit) == pytest.approx(stated / np.outer(unit, unit), abs=1e-5)
    kept = found.settings.to_json()
    assert found.settings.from_json(kept) == found.settings
    assert found.settings.from_json({**kept, "rest": None}) == found.settings


def test_without_some_frames_it_is_that_of_the_other_images() -> None:
    """Halves of the frames of a pair, whose images the rest of the rig does not lack."""
    recording, rig = rig_of(5)
    dataset = data_of_pair(recording, pair := ("c1", "c3"), rig)
    settings = settings_of_pair(dataset, pair, rig)
    whole, rows = refine(dataset, settings), dataset.correspondences
    halves = [refine(dataset, settings, rows=rows.frame % 2 == k) for k in (0, 1)]
    sigma = np.sqrt(np.diag(whole.p_covariance))
    steps = [to_free(whole) @ step_between(half.at, whole.at) for half in halves]
    for half, step in zip(halves, steps, strict=True):
        assert (np.sqrt(np.diag(half.p_covariance)) > (1.0 - 1e-6) * sigma).all()
        assert 0.0 < np.abs(step / sigma).max() < 4.0
    # Each half moves it, the other way, by about as much.
    assert steps[0] @ steps[1] < 0.0


def to_free(found: RefinedResult) -> np.ndarray:
    return np.asarray(np.linalg.pinv(found.unknowns.M))


def test_the_sets_of_all_pairs() -> None:
    run = run_of(5)
    rig = run.bare_rig
    assert not run.notes_on_pairs and len(run.sets) == 3
    for name, own in run.sets.items():
        found = RigParameters.loads(own["refined"].dumps())
        assert found.camera_names == tuple(name.split("-"))
        assert 11 in found.frames_left_out
        pose = rig.pair(*found.camera_names).pose
        assert Rotation.from_matrix(found.pose.R @ pose.R.T).magnitude() < 1e-9
        assert pytest.approx(pose.T, abs=1e-9) == found.pose.T
