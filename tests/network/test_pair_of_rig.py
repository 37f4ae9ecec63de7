"""The refined set of a pair of a rig is the rig's, and so are its errors."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.network.calibrate import calibrate_rig
from stereocal.network.pair_of_rig import data_of_pair, sets_of_pairs, settings_of_pair
from stereocal.network.rig_file import RigFile, rig_file
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.two_views import BAR, shared_unknowns
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording
from stereocal.simulation.rigs import simulated_rig

PAIRS = [("c1", "c2"), ("c2", "c3"), ("c3", "c1")]


@cache
def rig_of(seed: int) -> tuple[Recording, RigFile]:
    truth = simulated_rig(np.random.default_rng(seed), 3, 120)
    recording = truth.recording
    recording.points[recording.frame == 11] += [30.0, 0.0]
    return recording, rig_file(calibrate_rig(recording, truth.settings))


def refined_of(pair: CameraPair) -> tuple[RefinedResult, RefineSettings]:
    recording, rig = rig_of(5)
    dataset = data_of_pair(recording, pair, rig)
    settings = settings_of_pair(dataset, pair, rig)
    return refine(dataset, settings), settings


def values_of(rig: RigFile, pair: CameraPair) -> np.ndarray:
    own = rig.pair(*pair)
    values = shared_unknowns(own)
    values[BAR] = rig.q[-1]
    return values


@pytest.mark.parametrize("pair", PAIRS)
def test_the_refined_set_of_a_pair_is_the_rigs(pair: CameraPair) -> None:
    _, rig = rig_of(5)
    found, _ = refined_of(pair)
    assert found.q == pytest.approx(values_of(rig, pair), rel=1e-9, abs=1e-12)
    stated = (rig.pair(*pair).uncertainties or {})["covariance"]["matrix"]
    own = found.covariance[: len(stated), : len(stated)]
    sigmas = np.sqrt(np.diag(stated))
    unit = np.where(sigmas > 0.0, sigmas, 1.0)
    assert own / np.outer(unit, unit) == pytest.approx(stated / np.outer(unit, unit), abs=1e-5)
    assert found.settings.from_json(found.settings.to_json()) == found.settings


def test_its_images_are_not_counted_twice() -> None:
    """Without the pair's images the rest of the rig knows less than with them, and what is left
    agrees with them within its errors."""
    recording, rig = rig_of(5)
    pair = ("c1", "c3")
    found, settings = refined_of(pair)
    rest = settings.rest
    assert rest is not None
    whole, without = found.p_covariance, np.linalg.inv(found.unknowns.precision)
    # The baseline's is as stated in both, to rounding: 1e-9 of it was measured.
    assert (np.diag(without) > (1.0 - 1e-6) * np.diag(whole)).all()
    assert np.median(np.diag(without) / np.diag(whole)) > 1.1
    away = np.linalg.pinv(found.unknowns.M) @ (found.q - np.array(rest.mean))
    # of a prior that counts the images twice this is near 0; of an independent one it is the
    # chi-square of the difference, of as many degrees of freedom as there are parameters
    C = without - whole
    values, V = np.linalg.eigh(C / np.outer(*2 * [np.sqrt(np.diag(without))]))
    keep = values > 1e-3
    moved = (V.T @ (away / np.sqrt(np.diag(without))))[keep]
    assert 0.2 < np.sum(np.square(moved) / values[keep]) / keep.sum() < 4.0
    # A frame that is left out of the pair moves it, by less than an error.
    fewer = data_of_pair(recording, pair, rig)
    again = refine(fewer.of_frames(fewer.correspondences.frames[3:]), settings)
    moved = (again.q - found.q)[:6] / np.sqrt(np.diag(found.covariance))[:6]
    assert 0.0 < np.abs(moved).max() < 1.0


def test_the_sets_of_all_pairs() -> None:
    recording, rig = rig_of(5)
    sets, notes = sets_of_pairs(recording, rig)
    assert not notes and len(sets) == 3
    for name, own in sets.items():
        found = RigParameters.loads(own["refined"].dumps())
        assert found.camera_names == tuple(name.split("-"))
        assert 11 in found.frames_left_out
        pose = rig.pair(*found.camera_names).pose
        assert Rotation.from_matrix(found.pose.R @ pose.R.T).magnitude() < 1e-9
        assert pytest.approx(pose.T, abs=1e-9) == found.pose.T
