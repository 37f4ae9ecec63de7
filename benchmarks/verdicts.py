"""Whether the verdict is right: simulated rigs, sound ones and such that the model cannot follow.

python -m benchmarks.verdicts --rigs 40 --frames 25
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies import Asked, run_studies, spread
from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.simulation.simulate import place_bars
from stereocal.verdict.forecast import TOLERANCE, Verdict, forecast_files
from tests.rigs.population import population
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, random_scene, stated


@dataclass(frozen=True)
class Case:
    """What is stated wrongly."""

    off: Misjudged
    k1: float = 0.0
    """Of the primary."""
    too_sure: float = 1.0
    """Factor by which the lens files understate their errors."""


CASES: Mapping[str, Case] = {
    "exact": Case(Misjudged(0.0, 0.0, 0.0, 0.0)),
    "0.2 %, 4 px, 0.5 %": Case(Misjudged(0.0115, 0.0005, 0.002, 4.0)),
    "1 %, 15 px, 2 %": Case(Misjudged(0.046, 0.0005, 0.01, 15.0)),
    "k1 off by 0.02": Case(Misjudged(0.0115, 0.0005, 0.002, 4.0), k1=0.02),
    "k1 off by 0.08": Case(Misjudged(0.0115, 0.0005, 0.002, 4.0), k1=0.08),
    "lens files 20 times too sure": Case(Misjudged(0.0115, 0.0005, 0.01, 15.0), too_sure=20.0),
    "lens files 40 times too sure": Case(Misjudged(0.0115, 0.0005, 0.01, 15.0), too_sure=40.0),
}


def one_rig(case: Case, frames: int, seed: int) -> tuple[Verdict, bool]:
    """The verdict, and whether two sets are truly needed."""
    rng = np.random.default_rng([seed, frames, 77])
    noise = float(np.exp(rng.uniform(np.log(0.1), np.log(0.5))))
    scene = random_scene(rng, frames)
    dataset = stated(scene, rng, replace(case.off, noise_px=noise))
    own = dataset.primary
    bent = own.distortion + case.k1 * np.eye(1, own.distortion.size).ravel()
    dataset = dataset.changed(primary=Camera(own.K, bent, own.image_size))
    settings = RefineSettings()
    if case.off.focal:
        settings = case.off.settings()
        lens = LensPrior(case.off.focal / case.too_sure, case.off.centre_px / case.too_sure)
        settings = replace(settings, lenses=dict.fromkeys(CAMERAS, lens))
    calibration = calibrate(dataset, CalibrationSettings(), refined=settings)
    forecast = forecast_files(calibration)
    files = forecast.files
    answer = forecast.verdict
    factor = BAR_M / dataset.target_distance_m
    test = place_bars(scene.rig, rng, 1500, BAR_M, DEPTHS_M)
    true = population(scene.rig, files, test.ends_m, noise, dict.fromkeys(files, 1.0), rng, factor)
    limit = 1.0 + TOLERANCE
    two = (
        true["refined"]["mean_reprojection_px"] > limit * true["2d"]["mean_reprojection_px"]
        or true["refined"]["mean_error_3d"] > limit * true["3d"]["mean_error_3d"]
    )
    return answer, two


def verdicts(asked: Asked) -> None:
    """All cases."""
    for name, case in CASES.items():
        found = []
        for seed in asked.numbers:
            try:
                found.append(one_rig(case, asked.frames, seed))
            except StereocalError as error:
                print(f"  {seed}: {error}")
        decided = [(answer, two) for answer, two in found if answer.kind != "level"]
        right = sum((answer.kind == "two") == two for answer, two in decided)
        needing = [answer for answer, two in found if two]
        caught = sum(answer.kind == "two" for answer in needing)
        checks = [answer.check for answer, _ in found if answer.check is not None]
        print(
            f"  {name}: {len(found)} rigs, decided {len(decided)}, right {right}; {len(needing)} "
            f"need two, {caught} found; model doubted {sum(not own.holds for own in checks)}; held-"
            f"out over forecast {spread([own.matching.ratio for own in checks], 98)} px, "
            f"{spread([own.measuring.ratio for own in checks], 98)} length",
            flush=True,
        )


if __name__ == "__main__":
    run_studies({"verdicts": (verdicts, 40)}, __doc__, frames=25)
