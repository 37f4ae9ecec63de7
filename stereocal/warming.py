"""All compiled code used once, so that nobody waits for it later."""

from __future__ import annotations

from pathlib import Path

from stereocal.calibrate import calibrate
from stereocal.evaluation import EvaluationSettings, evaluate_runs
from stereocal.formats.dataset_files import read_dataset
from stereocal.frames.search import compile_detection
from stereocal.matching import match_points
from stereocal.refine import refine
from stereocal.refined.disagreement import what_disagrees
from stereocal.refined.tradeoff import trade_off
from stereocal.refined.uncertainty import accuracy_map
from stereocal.refined.unknowns import RefineSettings


def compile_all(sample: Path) -> None:
    """Compile, or read from the cache, what the pages use.

    The very first time takes about half a minute of CPU time.

    Args:
        sample: a data set.
    """
    dataset = read_dataset(sample)
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
