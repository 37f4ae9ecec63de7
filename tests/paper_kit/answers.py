"""Results of the sample data, with few runs."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.workflow import Run

SAMPLES = Path(__file__).parents[2] / "sample_data"
FIELD, RECORDING = SAMPLES / "field", SAMPLES / "recording"
RUNS = 8


def run_of(
    dataset: Dataset,
    settings: CalibrationSettings | None = None,
    runs: int = RUNS,
    refined: RefineSettings | None = None,
) -> Run:
    """A result as `calibrate` makes it; without a refined set if `refined` is None."""
    run = Run(dataset, settings or CalibrationSettings(), refined)
    if runs:
        own = replace(run.settings, calibration_frames=None)
        with ThreadPoolExecutor(2) as executor:
            return run.validate(EvaluationSettings(own, runs, 20, refined=refined), executor)
    return run


@cache
def of_field() -> Run:
    """With a validation and a refined set."""
    return run_of(read_dataset(FIELD), refined=RefineSettings())


@cache
def of_recording() -> Run:
    """Without a validation; frames are left out."""
    return run_of(read_dataset(RECORDING), runs=0, refined=RefineSettings())
