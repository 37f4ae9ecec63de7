"""Results of the sample data, with few runs."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import Evaluation
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.verdict.forecast import outlook_of
from stereocal.workflow import Answer, answer, calibrate

SAMPLES = Path(__file__).parents[2] / "sample_data"
FIELD, RECORDING = SAMPLES / "field", SAMPLES / "recording"
RUNS = 8


def answer_of(
    dataset: Dataset,
    settings: CalibrationSettings | None = None,
    runs: int = RUNS,
    refined: RefineSettings | None = None,
) -> Answer:
    """A result as `calibrate` makes it; without a refined set if `refined` is None."""
    found = calibrate(dataset, settings, refined=refined)
    evaluation = None
    if runs:
        kept = found.screening.dataset
        own = replace(found.settings, calibration_frames=None)
        protocol = EvaluationSettings(own, runs, 20, refined)
        with ThreadPoolExecutor(2) as executor:
            done = evaluate([kept], protocol, executor)
        evaluation = Evaluation(done, protocol, [kept.name], [dataset.sha256])
    return answer(found, outlook_of(found), evaluation)


@cache
def of_field() -> Answer:
    """With a validation and a refined set."""
    return answer_of(read_dataset(FIELD), refined=RefineSettings())


@cache
def of_recording() -> Answer:
    """Without a validation; frames are left out."""
    return answer_of(read_dataset(RECORDING), runs=0, refined=RefineSettings())
