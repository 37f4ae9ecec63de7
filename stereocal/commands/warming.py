"""`stereocal compile`: compilation of all numba functions ahead of their first use."""

import argparse
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from stereocal.commands.console import ProgressBar
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate_runs
from stereocal.frames.search import compile_detection
from stereocal.matching.matching import match_points
from stereocal.matching.view_groups import ViewFitter, match_views
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.rig_file import rig_file
from stereocal.refined.refine import refine
from stereocal.refined.uncertainty import accuracy_map
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import compilations
from stereocal.simulation.rigs import simulated_rig
from stereocal.simulation.simulate import simulate_field
from stereocal.system.tasks import Progress
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.tradeoff import trade_off
from stereocal.workflow import calibrate

FUNCTIONS = 118
"""Number of functions compiled with an empty cache; test_warming.py counts them."""


def run(_: argparse.Namespace) -> None:
    """Compile, with a progress bar."""
    with ProgressBar("functions compiled") as bar:
        compiled = compile_all(bar.show)
    if not compiled:
        print("Everything is compiled already.")


@cache
def compile_apart() -> None:
    """Compile what is not in the cache, in a process of its own, once.

    A process that has compiled functions rounds otherwise than those that load them, because the
    same function was optimised in several places: after 29 steps a refined pose differs by 1e-8.
    """
    command = [sys.executable, "-m", "stereocal", "compile"]
    package = Path(__file__).parents[2]
    subprocess.run(command, cwd=package, stdout=subprocess.DEVNULL, check=False)


def compile_all(progress: Progress | None = None) -> int:
    """Compile all functions, or load them from the cache.

    This takes half a minute of CPU time, and 2 s with a full cache.

    Args:
        progress: called with the number of functions compiled and their total; never if all are
            in the cache.

    Returns:
        The number of functions that were compiled.
    """
    compiled = 0

    def count(done: int) -> None:
        nonlocal compiled
        compiled = done
        if progress is not None:
            progress(min(done, FUNCTIONS - 1), FUNCTIONS)

    with compilations(count):
        _use_all()
    if compiled and progress is not None:
        progress(FUNCTIONS, FUNCTIONS)
    return compiled


def _use_all() -> None:
    _, dataset = simulate_field(seed=0)
    calibration = calibrate(dataset, trace=True, refined=None)
    assert calibration.errors
    rows = dataset.correspondences
    match_points(calibration.parameters("2d"), rows.primary, rows.secondary, 1.0)
    evaluate_runs(dataset, EvaluationSettings(refined=RefineSettings()), 0, [0])
    compile_detection()
    refined = refine(dataset, RefineSettings(), calibration.methods["essential"].pose)
    forecast_files(replace(calibration, refined=refined))
    accuracy_map(refined, size=4)
    trade_off(dataset, RefineSettings(), points=3)
    scene = simulated_rig(np.random.default_rng(0), 3, 60)
    rig = rig_file(calibrate_rig(scene.recording))
    match_views(ViewFitter(rig), [scene.recording.points[:1]] * len(rig.names), 1.0)
