"""A finished calibration as JSON: settings, results, and the inputs it was computed from."""

import json
import math
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import fields, make_dataclass, replace
from typing import Any, get_type_hints

from stereocal.calibration.methods import METHODS, CalibrationSettings, Method
from stereocal.calibration.montecarlo import MethodResult
from stereocal.errors import StereocalError, damaged
from stereocal.fit.least_squares.small_steps import OF_PAIR
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.results import Calibration
from stereocal.fit.screening.screen import Screening
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.tracks import TimeOffset
from stereocal.system.array_types import IntArray
from stereocal.system.records import of_plain, pack

CALIBRATION_FORMAT = "stereocal-project/1"
STORED = ("frames", "warnings", "methods", "out_of_step", "focal_changes")
LONGEST_TRACE = 50_000
"""Longer traces of a search are not stored: 2 million moves made a file of 183 MB."""
_NO_SCREENING = {"left_out": (), "exchanged": (), "together": ""}
"""The screening of results from before there was one."""


def _without(kind: type, names: Collection[str]) -> Any:
    """A dataclass with the fields of another but these, which the data set gives."""
    hints = get_type_hints(kind)
    kept_fields = [field for field in fields(kind) if field.name not in names]
    return make_dataclass(
        f"Stored{kind.__name__}", [(field.name, hints[field.name], field) for field in kept_fields]
    )


_REFINED = _without(RefinedResult, ["dataset", "settings"])
_SCREENING = _without(Screening, ["full_dataset", "fit"])


def as_stored(calibration: Calibration) -> Calibration:
    """The calibration as it is stored: without long traces and the fit of the screening."""
    methods = dict(calibration.methods)
    for name, result in methods.items():
        if result.trace and len(result.trace.cost) > LONGEST_TRACE:
            methods[name] = replace(result, trace=None)
    return replace(calibration, methods=methods, screening=replace(calibration.screening, fit=None))


def pack_calibration(calibration: Calibration, inputs: Mapping[str, Any]) -> bytes:
    """A calibration as JSON.

    Args:
        inputs: the files and lengths it was computed from, for `unpack_calibration`.
    """
    screening = calibration.screening
    content = {
        "format": CALIBRATION_FORMAT,
        "inputs": inputs,
        "dataset_sha256": calibration.dataset.sha256,
        "settings": calibration.settings.to_json(),
        "screening": _named(screening, _SCREENING)
        | {"time_offset": screening.full_dataset.time_offset},
        **{name: getattr(calibration, name) for name in STORED},
        "refined": (refined := calibration.refined)
        and {**_named(refined, _REFINED), "settings": refined.settings.to_json()},
    }
    return pack(content)


def _named(value: Any, kind: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(kind)}


def unpack_calibration(
    content: bytes, dataset_of: Callable[[Mapping[str, Any]], Pair]
) -> Calibration:
    """The inverse of `pack_calibration`.

    Args:
        dataset_of: returns the data set of the `inputs`.
    """
    with damaged("The last result of this project cannot be read; calibrate again."):
        data = json.loads(content)
        dataset = dataset_of(data["inputs"])
        # A baseline that is free is found anew, in another version in its last digits too.
        if dataset.sha256 != data["dataset_sha256"] and not dataset.baseline_is_free:
            raise StereocalError("The result and its data do not belong together.")
        stated = data.get("screening", _NO_SCREENING)
        if (offset := stated.get("time_offset")) is not None:
            dataset = dataset.shifted(of_plain(offset, TimeOffset))
        screening = Screening(full_dataset=dataset, fit=None, **vars(of_plain(stated, _SCREENING)))
        calibration = Calibration(
            dataset=screening.full_dataset,
            settings=CalibrationSettings.from_json(data["settings"]),
            screening=screening,
            frames=of_plain(data["frames"], IntArray),
            methods={name: _method(data["methods"][name], name) for name in METHODS},
            warnings=of_plain(data["warnings"], tuple[str, ...]),
            out_of_step=data.get("out_of_step", False) is True,
            focal_changes=data.get("focal_changes", False) is True,
        )
        if calibration.frames.ndim != 1:
            raise ValueError(calibration.frames)
        if "refined" not in data:  # version 1.0 did not store the refined set
            fitted_data, used_settings = calibration.dataset, calibration.settings
            return _refined_again(
                calibration,
                RefineSettings(
                    baseline_sigma_m=fitted_data.baseline_sigma_m,
                    distance_sigma_m=fitted_data.target_distance_sigma_m,
                    time_offset=used_settings.time_offset,
                    time_drift=used_settings.time_drift,
                ),
            )
        if data["refined"] is None:
            return calibration
        stored = of_plain(data["refined"], _REFINED)
        settings = RefineSettings.from_json(data["refined"]["settings"])
        if len(stored.information) != OF_PAIR:  # earlier versions had other unknowns
            return _refined_again(calibration, settings, stored.pose)
        refined = RefinedResult(dataset=calibration.fitted, settings=settings, **vars(stored))
        return replace(calibration, refined=refined)


def _refined_again(
    calibration: Calibration, settings: RefineSettings, start: Pose | None = None
) -> Calibration:
    """A result of an earlier version with its refined set, where there is one."""
    with suppress(StereocalError):
        return replace(calibration, refined=refine(calibration.fitted, settings, start))
    return calibration


def _method(data: Mapping[str, Any], name: Method) -> MethodResult:
    # Results of version 1.0 have the pose's two entries among their own.
    result = of_plain({"pose": {key: data.get(key) for key in "RT"}, **data}, MethodResult)
    finite = math.isfinite(result.cost) and math.isfinite(result.seconds)
    sound = finite and data.get("method", name) == name
    trace = result.trace
    if not sound or (trace and not len(trace.cost) == len(trace.delta) == len(trace.ratio)):
        raise ValueError(name)
    return result
