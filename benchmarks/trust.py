"""Whether the forecasts hold: simulated rigs, whose files are judged on a large fresh test.

    python -m benchmarks.trust --rigs 20 --frames 25 50 200

For every size of lens error and number of frames: the share of 95 % intervals that hold the
population figure of the written file, the median of true over forecast value, and the median width
of the intervals over the value.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.population import population
from benchmarks.refined_rigs import BAR_M, DEPTHS_M, Misjudged, random_scene, stated
from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.refined.unknowns import RefineSettings
from stereocal.simulation.simulate import place_bars
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.predictive import Forecast
from stereocal.workflow import calibrate

CASES: Mapping[str, Misjudged] = {
    "exact": Misjudged(0.0, 0.0, 0.0, 0.0),
    "0.2 %, 4 px, baseline 0.5 %": Misjudged(0.0115, 0.0005, 0.002, 4.0),
    "1 %, 15 px, baseline 2 %": Misjudged(0.046, 0.0005, 0.01, 15.0),
}
NOISE_PX = (0.1, 0.5)
TEST_BARS = 2000
FIGURES = (
    "fcp_residual",
    "fcp_reprojection",
    "correct_lost_at_threshold",
    "wrong_let_in_at_threshold",
    "mean_reprojection_px",
    "median_error_3d",
    "p95_error_3d",
)


def one_rig(off: Misjudged, frames: int, seed: int) -> dict[Method, dict[str, tuple[float, ...]]]:
    """Of each file and figure: the population's value, and value, low, high of the forecast."""
    rng = np.random.default_rng([seed, frames, int(1e6 * off.focal)])
    noise = float(np.exp(rng.uniform(*np.log(NOISE_PX))))
    scene = random_scene(rng, frames)
    dataset = stated(scene, rng, replace(off, noise_px=noise))
    settings = off.settings() if off.focal else RefineSettings()
    calibration = calibrate(dataset, CalibrationSettings(), refined=settings)
    outlook = forecast_files(calibration)
    files, forecasts = outlook.files, outlook.predictive.forecasts
    factor = BAR_M / dataset.target_distance_m
    test = place_bars(scene.rig, rng, TEST_BARS, BAR_M, DEPTHS_M)
    thresholds = {method: found.threshold_px.value for method, found in forecasts.items()}
    truths = population(scene.rig, files, test.ends_m, noise, thresholds, rng, factor)
    return {
        method: {
            figure: (truths[method][figure], *_numbers(forecasts[method], figure))
            for figure in FIGURES
        }
        for method in forecasts
    }


def _numbers(forecast: Forecast, figure: str) -> tuple[float, float, float]:
    estimate = getattr(forecast, figure)
    return estimate.value, estimate.low, estimate.high


def report(found: list[dict[Method, dict[str, tuple[float, ...]]]]) -> None:
    """A line for each method and figure."""
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    for rig in found:
        for method, figures in rig.items():
            for figure, own in figures.items():
                rows[method, figure].append(own)
    for (name, figure), numbers in rows.items():
        true, value, low, high = np.array(numbers).T
        held = (low <= true) & (true <= high)
        n, k = len(held), int(held.sum())
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio, width = true / value, (high - low) / value
        beside = f"{100 * np.mean(true < low):3.0f} below {100 * np.mean(true > high):3.0f} above"
        print(
            f"  {name:9s} {figure:26s} held {100 * k / n:3.0f} %  {beside}  "
            f"true/forecast {np.nanmedian(ratio):5.2f}  width/value {np.nanmedian(width):5.2f}"
        )


def main() -> None:
    """All cells."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--frames", type=int, nargs="+", default=[25, 50, 200])
    parser.add_argument("--cases", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out", type=Path)
    parsed = parser.parse_args()
    everything = []
    for case, off in [list(CASES.items())[at] for at in parsed.cases]:
        for frames in parsed.frames:
            found = []
            for seed in range(parsed.first, parsed.first + parsed.rigs):
                try:
                    found.append(one_rig(off, frames, seed))
                except StereocalError as error:
                    print(f"  rig {seed}: {error}")
            print(f"{case}; {frames} frames; {len(found)} rigs")
            report(found)
            everything += found
    print("all")
    report(everything)
    if parsed.out:
        parsed.out.write_text(json.dumps(everything))


if __name__ == "__main__":
    main()
