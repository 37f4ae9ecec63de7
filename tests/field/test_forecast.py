"""The forecast of a plan: against simulated field days, on every executor, its properties."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import FILE_METHODS
from stereocal.field.planning.advice import LIMITS, advise, with_baseline
from stereocal.field.planning.common_cameras import COMMON
from stereocal.field.planning.expected import expect, within_95
from stereocal.field.planning.forecast import PlanForecast, forecast, plan_answer
from stereocal.field.planning.plan import AimedPose, Plan, Uncertainty
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import parse_plan, read_plan, write_plan
from stereocal.rig.geometry import triangulate
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import percent
from tests.field.plans import FIELD, LENS, contents, plan
from tests.refused import refused
from tests.rigs import known_rig
from tests.rigs.population import observed


@lru_cache(maxsize=2)
def whole(rigs: int = 32) -> PlanForecast:
    return forecast(FIELD, rigs=rigs)


@pytest.mark.soak
def test_the_forecast_comes_true_on_simulated_field_days() -> None:
    """25 field days have a standard error of 15 % in the 2D set, whose errors scatter most."""
    days = [observed(FIELD, seed) for seed in range(25)]
    found = whole(128)
    for method, tolerance in zip(FILE_METHODS, (0.45, 0.12, 0.07), strict=True):
        true = np.mean([day[method, "mean_length_error"] for day in days])
        said = found.estimate(method, "mean_length_error")
        assert said.value == pytest.approx(true, rel=tolerance), method
        assert said.low <= true <= said.high
        true = np.mean([day[method, "fcp_reprojection"] for day in days])
        assert 0.5 < found.estimate(method, "fcp_reprojection").value / true < 2.0


def test_an_accuracy_that_is_needed_is_reached_or_not() -> None:
    """95 % of lengths: within 0.4 to 0.5 % on these field days. What is not asked is not said."""
    found = whole()
    within = found.estimate("refined", "p95_error_3d")
    asked = {0.5 * within.low: "no", within.value: "not sure", 2 * within.high: "yes"}
    for needed, reached in asked.items():
        own = replace(found, plan=replace(FIELD, needed=needed))
        assert own.reached == reached
        entry = json.loads(own.dumps())["needed"]
        assert (entry["length_error"], entry["reached"]) == (needed, reached)
        assert f"(needed: {percent(needed)} %)" in plan_answer(own)
    assert "needed" not in json.loads(found.dumps()) and "need" not in plan_answer(found)
    stated = json.dumps(contents(needed={"length_error": 0.01})).encode()
    assert parse_plan(stated, "plan", str.encode).needed == 0.01
    with refused("0.01", "1 %"):
        plan(needed=1.5)


def test_a_bar_that_is_known_badly_is_the_headline_of_a_plan() -> None:
    """0.5 % of the bar in sharp images: 1.96 of these, not what one field day shows on average."""
    bar = 0.005 * FIELD.bar_m
    own = replace(FIELD.uncertainty, bar_m=bar, focal=1e-4, centre_px=0.1)
    found = forecast(replace(FIELD, noise_px=0.01, uncertainty=own), rigs=32)
    said = found.metric_p95("3d")
    assert said.value == pytest.approx(1.96 * 0.005, rel=0.15)
    assert said.value > 1.5 * found.estimate("3d", "p95_error_3d").value
    assert f"± {rounded(1000 * bar)} mm" in plan_answer(found)
    entry = json.loads(found.dumps())["methods"]["3d"]["p95_metric_error_3d"]
    assert entry["value"] == said.value


def test_two_sets_do_what_the_paper_says() -> None:
    found = whole()
    errors = {m: found.estimate(m, "mean_length_error").value for m in FILE_METHODS}
    fcp = {m: found.estimate(m, "fcp_reprojection").value for m in FILE_METHODS}
    assert errors["refined"] <= errors["3d"] < 0.3 * errors["2d"]
    assert fcp["refined"] <= fcp["2d"] < 0.3 * fcp["3d"]
    assert (found.match_with, found.measure_with) == ("refined", "refined")


def test_the_file_has_every_figure_with_its_interval() -> None:
    content = json.loads(whole().dumps())
    of_lengths = {"mean_length_error", "median_error_3d", "p95_error_3d", "p95_metric_error_3d"}
    of_pairs = {"fcp_reprojection", "threshold_px", "mean_reprojection_px"}
    assert set(content["methods"]) == {"2d", "3d", "refined"}
    for figures in content["methods"].values():
        assert set(figures) == of_lengths | of_pairs
        for figure in (*figures.values(), content["position_error_m"]):
            assert set(figure) == {"value", "low", "high"}
            assert figure["low"] <= figure["value"] <= figure["high"]
    assert content["limited_by"] in LIMITS
    assert content["advice"] and all(isinstance(text, str) for text in content["advice"])


NEAR = plan(stated_pose=AimedPose(4.0, 38.0), near_m=2.5, far_m=4.0, bar_m=0.4)
EXACT = Uncertainty(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("one", "limit"),
    [
        (FIELD, "baseline"),
        (replace(NEAR, uncertainty=EXACT), "image noise"),
        (replace(NEAR, uncertainty=Uncertainty(0.0, 0.0, 0.2, 0.05)), "baseline"),
    ],
)
def test_what_limits(one: Plan, limit: str) -> None:
    assert advise(expect(one)).limited_by == limit


def test_more_bars_a_longer_bar_and_less_noise_never_hurt() -> None:
    usual = expect(FIELD).length_p95
    for better in (plan(frames=100), plan(bar_m=1.8), plan(noise_px=0.1)):
        assert expect(better).length_p95 < 1.1 * usual
    assert expect(plan(noise_px=0.1)).length_p95 < 0.7 * usual


def test_what_95_percent_of_lengths_are_within() -> None:
    """Of errors with several standard deviations; and as the drawn rigs have it."""
    assert within_95(np.full(4, 0.3)) == pytest.approx(0.3 * 1.96, rel=1e-3)
    sigmas = np.array([0.1, 0.2, 1.0, np.nan])
    drawn = np.random.default_rng(0).standard_normal((100_000, 3)) * sigmas[:3]
    assert within_95(sigmas) == pytest.approx(np.quantile(np.abs(drawn), 0.95), rel=0.01)
    assert np.isnan(within_95(np.array([np.nan])))
    for one in (FIELD, NEAR):  # measured: 0.98 and 0.97 with all drawn rigs
        found = forecast(one, rigs=64)
        ratio = found.fit.length_p95 / found.metric_p95("refined").value
        assert ratio == pytest.approx(1.0, abs=0.12)
    by_depth = found.to_json()["by_depth"]
    assert {*by_depth[0]} == {"depth_m", "mean_length_error", "position_error_m"}


def test_another_baseline_keeps_the_aim() -> None:
    other = with_baseline(FIELD, 9.0)
    centre = np.zeros((1, 2))
    before, after = (triangulate(p.pose, centre, centre)[0] for p in (FIELD, other))
    # The distance from the middle of the baseline stays, that from the primary grows a little.
    assert before[2] < after[2] < 1.1 * before[2]
    stated = plan(stated_pose=FIELD.pose)
    moved = with_baseline(stated, 6.0)
    assert moved.baseline_m == pytest.approx(6.0)
    aim = stated.common_points.mean(axis=0)
    angles = [p.pose.apply(aim)[:2] / p.pose.apply(aim)[2] for p in (stated, moved)]
    assert np.allclose(angles[0], angles[1], atol=1e-9)


def test_two_gopros_in_wide_mode() -> None:
    """From the Plan's list: 118 degrees across the image."""
    lens = COMMON["GoPro HERO, 4K video, Wide"]
    middle = lens.camera.K[1, 2]
    edges = lens.camera.undistort([[-0.5, middle], [lens.image_size[0] - 0.5, middle]])[:, 0]
    assert np.degrees(np.ptp(np.arctan(edges))) == pytest.approx(118.0, abs=1.0)
    pair = plan(stated_primary=lens, stated_secondary=lens, near_m=1.0, far_m=4.0, bar_m=0.4)
    found = expect(replace(pair, stated_pose=AimedPose(1.0, 10.0, 0.0)))
    assert 0 < found.length_p95 < 0.02


