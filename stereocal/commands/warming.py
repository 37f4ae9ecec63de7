"""`stereocal compile`: compilation of all numba functions ahead of their first use.

Two processes share the work, by what they use: on two cores this takes half the time. They keep
what they compile in the cache, from which this process loads it.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.methods import errors_of
from stereocal.calibration.montecarlo import SearchSettings, reconstruction_problem, two_searches
from stereocal.calibration.offset_scan import Track, scan
from stereocal.commands.console import ProgressBar
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate_runs
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.errors.held_out import point_fits
from stereocal.fit.errors.uncertainty import accuracy_map, point_errors
from stereocal.fit.least_squares.small_steps import rig_at
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import fit_from
from stereocal.fit.rig_file import rig_file
from stereocal.frames.search import compile_detection
from stereocal.library.calibrations import calibrate
from stereocal.matching.matching import match_points
from stereocal.matching.pairs_of_rig import pairs_of
from stereocal.matching.view_groups import ViewFitter, match_views
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import compilations, uncompiled
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.window import Window
from stereocal.simulation.rigs import simulated_rig
from stereocal.simulation.simulate import Scene, observe, simulate_field
from stereocal.system import child_process
from stereocal.system.tasks import Progress
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.judging import judge_behind_windows, photograph

FUNCTIONS = 137
"""About as many are compiled with an empty cache; test_warming.py counts them."""
FEW_DRAWS, FEW_FRAMES = 4, 20
"""What is only loaded from the cache need not do much: more took 1.5 of 2.6 s."""
PACKAGE = Path(__file__).parents[2]


def run(_: argparse.Namespace) -> None:
    with ProgressBar("functions compiled") as bar:
        compiled = compile_all(bar.show)
    if not compiled:
        print("Everything is compiled already.")


def compile_all(progress: Progress | None = None) -> int:
    """Compile all functions, or load them from the cache.

    This takes 50 s of CPU time, and 2 s with a full cache. What was compiled elsewhere is loaded: a
    process that has compiled functions rounds otherwise than those that load them, because the same
    function was optimised in several places; after 29 steps a refined pose differs by 1e-8.

    Args:
        progress: called with the number of functions compiled and their total; never if all are
            in the cache.

    Returns:
        The number of functions that were compiled.
    """
    compiled = _compile_apart(progress) if uncompiled() else 0
    _load()
    return compiled


@cache
def _load() -> None:
    """Use all that is compiled, once in a process: what is loaded stays."""
    for use in PARTS.values():
        use()


def _compile_apart(progress: Progress | None) -> int:
    """Compile each part in a process of its own, all at once; they say how far they are."""
    done = dict.fromkeys(PARTS, 0)
    reading, writing = os.pipe()
    with os.fdopen(reading, encoding="utf-8") as lines:
        run_child = [sys.executable, "-m", child_process.__name__, __name__]
        commands = [[*run_child, part] for part in PARTS]
        streams: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": writing}
        # Ctrl-C is for this process, which ends them: in their imports they would say where.
        streams["start_new_session"] = True
        processes = [subprocess.Popen(command, cwd=PACKAGE, **streams) for command in commands]
        os.close(writing)
        try:
            for line in lines:
                part, count = line.split()
                done[part] = int(count)
                if progress is not None:
                    progress(min(sum(done.values()), FUNCTIONS - 1), FUNCTIONS)
        finally:  # also after Ctrl-C
            for process in processes:
                process.terminate()
                process.communicate()
    if progress is not None:
        progress(FUNCTIONS, FUNCTIONS)
    return sum(done.values())


def _say(part: str, count: int) -> None:
    # Written at once, whatever the buffer of stdout: else lines of two processes are mixed.
    try:
        sys.stdout.write(f"{part} {count}\n")
        sys.stdout.flush()
    except BrokenPipeError:  # who began this has ended
        os._exit(1)


def _recordings() -> tuple[Scene, list[Pair]]:
    """One with usual lenses, of this scene, and one with fisheyes."""
    scene, dataset = simulate_field(seed=0)
    rig = scene.rig
    fisheyes = replace(rig, primary=_fisheye(rig.primary), secondary=_fisheye(rig.secondary))
    seen = observe(replace(scene, rig=fisheyes), np.random.default_rng(0), 0.5, "fisheye")
    return scene, [dataset, seen]


def _fisheye(camera: Camera) -> Camera:
    return replace(camera, distortion=np.array([0.04, -0.01, 0.0, 0.0]), model="fisheye")


def _use_searches() -> None:
    """The essential matrix, the paper's searches, those for offsets and for targets."""
    for dataset in _recordings()[1]:
        distances = reconstruction_problem(dataset)
        rays, baseline = dataset.rays, dataset.baseline_m
        start = calibrate_essential(rays, baseline, tie_breaker=distances.cost).pose
        two_searches(dataset, start, SearchSettings(), trace=True)
        errors_of(dataset, start)
    track = Track(0, np.random.default_rng(0).normal(size=(60, 2, 2)))
    scan(track, track, np.zeros(1, dtype=np.int64))
    compile_detection()
    _use_windows()


