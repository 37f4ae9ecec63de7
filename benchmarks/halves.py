"""Forecasts from one half of a recording against the other half.

    python -m benchmarks.halves DATASET

Figures of the written files on the held-out half, with and without the frames that the screening of
the whole recording leaves out, beside the forecast intervals; and the check of the model. The
forecast is of many frames and the held-out half has few: a figure outside the interval may still be
within the scatter of the test (two standard errors, jackknife over 10 groups of frames).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from stereocal.calibration.methods import CalibrationSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.screening import screen
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.verdict.forecast import forecast_files
from stereocal.workflow import calibrate
from tests.rigs.population import figures_on

GROUPS = 10
FIGURES = ("fcp_reprojection", "mean_reprojection_px", "median_error_3d", "p95_error_3d")


def scatter_of(data: Dataset, rig: Rig) -> dict[str, float]:
    """Standard errors of the logarithms of the figures: delete-a-group jackknife."""
    frames = data.correspondences.frames
    groups = np.arange(len(frames)) * GROUPS // len(frames)
    found = [figures_on(data.of_frames(frames[groups != g]), rig) for g in range(GROUPS)]
    return {
        name: float(np.sqrt((GROUPS - 1) * np.var(np.log([each[name] for each in found]))))
        for name in FIGURES
    }


def one_half(fitted: Dataset, tested: Dataset, sound: Dataset) -> None:
    """Print the figures of all files."""
    settings = RefineSettings()
    calibration = calibrate(fitted, CalibrationSettings(), refined=settings)
    outlook = forecast_files(calibration)
    answer = outlook.verdict
    for item in outlook.comparison.inputs:
        if item.accused:
            print(f"  {item.advice}")
    print(f"  {answer.kind}: {answer.figures}")
    print(f"  {answer.check.text if answer.check else ''}")
    for method in outlook.predictive.methods:
        forecast = outlook.predictive.forecast(method)
        all_frames = figures_on(tested, outlook.files[method])
        kept_frames = figures_on(sound, outlook.files[method])
        scatter = scatter_of(sound, outlook.files[method])
        for figure in FIGURES:
            said = getattr(forecast, figure)
            true, wide = kept_frames[figure], np.exp(2 * scatter[figure])
            held = "holds" if said.low <= true <= said.high else "misses"
            if held == "misses" and said.low <= true * wide and true / wide <= said.high:
                held = "within the scatter of the test"
            print(
                f"  {method:9s} {figure:22s} forecast {said.value:.5f} ({said.low:.5f} to "
                f"{said.high:.5f}); held out {kept_frames[figure]:.5f} {held}, with all frames "
                f"{all_frames[figure]:.5f}"
            )


def main() -> None:
    """Even fitted and odd held out, and the reverse."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    data = read_dataset(parser.parse_args().dataset)
    left_out = screen(data).left_out
    numbers = data.correspondences.frames
    for parity in (0, 1):
        print(f"{'even' if parity == 0 else 'odd'} frames fitted")
        rest = numbers[numbers % 2 != parity]
        one_half(
            data.of_frames(numbers[numbers % 2 == parity]),
            data.of_frames(rest),
            data.of_frames(rest[~np.isin(rest, left_out)]),
        )


if __name__ == "__main__":
    main()
