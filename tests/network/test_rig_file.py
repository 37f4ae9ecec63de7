"""rig.json, the files of its pairs, and pairs that are fused from their files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.figures.rig_report import camera_table
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.fuse_files import fuse_files
from stereocal.network.in_words import rig_notes, rig_sentence
from stereocal.network.result import RigCalibration
from stereocal.network.rig_file import RigFile, rig_file
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import refine
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.refined.views import EACH, TRANSLATION
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.tracks import MeasuredOffset
from stereocal.simulation.rigs import LENS_ERRORS, SimulatedRig, simulated_rig

STATED = LensPrior(*LENS_ERRORS)
PAIR_SETTINGS = RefineSettings(STATED, STATED)


@pytest.fixture(scope="module")
def truth() -> SimulatedRig:
    return simulated_rig(np.random.default_rng(20), 3, 150)


@pytest.fixture(scope="module")
def rig(truth: SimulatedRig) -> RigCalibration:
    return calibrate_rig(truth.recording, truth.settings)


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


def test_a_length_in_metres_has_the_error_of_the_object(truth: SimulatedRig) -> None:
    """Known to 0.1 % if nothing is stated, 0.5 % if it is: 1.96 of that and the scatter."""
    told = []
    for sigma in (None, 0.005):
        settings = replace(truth.settings, object_sigma=sigma)
        bare = replace(truth.recording, object=replace(truth.recording.object, sigma_m=None))
        file = rig_file(calibrate_rig(bare, settings))
        figures = file.about.figures
        assert figures is not None and figures.metric_error_p95 is not None
        scatter = figures.to_expect.length_error_p95
        assert scatter is not None
        own = figures.metric_error_p95**2 - scatter**2
        # Nothing else has the scale: no baseline is stated.
        assert np.sqrt(own) == pytest.approx(1.96 * (sigma or 0.001), rel=0.02)
        told.append(rig_sentence(RigFile.loads(file.dumps())))
    assert "most of it scatter" in told[0]
    assert "most of it from the" in told[1] and "± 0.5 %" in told[1]


def test_a_camera_without_points_that_two_others_see_is_in_the_table(rig: RigCalibration) -> None:
    file = rig_file(rig)
    unknown = dict.fromkeys(rig.names[:1])
    file = replace(file, about=replace(file.about, image_errors_px=unknown))
    assert camera_table(file)["image error, px"].tolist() == ["unknown"] * 3


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
    with pytest.raises(StereocalError, match=r"^rig\.json: A camera cannot be called '\.\./c1'"):
        RigFile.loads(json.dumps(content).replace('"c1"', '"../c1"'), "rig.json")


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
    alone = refine(with_baseline_found(truth.recording.pair(*pair)), PAIR_SETTINGS)
    assert (sigma < np.sqrt(np.diag(alone.covariance))[:6]).all()


@pytest.fixture(scope="module")
def files(truth: SimulatedRig, tmp_path_factory: pytest.TempPathFactory) -> dict[CameraPair, Path]:
    folder = tmp_path_factory.mktemp("pairs")
    return {pair: file_of(truth.recording, pair, folder) for pair in truth.recording.pairs}


def file_of(recording: Recording, pair: CameraPair, folder: Path, length: float = 1.0) -> Path:
    """The refined file of a pair, perhaps with a wrong length of the object."""
    wand = replace(recording.object, points=length * recording.object.points)
    own = replace(recording, object=wand).of_cameras([*pair])
    fit = refine(with_baseline_found(replace(own, name="").pair(*pair)), PAIR_SETTINGS)
    refined_parameters(fit).save(folder / f"{'-'.join(pair)}.json")
    return folder / f"{'-'.join(pair)}.json"


def test_files_of_pairs_are_fused(truth: SimulatedRig, files: dict[CameraPair, Path]) -> None:
    fused = fuse_files([*files.values()])
    assert not fused.about.warnings
    for number, name in enumerate(fused.names[1:], 1):
        at = EACH * number + TRANSLATION
        sigma = np.sqrt(np.diag(fused.covariance))[at : at + 3]
        # the points of three pairs are counted twice, so that errors are stated too small
        assert np.abs((fused.poses[name].T - truth.poses[name].T) / sigma).max() < 5.0


def test_fused_pairs_keep_the_counts_of_their_cameras(
    files: dict[CameraPair, Path], tmp_path: Path
) -> None:
    def fused_from(starts: dict[CameraPair, int]) -> RigFile:
        for (one, other), start in starts.items():
            of_third = (other == "c3") - (one == "c3")
            drift = of_third * 2e-5
            late = MeasuredOffset(0.3 * of_third, drift, 4000.0, 0.01, 1e-6 * bool(drift))
            read = RigParameters.load(files[one, other])
            own = replace(read, start_frame=start, time_offset=late)
            own.save(tmp_path / f"{one}-{other}.json")
        fused = fuse_files(sorted(tmp_path.glob("*.json")))
        return RigFile.loads(fused.dumps())

    fused = fused_from({("c1", "c2"): 40, ("c2", "c3"): 17, ("c1", "c3"): 57})
    assert fused.start_frames == {"c1": 0, "c2": 40, "c3": 57}
    pair = fused.pair("c2", "c3")
    assert pair.start_frame == 17 and pair.time_offset is not None
    assert pair.time_offset.frames == pytest.approx(0.3)
    assert 0.005 < pair.time_offset.sigma <= 0.01
    assert pair.time_offset.drift == pytest.approx(2e-5)
    assert 0.5e-6 < pair.time_offset.drift_sigma < 1.5e-6
    assert fused.pair("c1", "c2").time_offset is None
    assert not fused.about.warnings
    anew = fused_from({("c1", "c3"): 900})
    assert not any(anew.start_frames.values()) and anew.about.warnings


def test_wrong_lengths_are_named_if_one_file_has_them(
    truth: SimulatedRig, files: dict[CameraPair, Path], tmp_path: Path
) -> None:
    one = {("c1", "c3"): file_of(truth.recording, ("c1", "c3"), tmp_path, 1.02)}
    fused = fuse_files([*(files | one).values()])
    (warning,) = fused.about.warnings
    assert "c1-c3" in warning and "shorter" in warning
    assert warning in rig_notes(fused)
    two = one | {("c1", "c2"): file_of(truth.recording, ("c1", "c2"), tmp_path, 0.97)}
    (warning,) = fuse_files([*(files | two).values()]).about.warnings
    assert "cannot be told which is wrong" in warning


def test_files_that_do_not_connect(files: dict[CameraPair, Path], tmp_path: Path) -> None:
    other = simulated_rig(np.random.default_rng(21), 2, 60).recording
    cameras = dict(zip(("d0", "d1"), other.cameras.values(), strict=True))
    apart = file_of(replace(other, cameras=cameras), ("d0", "d1"), tmp_path)
    one = files["c1", "c2"]
    with pytest.raises(StereocalError, match="No file connects d0, d1 with c1, c2"):
        fuse_files([one, apart])
    content = json.loads(one.read_text())
    del content["camera_names"]
    (tmp_path / "nameless.json").write_text(json.dumps(content))
    with pytest.raises(StereocalError, match="does not name its cameras"):
        fuse_files([tmp_path / "nameless.json"])
