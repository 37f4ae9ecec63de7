"""The whole protocol: seconds, memory and growth.

python -m benchmarks.evaluation
"""

import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import numpy as np

from stereocal.calibration.essential import Solver
from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate, evaluate_runs
from stereocal.evaluation.summary import summarise
from stereocal.rig.pair import Pair
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.system.array_types import FloatArray

SOLVERS: tuple[Solver, ...] = ("linear", "constrained")


def protocol(datasets: list[Pair], settings: EvaluationSettings, executor: Executor) -> None:
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
    growth()


if __name__ == "__main__":
    main()
