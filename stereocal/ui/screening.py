"""The screenings of the data that pages look at, each made once."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from stereocal.calibration.methods import CalibrationSettings
from stereocal.fit.results import Calibration
from stereocal.fit.screening.screen import Screening, screened
from stereocal.rig.pair import Pair
from stereocal.system.latest import once
from stereocal.ui import jobs

MOST_AT_ONCE = 1500
"""Frames that calibrate in about a second, and so while a page is drawn."""


def is_long(dataset: Pair) -> bool:
    """Whether a recording takes seconds to calibrate, so that no draw of a page may wait for it."""
    return len(dataset.correspondences.frames) > MOST_AT_ONCE


def screenings_of(
    datasets: Sequence[Pair], settings: CalibrationSettings, calibration: Calibration | None = None
) -> list[Screening]:
    """The screenings of the project's data set, the first, and of further ones, cached.

    Frames put back and left out are those of the first.

    Args:
        calibration: the stored result: its screening is not made again.
    """
    for_others = replace(settings, frames_put_back=(), frames_left_out=())
    known = calibration and _key(calibration.dataset, calibration.settings)
    screenings = []
    for number, dataset in enumerate(datasets):
        used = for_others if number else settings
        if calibration is not None and known == _key(dataset, used):
            screenings.append(calibration.screening)
        else:
            make = partial(jobs.compute, screened, dataset, used)
            screenings.append(once("screening", _key(dataset, used), make))
    return screenings


def _key(dataset: Pair, settings: CalibrationSettings) -> str:
    """Includes name and notes, because messages show them."""
    names = ("all_frames", "frames_put_back", "frames_left_out", "time_offset", "time_drift")
    return json.dumps([*dataset.identity, *(getattr(settings, name) for name in names)])
