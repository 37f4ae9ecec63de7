"""The check of the model: what it doubts, where, and what it says of the noise."""

from dataclasses import replace

import numpy as np
from scipy.stats import binom

from stereocal.fit.errors.uncertainty import bar_innovations
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.library.calibrations import calibrate
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import Nominal, observe
from stereocal.verdict.forecast import advice_on_improvements, forecast_files, improvements
from stereocal.verdict.forecast_draws import draw_forecast
from stereocal.verdict.model_check import ALONG, BENDS, ModelCheck, cause_of_scatter
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

SETTINGS = Misjudged().settings()


def rig(seed: int, frames: int = 60, off: Misjudged | None = None) -> Pair:
    rng = np.random.default_rng([seed, 0xC4])
    return stated(random_scene(rng, frames), rng, off or Misjudged())


def check(data: Pair, settings: RefineSettings | None = None) -> ModelCheck:
    found = forecast_files(calibrate(data, refined=settings or Misjudged().settings())).check
    assert found is not None
    return found


def test_sound_rigs_are_not_doubted() -> None:
    doubted = sum(not check(rig(seed, 25)).holds for seed in range(3))
    # 1 in 100 is expected: two of 3 have a probability of 3 in 10,000.
    assert binom.sf(1, 3, 0.01) < 1e-3
    assert doubted <= 1


def test_a_lens_that_the_model_cannot_follow_is_doubted_and_raises_the_intervals() -> None:
    """A field that k1, k2, p1 and p2 cannot follow: a ripple that grows towards the edges."""
    data = rig(1, 80)
    table = data.correspondences
    middle = 0.5 * np.array(data.primary.image_size)
    away = (table.primary - middle) / np.linalg.norm(middle)
    radius = np.linalg.norm(away, axis=1, keepdims=True)
    ripple = 15.0 * radius**4 * np.sin(9.0 * away[:, ::-1])
    moved = replace(table, primary=table.primary + ripple)
    spoiled = data.changed(correspondences=moved)
    forecast = forecast_files(calibrate(spoiled, refined=SETTINGS))
    assert forecast.check is not None and not forecast.check.holds
    assert forecast.check.worst.where == "near the image edges"
    assert "edges" in forecast.check.text
    images, length = forecast.check.excess
    assert images > 1.15
    usual = draw_forecast(forecast.model, forecast.files).figures["refined"]
    raised = forecast.draws.figures["refined"]
    assert raised.mean_reprojection_px.high == usual.mean_reprojection_px.high * images
    assert raised.median_error_3d.high == usual.median_error_3d.high * length
    assert raised.median_error_3d.low == usual.median_error_3d.low


def bent(rng: np.random.Generator) -> RefinedResult:
    """A fit of 100 bars whose length varies by 1 %."""
    scene = random_scene(rng, 100, margin_px=60.0)
    middle, along = scene.ends_m.mean(axis=1, keepdims=True), np.diff(scene.ends_m, axis=1) / 2
    factor = 1 + 0.01 * rng.normal(size=(100, 1, 1))
    ends = np.concatenate([middle - factor * along, middle + factor * along], axis=1)
    off = Nominal.exact(scene)
    return refine(observe(replace(scene, ends_m=ends), rng, 0.1, "bent", off), SETTINGS)


def blurred(rng: np.random.Generator) -> RefinedResult:
    """A fit of 100 bars with 0.7 px along the image rows and 0.1 px across."""
    data = stated(random_scene(rng, 100), rng, Misjudged(0, 0, 0, 0, 0.1))
    table = data.correspondences
    along = [np.column_stack([0.7 * rng.normal(size=200), np.zeros(200)]) for _ in range(2)]
    moved = replace(table, primary=table.primary + along[0], secondary=table.secondary + along[1])
    return refine(data.changed(correspondences=moved), SETTINGS)


def test_a_bar_that_bends_is_told_apart_from_noise_along_the_lines() -> None:
    """Right in 4 and 4 of 4 here; never the other one."""
    bends, along = (
        [
            cause_of_scatter(model, bar_innovations(model, model.used_rows))
            for model in (make(np.random.default_rng([seed, kind])) for seed in range(4))
        ]
        for kind, make in ((1, bent), (2, blurred))
    )
    assert bends.count(BENDS) >= 2
    assert ALONG not in bends
    assert along.count(ALONG) >= 2
    assert BENDS not in along


def test_improvements_go_the_right_way() -> None:
    """Poor lenses and 8 frames limit this rig; with all known, only noise is left."""
    off = Misjudged(0.05, 0.0005, 0.02, 30.0, 0.1)
    model = refine(rig(4, 8, off), off.settings())
    found = improvements(model)
    now, noise = found.pop(""), found.pop("everything known exactly")
    assert all(noise < each < 1.05 * now for each in found.values())
    lenses, baseline = found["exactly known lenses"], found["an exactly known baseline"]
    assert lenses < baseline
    assert "exactly known lenses" in advice_on_improvements(model)
