"""Whether the headline holds: "a length of 1 m is right to 2.0 mm, 95 % of the time".

    python -m benchmarks.headline [metres|real|agree ...] [--rigs 200]

- metres: simulated rigs whose bar, baseline and lenses are off by errors drawn from what is stated
  of them; lengths in metres of 400 fresh bars a rig, measured by the recommended file: the share
  within the headline, over all, and the headlines by how well the bar is known;
- real: quarters in time of the real recording, the other three calibrated with the length of the
  bar misstated by an error drawn from what is said of it: true lengths of the bars of the quarter;
- agree: the same rigs, validated: how often held-out frames are said to contradict the forecast.
"""

from dataclasses import replace

import numpy as np

from benchmarks.studies import RECORDING, Asked, pair_of, parts_in_time, run_studies
from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.summary import Estimate
from stereocal.simulation.simulate import Scene, place_bars
from stereocal.system.array_types import FloatArray
from stereocal.system.executors import engine
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun, usual_frames
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, random_scene, stated

NOISES_PX = (0.005, 0.02, 0.1)
BARS = (0.001, 0.0002)
"""Standard deviation of the stated length of the bar, a fraction; the first is assumed as well."""
FRESH = 400
FRAMES = (25, 8, 12)
"""Of the rigs that are validated: few show the most of what chance does."""


def run_of(number: int, frames: int = 25) -> tuple[Scene, PairRun, Misjudged]:
    """A simulated rig, calibrated as stated."""
    rng = np.random.default_rng([number, 58])
    known = BARS[number // len(NOISES_PX) % 2]
    off = Misjudged(noise_px=NOISES_PX[number % len(NOISES_PX)], bar_m=known * BAR_M)
    scene = random_scene(rng, frames)
    data = stated(scene, rng, off).changed(baseline_sigma_m=off.baseline_m)
    if known != BARS[0]:
        data = data.changed(target_distance_sigma_m=off.bar_m)
    settings = replace(off.settings(), baseline_sigma_m=None, distance_sigma_m=None)
    return scene, PairRun(data, CalibrationSettings(), settings), off


def errors_in_metres(answer: PairAnswer, scene: Scene, noise_px: float, number: int) -> FloatArray:
    """(n,): relative errors of the true lengths of fresh bars, by the recommended file."""
    rng = np.random.default_rng([number, 59])
    fresh = place_bars(scene.rig, rng, FRESH, BAR_M, DEPTHS_M, 20.0)
    cameras = scene.rig.primary, scene.rig.secondary
    pixels = [
        camera.project(at) + noise_px * rng.standard_normal((len(at), 2))
        for camera, at in zip(cameras, fresh.points_m, strict=True)
    ]
    file = answer.sets[answer.recommendation.measure.method]
    ends = file.reconstruct(*pixels).reshape(-1, 2, 3)
    return np.asarray(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / BAR_M - 1.0)


def metres(asked: Asked) -> None:
    """How many lengths in metres are within the headline."""
    within: dict[tuple[float, float], list[tuple[float, float, float]]] = {}
    for number in asked.numbers:
        scene, run, off = run_of(number)
        answer = PairAnswer(run)
        found = answer.recommendation.measure
        said, scatter = found.metric_p95.best(True), found.length_p95.best(True)
        assert isinstance(said, Estimate) and isinstance(scatter, Estimate)
        errors = np.abs(errors_in_metres(answer, scene, off.noise_px, number))
        row = float(np.mean(errors <= said.value)), float(np.mean(errors <= scatter.value))
        cell = within.setdefault((off.bar_m / BAR_M, off.noise_px), [])
        cell.append((*row, said.value))
    for (known, noise), cell in sorted(within.items()):
        shares = np.array(cell)
        low, middle, high = 1000 * np.percentile(shares[:, 2], (2.5, 50, 97.5))
        print(
            f"  bar to {100 * known:g} %, {noise:g} px: {100 * shares[:, 0].mean():.1f} % within, "
            f"headline {middle:.2f} mm a metre ({low:.2f} to {high:.2f}); within the scatter alone "
            f"{100 * shares[:, 1].mean():.1f} %"
        )
    every = np.concatenate([np.array(cell)[:, :2] for cell in within.values()])
    error = 100 * every[:, 0].std() / np.sqrt(len(every))
    print(
        f"  all {len(every)}: {100 * every[:, 0].mean():.1f} ± {error:.1f} % of lengths are within "
        f"the headline, {100 * every[:, 1].mean():.1f} % within the scatter alone"
    )


def real(asked: Asked) -> None:
    """The same on a real recording cut in time, against a bar that is stated wrongly."""
    data = pair_of(str(RECORDING))
    parts = [*parts_in_time(data, 4)]
    for known in BARS:
        rng = np.random.default_rng([58, round(1e6 * known)])
        shares = np.empty((asked.trials, 2))
        for number in range(asked.trials):
            test, rest = parts[number % 4]
            bar = data.target_distance_m * (1.0 + known * rng.normal())
            sigma = known * data.target_distance_m
            given = rest.changed(target_distance_m=bar, target_distance_sigma_m=sigma)
            answer = PairAnswer(PairRun(given))
            found = answer.recommendation.measure
            rows = test.correspondences
            ends = answer.sets[found.method].reconstruct(rows.primary, rows.secondary)[rows.bars]
            lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
            errors = np.abs(lengths / data.target_distance_m - 1.0)
            for at, own in enumerate((found.metric_p95.best(True), found.length_p95.best(True))):
                assert isinstance(own, Estimate)
                shares[number, at] = np.nanmean(errors <= own.value)
        whole, alone = 100 * shares.mean(axis=0)
        print(
            f"  bar to {100 * known:g} %: {whole:.1f} % of lengths of {asked.trials} quarters "
            f"within the headline, {alone:.1f} % within the scatter alone"
        )


def agree(asked: Asked) -> None:
    """How often held-out frames are said to contradict the forecast of sound rigs."""
    said = []
    for number in asked.numbers:
        _, run, _ = run_of(number, FRAMES[number % len(FRAMES)])
        frames = usual_frames(len(run.calibration.screening.dataset.correspondences.frames))
        settings = EvaluationSettings(run.settings, 100, frames, refined=run.refined)
        with engine() as executor:
            found = PairAnswer(run, run.validate(settings, executor)).recommendation
        if found.contradiction:
            said.append(number)
            print(f"  rig {number}: {found.contradiction}")
    print(f"  {len(said)} of {asked.trials} contradict")


STUDIES = {"metres": (metres, 200), "real": (real, 40), "agree": (agree, 100)}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
