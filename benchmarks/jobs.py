"""What it costs to keep what a job has finished, and how long a few runs wait beside many.

python -m benchmarks.jobs
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.evaluation.evaluate import EvaluationSettings, evaluate, evaluate_runs
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import pack_runs, unpack_runs
from stereocal.frames.search import pack_detection, unpack_detection
from stereocal.frames.series import detect_series
from stereocal.projects import jobs
from stereocal.projects.jobs import Checkpoints
from stereocal.projects.project import Project
from stereocal.refined.unknowns import RefineSettings

SAMPLES = Path(__file__).parents[1] / "sample_data"
WORKERS = 2
REPEATS = 5


def overhead(
    work: Callable[..., Any], pack: Callable[[Any], bytes | None], unpack: Callable[[bytes], Any]
) -> tuple[float, float]:
    """CPU seconds of work, and of the thread that drives it more when all of it is kept.

    Args:
        work: is called with progress and, where it is to be kept, the parts.
    """
    before, own = time.process_time(), time.thread_time()
    work(None, None)
    whole, plain = time.process_time() - before, time.thread_time() - own
    with tempfile.TemporaryDirectory() as folder:
        own = time.thread_time()
        job = jobs.begin(Project.create(Path(folder)).database, "benchmark", ("pieces",), {})
        assert job is not None
        parts: Checkpoints[Any] = job.checkpoints("pieces", pack, unpack)
        work(lambda done, total: job.progress(0, done, total), parts)
        job.end()
        return whole, time.thread_time() - own - plain


def waiting(pool: Executor, is_alone: bool) -> float:
    """Seconds until 10 runs are done, beside 500 of another where they are not alone."""
    dataset, stop = read_dataset(SAMPLES / "field"), threading.Event()
    settings = [EvaluationSettings(runs=n, refined=RefineSettings()) for n in (500, 10)]
    thread = threading.Thread(
        target=lambda: is_alone or evaluate([dataset], settings[0], pool, None, stop.is_set)
    )
    thread.start()
    time.sleep(0.3)
    begun = time.perf_counter()
    evaluate([dataset], settings[1], pool)
    seconds = time.perf_counter() - begun
    stop.set()
    thread.join()
    return seconds


def main() -> None:
    """Measure and print."""
    dataset = read_dataset(SAMPLES / "nineteen" / "07")
    settings = EvaluationSettings(runs=500, refined=RefineSettings())
    evaluate_runs(dataset, settings, 0, [0])
    folder = SAMPLES / "photographs"
    # Names tell the content in a project's folder; here they must not be alike.
    paths = [*(folder / "primary").iterdir(), *(folder / "boards_primary").iterdir()][:25]
    photographs = {str(path): path for path in paths}
    with ThreadPoolExecutor(WORKERS) as threads:
        runs = [
            overhead(
                lambda progress, parts: evaluate(
                    [dataset], settings, threads, progress, pieces=parts
                ),
                pack_runs,
                unpack_runs,
            )
            for _ in range(REPEATS)
        ]
        found = [
            overhead(
                lambda progress, parts: detect_series(photographs, threads, progress, pieces=parts),
                pack_detection,
                unpack_detection,
            )
            for _ in range(REPEATS)
        ]
    for what, figures in (("500 runs", runs), (f"{len(photographs)} photographs", found)):
        whole, more = np.array(figures).T
        share = 100 * more / whole
        print(
            f"{what}: {whole.mean():.2f} s of CPU time, keeping them "
            f"{share.min():.2f} to {share.max():.2f} % more"
        )
    for name in ("alone", "beside 500"):
        seconds = []
        for _ in range(REPEATS):
            with ThreadPoolExecutor(WORKERS) as pool:
                seconds.append(waiting(pool, is_alone=name == "alone"))
        print(f"10 runs {name}: {min(seconds):.2f} to {max(seconds):.2f} s")
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
