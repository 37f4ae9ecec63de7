"""A finished calibration as JSON: settings, results, and the inputs it was computed from."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from stereocal.calibration.methods import METHODS, CalibrationSettings, Method
from stereocal.calibration.montecarlo import Trace
from stereocal.calibration.results import MethodResult
from stereocal.errors import DAMAGED, StereocalError
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.tracks import MeasuredOffset, TimeOffset

CALIBRATION_FORMAT = "stereocal-project/1"
LONGEST_TRACE = 50_000
"""Longer traces of a search are not stored: 2 million moves made a file of 183 MB."""
TRACE = ("cost", "delta", "ratio")
_DAMAGED = "The last result of this project cannot be read; calibrate again."


def pack_calibration(calibration: Calibration, inputs: Mapping[str, Any]) -> bytes:
    """A calibration as JSON.

    Args:
        inputs: the files and lengths it was computed from, for `unpack_calibration`.
    """
    content = {
        "format": CALIBRATION_FORMAT,
        "inputs": inputs,
        "dataset_sha256": calibration.dataset.sha256,
        "settings": calibration.settings.to_json(),
        "screening": {
            name: getattr(calibration.screening, name)
            for name in (
                "left_out",
                "exchanged",
                "by_user",
                "together",
                "failure",
                "noise_px",
                "time_note",
            )
        }
        | _times_to_json(calibration.screening),
        "frames": calibration.frames.tolist(),
        "warnings": list(calibration.warnings),
        "methods": {name: _to_json(found) for name, found in calibration.methods.items()},
    }
    return json.dumps(content, allow_nan=False).encode()


def unpack_calibration(
    content: bytes, dataset_of: Callable[[Mapping[str, Any]], Dataset]
) -> Calibration:
    """The inverse of `pack_calibration`.

    Args:
        dataset_of: returns the data set of the `inputs`.

    Raises:
        StereocalError: the content is damaged, or its data have been removed.
    """
    try:
        data = json.loads(content)
        dataset = dataset_of(data["inputs"])
        if dataset.sha256 != data["dataset_sha256"]:
            raise StereocalError("The result and its data do not belong together.")
        methods = {name: _from_json(data["methods"][name]) for name in METHODS}
        frames = np.array(data["frames"], dtype=np.int64)
        if frames.ndim != 1 or any(found.method != name for name, found in methods.items()):
            raise ValueError(frames)
        screening = _screening(dataset, data.get("screening", {}))
        return Calibration(
            dataset=screening.full_dataset,
            settings=CalibrationSettings.from_json(data["settings"]),
            screening=screening,
            frames=frames,
            methods=methods,
            warnings=tuple(str(text) for text in data["warnings"]),
        )
    except DAMAGED as error:
        raise StereocalError(_DAMAGED) from error


def _screening(dataset: Dataset, data: Mapping[str, Any]) -> Screening:
    """The screening without its fit, which is not stored."""
    left_out, exchanged, by_user = (
        tuple(int(frame) for frame in data.get(name, ()))
        for name in ("left_out", "exchanged", "by_user")
    )
    together, failure = (str(data.get(name, "")) for name in ("together", "failure"))
    noise, offset, measured = (
        data.get(name) for name in ("noise_px", "time_offset", "measured_offset")
    )
    if offset is not None:
        dataset = dataset.shifted(TimeOffset(**offset))
    return Screening(
        dataset,
        None,
        left_out,
        exchanged,
        together,
        failure,
        None if noise is None else float(noise),
        by_user,
        None if measured is None else MeasuredOffset(**measured),
        str(data.get("time_note", "")),
    )


def _times_to_json(screening: Screening) -> dict[str, Any]:
    """By how much the points were shifted in time, and what was measured."""
    found = screening.full_dataset.time_offset, screening.measured_offset
    return {
        name: None if value is None else asdict(value)
        for name, value in zip(("time_offset", "measured_offset"), found, strict=True)
    }


def _to_json(found: MethodResult) -> dict[str, Any]:
    trace = found.trace
    return {
        **{
            name: getattr(found, name)
            for name in ("method", "cost", "evaluations", "stop_reason", "seconds")
        },
        "R": found.pose.R.tolist(),
        "T": found.pose.T.tolist(),
        "trace": None
        if trace is None or len(trace.cost) > LONGEST_TRACE
        else {name: getattr(trace, name).tolist() for name in TRACE},
    }


def _from_json(data: Mapping[str, Any]) -> MethodResult:
    method: Method = data["method"]
    trace = data["trace"]
    numbers = [data["cost"], data["seconds"]]
    columns = [np.array(trace[name], float) for name in TRACE] if trace is not None else []
    if not np.isfinite(np.array(numbers, float)).all() or len({len(each) for each in columns}) > 1:
        raise ValueError(numbers)
    return MethodResult(
        method=method,
        pose=Pose(np.array(data["R"], float), np.array(data["T"], float)),
        cost=float(data["cost"]),
        evaluations=int(data["evaluations"]),
        stop_reason=str(data["stop_reason"]),
        seconds=float(data["seconds"]),
        trace=None if trace is None else Trace(*columns),
    )
