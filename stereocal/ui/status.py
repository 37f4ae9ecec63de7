"""Whether a result is still current for the form and the data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stereocal.calibration.methods import CalibrationSettings
from stereocal.refined.results import Calibration
from stereocal.rig.dataset import Dataset

NAMES = {
    "delta": "Δ",
    "delta_min": "Δ min",
    "acceptance": "acceptance ratio",
    "shrink": "shrink factor",
    "minimum_moves": "minimum moves",
    "seed": "seed",
    "essential": "essential solver",
    "calibration_frames": "calibration frames",
    "all_frames": "trust in every frame",
    "time_offset": "time offset",
    "time_drift": "its drift",
    "frames_put_back": "frames put back",
    "frames_left_out": "frames left out",
}

_FRAMES = ("all_frames", "frames_put_back", "frames_left_out", "time_offset", "time_drift")
"""Shown with the frames left out and the time offset, not in the line of settings."""


def staleness(result: Calibration, dataset: Dataset, values: Mapping[str, Any]) -> str | None:
    """What has changed since the result, as a sentence; None if nothing has."""
    if result.dataset.sha256 != dataset.sha256:
        return (
            "The data have changed since this result. Press Calibrate for the new data; until then "
            "the old result stays."
        )
    if _known(result.dataset) != _known(dataset):
        return (
            "The uncertainties of the lengths have changed since this result. "
            "Press Calibrate to renew its refined set."
        )
    made_with = result.settings.to_json()
    changed = [NAMES[key] for key, value in values.items() if made_with[key] != value]
    if not changed:
        return None
    return (
        f"The form has changed since this result ({', '.join(changed)}). It still shows the result "
        "of the settings named below it. Press Calibrate to renew it."
    )


def _known(dataset: Dataset) -> tuple[float | None, float | None]:
    return dataset.baseline_sigma_m, dataset.target_distance_sigma_m


def describe_settings(settings: CalibrationSettings) -> str:
    """The settings of a search, in one line."""
    return ", ".join(
        f"{NAMES[key]} {value:g}" if isinstance(value, float) else f"{NAMES[key]} {value}"
        for key, value in settings.to_json().items()
        if key in NAMES and key not in ("calibration_frames", *_FRAMES)
    )
