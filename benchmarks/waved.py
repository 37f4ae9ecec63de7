"""Simulated recordings of a bar that is waved in front of the cameras.

    python -m benchmarks.waved [intervals|quarters] [--rigs 4]

The bar is at another place every 10, 20 or 40 frames; both lenses have a smooth error of 0.2 px rms
that no model contains. `intervals`: of 200 frames, how many of the stated 95 % intervals hold on
100 further ones. `quarters`: of 400 frames, the rms of the differences of quarters in time over
their stated errors, also without an error of the lenses, and of bars that are not waved.
"""

import numpy as np

from benchmarks.quarters import FIGURES, METHODS, rms_of_differences
from benchmarks.studies import run_studies
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.library.calibrations import calibrate
from stereocal.simulation.simulate import Nominal, observe
from stereocal.verdict.forecast import forecast_files
from tests.rigs.population import figures_on
from tests.rigs.refined_rigs import (
    Misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)

NOISE_PX, MISFIT_PX = 0.2, 0.2
FRAMES, FURTHER, SEED = 200, 100, 500


def held(length: int, seed: int) -> list[tuple[bool, float]]:
    """Of each file and figure whether its interval holds, and its width over the value."""
    rng = np.random.default_rng([seed, length, 5])
    cameras, fields = random_rig(rng), smooth_fields(rng)
    scene = waved_scene(cameras, rng, FRAMES, length)
    off = Misjudged(0.0, 0.0, 0.0, 0.0, NOISE_PX)
    data = with_waves(stated(scene, rng, off), fields, MISFIT_PX)
    further = waved_scene(cameras, rng, FURTHER, length)
    test = observe(further, rng, NOISE_PX, "further", Nominal.exact(scene))
    forecast = forecast_files(calibrate(data, refined=RefineSettings()))
    found = []
    for method in METHODS:
        true = figures_on(with_waves(test, fields, MISFIT_PX), forecast.files[method])
        for name in FIGURES:
            said = getattr(forecast.draws.figures[method], name)
            holds = said.low <= true[name] <= said.high
            found.append((holds, (said.high - said.low) / said.value))
    return found


def intervals(rigs: int) -> None:
    """All lengths of runs."""
    for length in (10, 20, 40):
        found = np.array([each for seed in range(rigs) for each in held(length, seed)])
        of_figures = found[:, 0].reshape(-1, len(FIGURES)).mean(axis=0)
        each = ", ".join(
            f"{name} {100 * share:.0f}" for name, share in zip(FIGURES, of_figures, strict=True)
        )
        print(
            f"{length} frames: {100 * found[:, 0].mean():.0f} % of {len(found)} hold ({each}), "
            f"median width {np.median(found[:, 1]):.2f}"
        )


def in_quarters(rigs: int) -> None:
    """All lengths of runs, and bars one by one."""
    for length, misfit in ((10, 0.2), (20, 0.2), (40, 0.2), (20, 0.0), (1, 0.0), (1, 0.2)):
        squares = []
        for seed in range(SEED, SEED + rigs):
            rng = np.random.default_rng([seed, length, 6])
            cameras, fields = random_rig(rng), smooth_fields(rng)
            scene = waved_scene(cameras, rng, 2 * FRAMES, length)
            data = stated(scene, rng, Misjudged(0.0, 0.0, 0.0, 0.0, NOISE_PX))
            squares.append(rms_of_differences(with_waves(data, fields, misfit))[0] ** 2)
        print(f"{length} frames, {misfit} px: rms {np.sqrt(np.mean(squares)):.2f}", flush=True)


if __name__ == "__main__":
    run_studies({"intervals": (intervals, 4), "quarters": (in_quarters, 4)}, __doc__)
