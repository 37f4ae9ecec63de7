"""rig.json, the files of its pairs, and pairs that are fused from their files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.network.calibrate import calibrate_rig, of_cameras
from stereocal.network.fuse_files import fuse_files
from stereocal.network.in_words import rig_notes, rig_sentence
from stereocal.network.result import RigCalibration
from stereocal.network.rig_file import RigFile, rig_file
from stereocal.network.unknowns import RigSettings
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import refine
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.refined.views import EACH, TRANSLATION
from stereocal.rig.recording import Recording
from stereocal.simulation.several import LENS_ERRORS, SimulatedRig, simulated_rig

STATED = LensPrior(*LENS_ERRORS)


@pytest.fixture(scope="module")
def truth() -> SimulatedRig:
    return simulated_rig(np.random.default_rng(20), 3, 150)


@pytest.fixture(scope="module")
def rig(truth: SimulatedRig) -> RigCalibration:
    settings = RigSettings(lenses=dict.fromkeys(truth.cameras, STATED))
    return calibrate_rig(truth.recording, settings)


def test_the_file_reads_back(rig: RigCalibration) -> None:
    written = rig_file(rig)
    read = RigFile.loads(written.dumps())
    assert read.names == ["c1", "c2", "c3"]
    for name in read.names:
        assert np.array_equal(read.poses[name].R, rig.poses[name].R)
        assert np.array_equal(read.cameras[name].K, rig.cameras[name].K)
    assert np.array_equal(read.covariance, rig.covariance)
    assert rig_sentence(read) == rig_sentence(written)
    assert read.to_json() | {"created": 0} == written.to_json() | {"created": 0}


def test_damaged_files_are_refused(rig: RigCalibration) -> None:
    content = rig_file(rig).to_json()
    for change, message in (
        ({"format": "other"}, "format"),
        ({"covariance": [[1.0]]}, "covariance"),
        ({"noise_px": "x"}, "damaged"),
        ({"cameras": {"c1": content["cameras"]["c1"]}}, "belong together"),
    ):
        with pytest.raises(StereocalError, match=message):
            RigFile.loads(json.dumps({**content, **change}), "rig.json")


def test_a_pair_of_the_rig_is_nearer_to_the_truth_than_by_itself(
    truth: SimulatedRig, rig: RigCalibration
) -> None:
    pair = ("c2", "c3")
    own = rig_file(rig).pair(*pair)
    true = truth.poses["c3"] @ truth.poses["c2"].inverse()
    assert own.camera_names == pair
    assert own.uncertainties is not None
    sigma = np.sqrt(np.diag(own.uncertainties["covariance"]["matrix"]))[:6]
    error = np.array([*own.pose.angles, own.pose.baseline])
    error -= np.array([*true.angles, true.baseline])
    assert np.sqrt(np.mean(np.square(error / sigma))) < 2.0
    alone = refine(with_baseline_found(truth.recording.pair(*pair)), RefineSettings(STATED, STATED))
    assert (sigma < np.sqrt(np.diag(alone.covariance))[:6]).all()


def files_of(
    recording: Recording, folder: Path, lengths: dict[tuple[str, str], float] | None = None
) -> list[Path]:
    """Refined files of all pairs; with the wrong length of the object in some."""
    files = []
    for pair in recording.pairs:
        factor = (lengths or {}).get(pair, 1.0)
        wand = replace(recording.object, points=factor * recording.object.points)
        own = of_cameras(replace(recording, object=wand), [*pair])
        dataset = with_baseline_found(replace(own, name="").pair(*pair))
        fit = refine(dataset, RefineSettings(STATED, STATED))
        files.append(folder / f"{'-'.join(pair)}.json")
        refined_parameters(fit).save(files[-1])
    return files


def test_files_of_pairs_are_fused(truth: SimulatedRig, tmp_path: Path) -> None:
    fused = fuse_files(files_of(truth.recording, tmp_path))
    assert "warnings" not in fused.about
    for name, pose in truth.poses.items():
        number = fused.names.index(name)
        at = EACH * number + TRANSLATION
        sigma = np.sqrt(np.diag(fused.covariance))[at : at + 3]
        if number:
            # the points of three pairs are counted twice, so that errors are stated too small
            assert np.abs((fused.poses[name].T - pose.T) / sigma).max() < 5.0


def test_a_wrong_length_in_one_file_is_named(truth: SimulatedRig, tmp_path: Path) -> None:
    fused = fuse_files(files_of(truth.recording, tmp_path, {("c1", "c3"): 1.02}))
    (warning,) = fused.about["warnings"]
    assert "c1-c3" in warning
    assert "shorter" in warning
    assert warning in rig_notes(fused)


def test_wrong_lengths_in_two_files_cannot_be_told(truth: SimulatedRig, tmp_path: Path) -> None:
    wrong = {("c1", "c3"): 1.02, ("c1", "c2"): 0.97}
    (warning,) = fuse_files(files_of(truth.recording, tmp_path, wrong)).about["warnings"]
    assert "cannot be told which is wrong" in warning


def test_files_that_do_not_connect(truth: SimulatedRig, tmp_path: Path) -> None:
    other = simulated_rig(np.random.default_rng(21), 2, 60)
    cameras = {f"d{number}": own for number, own in enumerate(other.recording.cameras.values())}
    one = files_of(of_cameras(truth.recording, ["c1", "c2"]), tmp_path)
    apart = files_of(replace(other.recording, cameras=cameras), tmp_path)
    with pytest.raises(StereocalError, match="No file connects d0, d1 with c1, c2"):
        fuse_files([*one, *apart])
    content = json.loads(one[0].read_text())
    del content["camera_names"]
    one[0].write_text(json.dumps(content))
    with pytest.raises(StereocalError, match="does not name its cameras"):
        fuse_files(one)
