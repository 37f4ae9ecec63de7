"""The sample data set `field`, calibrated once in a process."""

from functools import cache
from pathlib import Path

from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import CalibrationRun, calibrate

FIELD = Path(__file__).parents[1] / "sample_data" / "field"


@cache
def calibrated_field() -> CalibrationRun:
    """With the usual settings; not to be changed."""
    return calibrate(read_dataset(FIELD))
