"""The whole protocol: seconds, memory, growth, and the ratio to plain NumPy.

python -m benchmarks.evaluation
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import numpy as np

from benchmarks import vectorised
from benchmarks.cases import plain_search
from stereocal.calibration.essential import Solver
from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.problems import reconstruction_problem, reprojection_problem
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate, evaluate_runs, split
from stereocal.evaluation.summary import summarise
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.simulation.nineteen import simulate_nineteen

TURNS = 7
PLAIN_RUNS = 2
SOLVERS: tuple[Solver, ...] = ("linear", "constrained")


def protocol(datasets: list[Dataset], settings: EvaluationSettings, executor: Executor) -> None:
    """All runs, and all that is said of them."""
    runs = evaluate(datasets, settings, executor)
    summarise(runs or [])


def seconds_of(act: Callable[[], object], turns: int) -> FloatArray:
    """Seconds of each turn, (turns,)."""
    taken = np.empty(turns)
    for turn in range(turns):
        started = time.perf_counter()
        act()
        taken[turn] = time.perf_counter() - started
    return taken


def said(seconds: FloatArray) -> str:
    """Median and range, in seconds."""
    return f"{np.median(seconds):.3g} s ({seconds.min():.3g} to {seconds.max():.3g})"


def plain_run(dataset: Dataset, settings: EvaluationSettings, run: int) -> None:
    """One run with the fast NumPy costs and essential method, and the pairs in whole arrays."""
    seeds = np.random.SeedSequence([0, 0, run]).spawn(4)
    rows = split(dataset, settings.calibration_frames, seeds[0])
    fit = reprojection_problem(dataset, rows)
    problem = reconstruction_problem(dataset, rows=rows)
    constrained = settings.calibration.essential == "constrained"
    start = vectorised.essential(fit.rays, dataset.baseline_m, constrained)
    scale, search = fit.pixel_scale, settings.calibration.search
    matching = partial(vectorised.reprojection_cost, rays=fit.rays, pixel_scale=scale)
    measuring = partial(vectorised.distance_cost, rays=problem.rays, reference=problem.reference)
    plain_search(matching, start, search, seeds[1])
    plain_search(measuring, start, search, seeds[2])
    for _ in range(3):
        plain_errors(dataset.rays[:, ~rows], start)


def plain_runs(dataset: Dataset, settings: EvaluationSettings, runs: range) -> None:
    """Several of them."""
    for run in runs:
        plain_run(dataset, settings, run)


def plain_errors(test: FloatArray, pose: Pose) -> None:
    """Residuals and reprojection errors of all pairs of the test's rays (4, n), counted in bins."""
    n = test.shape[1]
    first, second = np.divmod(np.arange(n * n), n)
    rays = np.vstack([test[:2, first], test[2:, second]])
    points = vectorised.triangulate(pose.R, pose.T, rays)
    moved = pose.R @ points + pose.T[:, None]
    shift = np.hypot(*(points[:2] / points[2] - rays[:2]))
    shift += np.hypot(*(moved[:2] / moved[2] - rays[2:]))
    p, q = (np.vstack([part, np.ones(n * n)]) for part in (rays[:2], rays[2:]))
    residuals = np.abs((q * (pose.essential @ p)).sum(axis=0))
    edges = np.linspace(-12.0, 6.0, 901)
    for values in (shift, residuals):
        for label in (first == second, first != second):
            np.histogram(np.log10(np.maximum(values[label], 1e-300)), edges)


def ratio(dataset: Dataset, solver: Solver) -> str:
    """Both sides in turn; one run each, one thread."""
    settings = EvaluationSettings(CalibrationSettings(essential=solver))
    ratios = []
    for turn in range(TURNS):
        of = range(turn * PLAIN_RUNS, (turn + 1) * PLAIN_RUNS)
        plain = seconds_of(partial(plain_runs, dataset, settings, of), 1)
        ours = seconds_of(partial(evaluate_runs, dataset, settings, 0, of), 3)
        ratios.append(float(plain[0] / np.median(ours)))
    return f"{np.median(ratios):.0f} ({min(ratios):.0f} to {max(ratios):.0f})"


def growth() -> None:
    """Seconds of 4 runs of 25, 250 and 2,500 frames, four fifths to calibrate."""
    for frames in (25, 250, 2500):
        dataset = simulate_nineteen(0, datasets=1, frames=frames)[0][1]
        settings = EvaluationSettings(runs=4, calibration_frames=frames * 4 // 5)
        act = partial(evaluate_runs, dataset, settings, 0, range(settings.runs))
        act()
        print(f"{frames} frames, 4 runs: {said(seconds_of(act, 5))}", flush=True)


def memory() -> str:
    """Peak memory of this process so far."""
    return f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"


def main() -> None:
    """Measure and print."""
    datasets = [dataset for _, dataset in simulate_nineteen(0)]
    spawn = multiprocessing.get_context("spawn")
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; median (range)")
    engines: list[tuple[str, Executor]] = [
        ("1 thread", ThreadPoolExecutor(1)),
        ("2 threads", ThreadPoolExecutor(2)),
        ("2 processes", ProcessPoolExecutor(2, mp_context=spawn)),
    ]
    for name, executor in engines:
        with executor:
            evaluate(datasets[:2], EvaluationSettings(runs=20), executor)  # compiles
            for solver in SOLVERS:
                settings = EvaluationSettings(CalibrationSettings(essential=solver))
                one = seconds_of(partial(protocol, datasets[3:4], settings, executor), 5)
                many = seconds_of(partial(protocol, datasets, settings, executor), 3)
                print(
                    f"{name}, {solver}: one {said(one)}, nineteen {said(many)}; "
                    f"peak memory so far {memory()}",
                    flush=True,
                )
    for solver in SOLVERS:
        print(f"plain NumPy / compiled, {solver}: {ratio(datasets[3], solver)}", flush=True)
    growth()


if __name__ == "__main__":
    main()
