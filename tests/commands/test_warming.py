"""After the server's start nobody waits for a compilation, and no time contains one."""

import os
import subprocess
import sys
from pathlib import Path

from tests.further import of_a_whole_soak

ROOT = Path(__file__).parents[2]
WORK = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
import numpy as np
from stereocal.commands.warming import compile_all

data = Path(sys.argv[1])
compile_all()

from stereocal.calibration.methods import CalibrationSettings
from stereocal.library.calibrations import calibrate
from stereocal.detection.detect import corner_near, detect_targets
from stereocal.evaluation.evaluate import EvaluationSettings, count_set, evaluate_runs
from stereocal.formats.dataset_files import read_dataset
from stereocal.system.photograph import read_photograph
from stereocal.matching.application import points_by_camera
from stereocal.matching.pairs import sample_frames
from stereocal.matching.names import NO_NAMES
from stereocal.matching.matching import nearest_errors
from stereocal.matching.threshold import choose_threshold
from stereocal.matching.reconstruction import midpoints
from stereocal.fit.refine import refine
from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.verdict.forecast import forecast_files
from stereocal.fit.errors.uncertainty import accuracy_map
from stereocal.fit.least_squares.unknowns import FIXED_LENS, RefineSettings
from stereocal.rig.camera import CAMERAS

def compiled():
    return {
        (one.py_func.__module__, one.py_func.__name__, str(signature))
        for one in gc.get_objects()
        if isinstance(one, Dispatcher) and one.py_func.__module__.startswith("stereocal")
        for signature in one.signatures
    }

before = compiled()
assert len(before) > 20
dataset = read_dataset(data / "nineteen" / "03")
found = calibrate(dataset, CalibrationSettings(essential="linear"), True, refined=RefineSettings())
found.errors
calibrate(dataset.of_frames(dataset.correspondences.frames[:3]))
evaluate_runs(dataset, EvaluationSettings(refined=RefineSettings()), 0, [0])
evaluate_runs(dataset, EvaluationSettings(), 0, [0])
count_set(dataset, found.methods["2d"].pose)
refine(dataset, RefineSettings(lenses=dict.fromkeys(CAMERAS, FIXED_LENS)))
refined = refine(dataset, RefineSettings())
compare_inputs(refined).inputs, accuracy_map(refined, size=5)
forecasts = forecast_files(found).of_files({})
rig, rows = found.parameters("2d", None, forecasts["2d"]), dataset.correspondences
midpoints(rig, np.stack([rows.primary, rows.secondary], axis=1), 0.2)
sample = sample_frames(*points_by_camera(dataset.recording).values())
frames = [NO_NAMES.samples(*own)[0] for own in sample]
nearest_errors(rig, frames, (0.0, float("inf"))), choose_threshold(rig, frames)
image = read_photograph(data / "photographs" / "primary" / "0001.jpg")
targets = detect_targets(image).targets
corner_near(image, tuple(targets[0].centre))
print(sorted(compiled() - before))
"""


def test_nothing_that_a_page_does_compiles_anything_more() -> None:
    words = [sys.executable, "-c", WORK, str(ROOT / "sample_data")]
    run = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
    assert run.stdout == "[]\n", run.stdout + run.stderr


COUNT = """
from stereocal.commands.warming import FUNCTIONS, compile_all
from stereocal.rig.compiled import _ON_DISK

shown = []
print(compile_all(lambda done, total: shown.append((done, total))) - FUNCTIONS)
assert shown[-1] == (FUNCTIONS, FUNCTIONS)
for folder, name in _ON_DISK:
    kinds = len(list(folder.glob(f"*/*.{name}-*.nbc")))
    if kinds != 1:
        print(name, kinds)
"""
OF_BOTH_LENSES = {
    *("_fill_errors", "cost", "count_pairs", "reprojection_cost"),
    *("reprojection_shift", "search"),
}
"""A fisheye has a scale of the pixels at each point."""
OF_CONSTANTS = ["_enlarged 3", "distort 3", "fill_plane 3", "fill_shared 6", "image_radius 2"]
OF_CONSTANTS += ["imaged_shift 2", "seen_in_air 4"]
"""numba compiles what is called with a constant for each constant."""
BEHIND_WINDOWS = {
    *("_fill_fits", "_fill_jacobians", "_off", "fill_by_window", "fill_residuals", "fit_unit"),
    *("length_innovations", "nearest_behind_windows", "photograph", "start_unit"),
    *("sum_normal_equations", "with_lenses", "work_of"),
}
"""In air they are compiled without windows."""


@of_a_whole_soak
def test_each_function_is_compiled_once_and_all_are(tmp_path: Path) -> None:
    """But those that two processes compile at the same time: at most a tenth."""
    words, empty = [sys.executable, "-c", COUNT], {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    run = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT, env=empty)
    beyond, *others = run.stdout.splitlines()
    assert abs(int(beyond)) <= 12
    assert sorted(others) == sorted(
        [*OF_CONSTANTS, *(f"{name} 2" for name in OF_BOTH_LENSES | BEHIND_WINDOWS)]
    )
