"""The check against simulated truth: movements found, their size, repaired parameters, refusals."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.field.checking.check_words import notes, sentence, to_json
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.field.checking.prior import Prior, prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import repaired_parameters, residuals_of
from stereocal.fit.least_squares.small_steps import FACTOR, pose_places, rig_at
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.least_squares.views import Cameras
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.formats.dataset_files import read_dataset
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.simulate import lens_off_by, place_bars
from tests.refused import refused
from tests.rigs.accuracy import turned
from tests.rigs.bumps import Case, bound, bumped, cases, joined, matched, new_bars, true_fit
from tests.rigs.mistakes import turned_from
from tests.rigs.moving_bar import move_bar, record
from tests.rigs.refined_rigs import (
    BAR_M,
    DEPTHS_M,
    Misjudged,
    in_runs,
    random_rig,
    smooth_fields,
    stated,
    waved,
    waved_scene,
    with_waves,
)

COARSE = Smallest(float(np.radians(1.0)), 0.05)


@pytest.fixture
def case() -> Case:
    return next(cases(1, 41))


def test_an_unmoved_rig_is_the_same_where_it_can_be_told(case: Case) -> None:
    images = new_bars(case, case.truth)
    found = recheck(case.prior, images, COARSE)
    assert found.verdict == "same" and not found.changed and found.turn[0].low == 0
    assert sentence(found).startswith("Same: no movement is seen; a turn of one camera by 1° or")
    strict = recheck(case.prior, images)
    assert strict.verdict == "cannot tell"
    assert strict.power.baseline is not None and strict.power.baseline < 0.8
    assert sentence(strict).startswith("Cannot tell with 5 bars whether one camera turned by less ")
    assert "and none is seen" in sentence(strict)


@pytest.mark.soak
def test_false_alarms_are_rare_and_no_power_is_beyond_the_bound() -> None:
    """1,500 and 150 trials are in docs/check.md: 47 % found, where the bound is 79 %; it takes the
    lenses as their model."""
    alarms, found, expected = 0, 0, 0.0
    for case in cases(40, 42):
        alarms += recheck(case.prior, new_bars(case, case.truth)).changed
        rig = bumped(case, np.radians(0.05))
        images = new_bars(case, rig)
        found += recheck(case.prior, images).changed
        expected += bound(case, images, rig)
    assert alarms <= 3  # of 40: 4 or more have a probability of 0.0007 at 1 %
    assert 10 <= found <= expected + 7  # three standard deviations


@pytest.mark.parametrize("degrees", [0.5, 10.0])
def test_a_turn_is_found_with_its_size_and_the_pose_repaired(case: Case, degrees: float) -> None:
    rig = bumped(case, np.radians(degrees))
    images = new_bars(case, rig)
    found = recheck(case.prior, images)
    assert found.verdict == "moved" and found.pose_moved and not found.refocused
    turn = np.degrees([found.turn[0].low, found.turn[0].value, found.turn[0].high])
    true_turn = np.degrees(turned(rig.pose, case.truth.pose))
    assert turn[0] < true_turn < turn[2]
    assert turn[2] - turn[0] < 0.6
    # Four standard errors by the information bound.
    variances = np.diag(true_fit(case, images).covariance)[pose_places(1)][:3]
    assert turned(found.repaired.pose, rig.pose) < 4 * np.sqrt(variances.sum())
    assert turned(found.repaired.pose, rig.pose) < 0.5 * turned(case.truth.pose, rig.pose)
    before, after = found.held_out.px
    assert found.offers_repair and after < 0.5 * before


def test_matched_points_find_a_turn_and_keep_the_baseline(case: Case) -> None:
    rig = bumped(case, np.radians(0.3))
    found = recheck(case.prior, matched(case, rig, 50))
    assert found.verdict == "moved"
    assert found.baseline_m is None
    answer = to_json(found)
    baseline = case.prior.rig.pose.baseline
    assert answer["baseline_m"] == {"value": baseline, "low": None, "high": None}
    assert any("do not show the baseline" in note for note in notes(found))
    true_turn = turned(rig.pose, case.truth.pose)
    assert found.turn[0].low < true_turn < found.turn[0].high


def test_a_refocused_lens_is_named() -> None:
    named = moved = 0
    for case in cases(6, 43):
        lens = lens_off_by(case.truth.secondary, 0.01, (0.0, 0.0))
        found = recheck(case.prior, new_bars(case, replace(case.truth, secondary=lens)))
        assert found.verdict == "moved"
        named += found.either_lens or "secondary" in found.refocused
        moved += found.pose_moved
        if found.refocused == ("secondary",):
            change = found.focal_changes["secondary"]
            assert change.low < 0.01 < change.high
            assert sentence(found).startswith("Refocused: the focal length of the secondary is")
    assert named == 6
    assert not moved


def test_since_when(case: Case) -> None:
    rig = bumped(case, np.radians(0.3))
    before, after = (
        place_bars(each, case.rng, n, BAR_M, DEPTHS_M) for each, n in ((case.truth, 22), (rig, 18))
    )
    found = recheck(case.prior, images_of_bars(joined(case, before, after), case.prior.rig))
    assert found.since is not None
    assert found.since.low <= 23 <= found.since.high
    assert found.since.high - found.since.low <= 4
    assert "Since frame 2" in sentence(found)
    assert turned(found.repaired.pose, rig.pose) < 0.5 * turned(case.truth.pose, rig.pose)
    residuals = residuals_of(found)
    old, repaired = residuals.before, residuals.after
    assert repaired and repaired.length is not None and old.length is not None
    assert repaired.reprojection_px[25:].mean() < 0.5 * old.reprojection_px[25:].mean()
    assert repaired.length[25:].mean() < old.length[25:].mean()


def test_an_exchanged_bar_is_left_out(case: Case) -> None:
    images = new_bars(case, case.truth)
    spoiled = replace(images, dataset=images.dataset.with_targets_exchanged([3]))
    found = recheck(case.prior, spoiled)
    assert not found.changed
    assert to_json(found)["frames_left_out"] == [3]
    assert any("frame 3 contradict" in note for note in notes(found))


def test_the_repaired_file_holds_what_was_found(case: Case) -> None:
    found = recheck(case.prior, new_bars(case, bumped(case, np.radians(0.5))))
    saved = repaired_parameters(found, "0" * 64)
    read = RigParameters.loads(saved.dumps())
    assert read.method == "refined"
    assert read.inputs["repaired_from"]["sha256"] == "0" * 64
    np.testing.assert_array_equal(read.pose.R, found.repaired.pose.R)
    again = prior_of(read)
    np.testing.assert_allclose(again.covariance, found.best.covariance, rtol=1e-9, atol=1e-15)
    assert again.degrees == pytest.approx(found.noise.degrees)
    # The bars that repaired it agree with it.
    assert not recheck(again, found.images).changed


def test_an_impossible_covariance_is_rejected(case: Case) -> None:
    known = case.prior.rig.uncertainties
    assert known is not None
    C = np.array(known["covariance"]["matrix"])
    for matrix in (-C, C + np.triu(C, 1), 0 * C):
        wrong = {**known["covariance"], "matrix": matrix.tolist()}
        rig = replace(case.prior.rig, uncertainties={**known, "covariance": wrong})
        with refused("symmetric"):
            prior_of(rig)


def test_bars_out_of_step_are_shifted_by_the_offset_of_the_parameters() -> None:
    rng = np.random.default_rng(8)
    cameras, offset = random_rig(rng), TimeOffset(0.3)
    bar = move_bar(cameras, rng, 300, BAR_M, DEPTHS_M)
    first, second = (
        record(replace(bar, frames=frames), rng, 0.2, "moving", offset) for frames in (300, 90)
    )
    rig = refined_parameters(refine(first.shifted(offset), RefineSettings(time_offset=True)))
    assert rig.time_offset is not None
    found = recheck(prior_of(rig, "rig"), images_of_bars(second, rig), Smallest())
    assert not found.changed
    assert "time offset" in " ".join(notes(found))
    blind = replace(rig, time_offset=None)
    assert recheck(prior_of(blind, "rig"), images_of_bars(second, blind), Smallest()).changed


RECORDING = Path(__file__).parents[2] / "sample_data" / "recording"
OFF = Misjudged()
RUN, FRAMES, NEW = 10, 200, 80


def waved_cases(trials: int) -> Iterator[Case]:
    """Rigs calibrated with a waved bar, whose noise is alike for runs of frames."""
    for seed in range(trials):
        rng = np.random.default_rng([seed, 91])
        cameras, data = waved(rng, FRAMES, RUN, OFF, alike_px=OFF.noise_px)
        fit = refine(data, OFF.settings())
        yield Case(cameras, data, prior_of(refined_parameters(fit)), rng)


def waved_bars(case: Case, *rigs: Rig) -> NewImages:
    """New frames of a waved bar, seen by several rigs in turn."""
    scenes = (waved_scene(rig, case.rng, NEW // len(rigs), RUN) for rig in rigs)
    data = in_runs(joined(case, *scenes), case.rng, RUN, OFF.noise_px)
    return images_of_bars(data, case.prior.rig)


@pytest.mark.soak
def test_runs_are_no_movement_and_a_turn_is_still_found() -> None:
    """With new frames taken as independent, 4 of the first 12 unmoved rigs had moved."""
    alarms = found = since = 0
    for case in waved_cases(8):
        moved = bumped(case, np.radians(0.2))
        alarms += recheck(case.prior, waved_bars(case, case.truth)).changed
        late = recheck(case.prior, waved_bars(case, case.truth, moved))
        found += late.changed
        since += late.since is not None
    # Measured on 600 unmoved rigs: 7; on 200 that moved: 197 and 129. The stated share of alarms
    # is 1 in 100.
    assert alarms <= 1
    assert found >= 7
    assert since >= 3


def test_a_recording_has_not_moved_against_itself_and_says_how_its_frames_count() -> None:
    data = screen(read_dataset(RECORDING)).dataset
    fit = refine(data)
    prior = prior_of(refined_parameters(fit))
    assert prior.design_effect == fit.design_effect > 2
    check = recheck(prior, images_of_bars(data, prior.rig))
    assert check.verdict != "moved"
    assert check.noise.design_effect >= prior.design_effect
    assert any("independent ones" in note for note in notes(check))
    written = repaired_parameters(check, None).uncertainties
    assert written is not None
    assert written["design_effect"] == check.noise.design_effect


def test_poor_lenses_are_no_movement() -> None:
    """Thirds of the real recording, of lenses that distort nothing, checked with one another: 5 of
    9 had "moved", 2 of 3 against themselves, lenses "refocused by 1.3 %". Their bars scatter by 0.1
    to 0.3 px within a place, the calibration by 0.8 px."""
    data = screen(read_dataset(RECORDING)).dataset
    for name in CAMERAS:
        lens = getattr(data, name)
        pinhole: Any = {name: replace(lens, distortion=np.zeros_like(lens.distortion))}
        data = data.changed(**pinhole)
    first, _, last = (data.of_frames(n) for n in np.array_split(data.correspondences.frames, 3))
    prior = prior_of(refined_parameters(refine(last)))
    itself = images_of_bars(last, prior.rig)
    found = recheck(prior, itself)
    assert found.verdict == "cannot tell" and "come from these images" in sentence(found)
    for images in (replace(itself, own=False), images_of_bars(first, prior.rig)):
        found = recheck(prior, images)
        assert found.verdict == "cannot tell" and "whether one camera" in sentence(found)
        assert 0.5 < np.degrees(found.power.detectable_turn_rad) < 1.0
        assert found.noise.sigma_px >= prior.sigma_px
    turn = np.radians(3.0) * np.array([0.0, 0.8, 0.6])
    moved = turned_from(first.recording, "secondary", turn, -np.inf).pair(*CAMERAS)
    found = recheck(prior, images_of_bars(moved, prior.rig))
    assert found.verdict == "moved" and found.turn[0].low < np.radians(3.0) < found.turn[0].high


def test_a_few_frames_of_a_recording_were_calibrated_and_the_others_are_new(case: Case) -> None:
    frames = case.dataset.correspondences.frames
    few = case.dataset.of_frames(frames[:10])
    rig = refined_parameters(refine(few, OFF.settings()))
    assert images_of_bars(few, rig).own
    assert images_of_bars(case.dataset.of_frames(frames[:15]), rig).own
    assert not images_of_bars(case.dataset, rig).own


def test_bars_that_tell_as_much_as_one_are_no_number_of_independent_ones(case: Case) -> None:
    """`186 bars tell as much as about 0 independent ones`."""
    found = recheck(case.prior, new_bars(case, case.truth))
    for effect, words in ((12.0, "the 5 bars tell hardly more than one"), (2.5, "about 2 indep")):
        noise = replace(found.noise, design_effect=effect)
        assert any(words in note for note in notes(replace(found, noise=noise)))


@pytest.mark.parametrize("seed", [2, 4])
def test_lenses_that_are_not_as_their_model_make_no_movement(seed: int) -> None:
    """A quarter in time of a waved bar, which was elsewhere in the other three."""
    rng = np.random.default_rng(seed)
    cameras, fields = random_rig(rng), smooth_fields(rng)
    off = Misjudged(noise_px=0.2)
    data = with_waves(stated(waved_scene(cameras, rng, 320, 20), rng, off), fields, 0.4)
    frames = data.correspondences.frames
    prior = prior_of(refined_parameters(refine(data.of_frames(frames[80:]))))
    still = images_of_bars(data.of_frames(frames[:80]), prior.rig)
    assert recheck(prior, still).verdict != "moved"
    turn = Rotation.from_rotvec(np.radians([0.12, 0.0, 0.16])).as_matrix()
    pose = prior.rig.pose
    moved = replace(prior.rig, pose=Pose(turn @ pose.R, turn @ pose.T))
    assert recheck(replace(prior, rig=moved, at=_at(prior, moved)), still).verdict == "moved"


def _at(prior: Prior, rig: RigParameters) -> Cameras:
    """The cameras of a rig, with the factor of the lengths of a prior."""
    found = rig_at(rig)
    found.q[FACTOR] = prior.at.q[FACTOR]
    return found