def _use_refined() -> None:
    """The refined method for two cameras and more, evaluation, forecast and matching."""
    scene, datasets = _recordings()
    # Without a search for a start, which the other part compiles meanwhile.
    fit_from(datasets[0], scene.rig.pose, RefineSettings()).run()
    calibration = calibrate(datasets[0], refined=RefineSettings())
    assert calibration.refined is not None
    forecast_files(calibration, draws=FEW_DRAWS)
    accuracy_map(calibration.refined, size=4)
    rows = datasets[0].correspondences
    match_points(calibration.parameters("2d"), rows.primary, rows.secondary, 1.0)
    for dataset in datasets:
        evaluate_runs(dataset, EvaluationSettings(), 0, [0])
    scene_of_rig = simulated_rig(np.random.default_rng(0), 3, FEW_FRAMES)
    rig, points = rig_file(calibrate_rig(scene_of_rig.recording)), scene_of_rig.recording.points
    match_views(ViewFitter(rig), [points[:1]] * len(rig.names), 1.0)


def _use_windows() -> None:
    """What is behind windows, which numba compiles apart."""
    scene, window = simulate_field(seed=0)[0], Window((0.0, 0.0, 1.0), 0.5, 0.01)
    rig = Rig(
        replace(_wide(scene.rig.primary), window=window),
        replace(_wide(scene.rig.secondary), window=window),
        scene.rig.pose,
    )
    dataset = observe(replace(scene, rig=rig), np.random.default_rng(0), 0.1, "water")
    fit = fit_from(dataset, rig.pose, RefineSettings())
    fit.run()
    point_fits(fit.at, fit.seen)
    rows = dataset.correspondences
    pixels = np.empty((len(rows), 4))
    photograph(rig_at(rig), scene.ends_m.reshape(-1, 3), pixels)
    judge_behind_windows(
        [rig], pixels, dataset.bar_distances_m, np.arange(len(rows)).reshape(-1, 1)
    )
    point_errors(rig_at(rig), 0.1, scene.ends_m[0])
    rays = rig.primary.rays_of(rows.primary), rig.secondary.rays_of(rows.secondary)
    pairs_of(rig, *rays, 1.0, 0.0, np.inf)


def _wide(camera: Camera) -> Camera:
    """With a focal length so short that the scene is in view through water."""
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= 0.6
    return replace(camera, K=K)


PARTS: Mapping[str, Callable[[], None]] = {"searches": _use_searches, "refined": _use_refined}

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who began this also ends it
    if hasattr(os, "nice"):  # pages and commands come first
        os.nice(5)
    with compilations(partial(_say, sys.argv[1])):
        PARTS[sys.argv[1]]()
