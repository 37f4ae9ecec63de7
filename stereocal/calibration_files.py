"""A finished calibration as a file: its settings, its results, and what it was made from."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from stereocal.calibrate import Calibration, CalibrationSettings, Method, MethodResult
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.geometry import Pose
from stereocal.montecarlo import Trace

CALIBRATION_FORMAT = "stereocal-project/1"
LONGEST_TRACE = 50_000
"""Moves of a search that are kept to be drawn; 2 million made a file of 183 MB."""
_DAMAGED = "The last result of this project cannot be read; calibrate again."


def pack_calibration(calibration: Calibration, inputs: Mapping[str, Any]) -> bytes:
    """A calibration as JSON.

    Args:
        inputs: which files and lengths it was made from, for `unpack_calibration`.
    """
    content = {
        "format": CALIBRATION_FORMAT,
        "inputs": inputs,
        "dataset_sha256": calibration.dataset.sha256,
        "settings": calibration.settings.to_json(),
        "frames": calibration.frames.tolist(),
        "warnings": list(calibration.warnings),
        "methods": {name: _to_json(found) for name, found in calibration.methods.items()},
    }
    return json.dumps(content, allow_nan=False).encode()


def unpack_calibration(
    content: bytes, dataset_of: Callable[[Mapping[str, Any]], Dataset]
) -> Calibration:
    """The calibration that `pack_calibration` packed.

    Args:
        dataset_of: the data set of the `inputs`.

    Raises:
        StereocalError: the content is damaged, or its data are not there any more.
    """
    try:
        data = json.loads(content)
        dataset = dataset_of(data["inputs"])
        if dataset.sha256 != data["dataset_sha256"]:
            raise StereocalError("The result and its data do not belong together.")
        return Calibration(
            dataset=dataset,
            settings=CalibrationSettings.from_json(data["settings"]),
            frames=np.array(data["frames"], dtype=np.int64),
            methods={name: _from_json(found) for name, found in data["methods"].items()},
            warnings=tuple(data["warnings"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise StereocalError(_DAMAGED) from error


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
        else {name: getattr(trace, name).tolist() for name in ("cost", "delta", "ratio")},
    }


def _from_json(data: Mapping[str, Any]) -> MethodResult:
    method: Method = data["method"]
    trace = data["trace"]
    return MethodResult(
        method=method,
        pose=Pose(np.array(data["R"]), np.array(data["T"])),
        cost=float(data["cost"]),
        evaluations=int(data["evaluations"]),
        stop_reason=str(data["stop_reason"]),
        seconds=float(data["seconds"]),
        trace=None if trace is None else Trace(*(np.array(trace[k]) for k in trace)),
    )