@pytest.mark.parametrize("height", [0.0, 0.7, -0.4])
def test_both_axes_meet_where_the_toe_in_says(height: float) -> None:
    pose = AimedPose(4.0, 12.0, height).pose
    centre = np.zeros((1, 2))
    meeting = triangulate(pose, centre, centre)[0]
    assert np.isclose(pose.baseline, 4.0)
    # From the primary, along its own axis: half the baseline over the sine of the toe-in.
    assert np.allclose(meeting, [0.0, 0.0, 2.0 / np.sin(np.radians(12.0))], atol=1e-9)
    camera = -pose.R.T @ pose.T
    assert camera[0] > 0  # the secondary is on the right
    assert np.isclose(-camera[1], height, atol=0.15 * abs(height) + 1e-12)  # y points down


def test_the_file_is_read_back(tmp_path: Path) -> None:
    known = plan(stated_primary=known_rig.PRIMARY, stated_secondary=LENS, stated_pose=FIELD.pose)
    for one in (FIELD, known):
        path = tmp_path / "plan.json"
        path.write_bytes(write_plan(one))
        read = read_plan(path)
        assert write_plan(read) == write_plan(one)
        assert np.allclose(read.primary.K, one.primary.K)
        assert np.allclose(read.pose.R, one.pose.R)


def test_camera_files_stand_beside_the_plan(tmp_path: Path) -> None:
    (tmp_path / "lens.json").write_bytes(write_camera(known_rig.PRIMARY))
    cameras = {"primary": "lens.json", "secondary": contents()["cameras"]["secondary"]}
    (tmp_path / "plan.json").write_text(json.dumps(contents(cameras=cameras)))
    read = read_plan(tmp_path / "plan.json")
    assert np.array_equal(read.primary.K, known_rig.PRIMARY.K)
    (tmp_path / "lens.json").unlink()
    with refused("lens.json: "):
        read_plan(tmp_path / "plan.json")
