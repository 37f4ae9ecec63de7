"""All compiled code used once, so that nobody waits for it later."""

from __future__ import annotations

from collections.abc import Callable

from stereocal.evaluation.evaluate import EvaluationSettings, evaluate_runs
from stereocal.frames.search import compile_detection
from stereocal.matching.matching import match_points
from stereocal.refined.disagreement import what_disagrees
from stereocal.refined.refine import refine
from stereocal.refined.uncertainty import accuracy_map
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compilations import compilations
from stereocal.simulation.simulate import simulate_field
from stereocal.verdict.tradeoff import trade_off
from stereocal.workflow import calibrate

FUNCTIONS = 98
"""So many are compiled where nothing is in the cache; test_warming.py counts them."""
Progress = Callable[[int, int], None]


def compile_all(progress: Progress | None = None) -> int:
    """Compile, or read from the cache, what the pages use.

    From nothing this takes half a minute of CPU time, from the cache 2 s.

    Args:
        progress: called with the number of functions compiled and to compile, first when one
            begins; never where all are in the cache.

    Returns:
        The number of functions that were compiled.
    """
    compiled = 0

    def heard(done: int) -> None:
        nonlocal compiled
        compiled = done
        if progress is not None:
            progress(min(done, FUNCTIONS - 1), FUNCTIONS)

    with compilations(heard):
        _use_all()
    if compiled and progress is not None:
        progress(FUNCTIONS, FUNCTIONS)
    return compiled


def _use_all() -> None:
    _, dataset = simulate_field(seed=0)
    calibration = calibrate(dataset, trace=True)
    assert calibration.errors
    rows = dataset.correspondences
    match_points(calibration.parameters("2d"), rows.primary, rows.secondary, 1.0)
    evaluate_runs(dataset, EvaluationSettings(refined=RefineSettings()), 0, [0])
    compile_detection()
    refined = refine(dataset, RefineSettings(), calibration.methods["essential"].pose)
    what_disagrees(refined)
    accuracy_map(refined, size=4)
    trade_off(dataset, RefineSettings(), points=3)
