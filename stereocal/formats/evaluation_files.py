"""Store evaluations: `summary.json` for scripts, and the counts for a project."""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError, damaged
from stereocal.evaluation.counting import BINS
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts
from stereocal.evaluation.summary import MethodSummary, summarise
from stereocal.fit.screening.screen import Screening
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import ForecastEntries
from stereocal.system.arrays import Array, read_arrays, shaped
from stereocal.system.atomic_files import read_whole
from stereocal.system.json_text import read_json
from stereocal.version import __version__

SUMMARY_FORMAT = "stereocal-summary/1"
METHOD_COUNTS = (3, 4)
"""Without (old files) and with the refined method."""


def summary_json(
    pooled: Mapping[Method, MethodSummary],
    by_dataset: Mapping[str, Mapping[Method, MethodSummary]],
    datasets: Sequence[Pair],
    settings: EvaluationSettings,
    screenings: Sequence[Screening] = (),
    forecasts: Sequence[Mapping[Method, ForecastEntries]] = (),
) -> bytes:
    """`summary.json`: all figures pooled and by data set; errors as fractions, angles in rad.

    Args:
        datasets: with all frames, before screening.
        screenings: of the data sets, in order; empty if there was none.
        forecasts: of the files that `calibrate` writes, by data set, each possibly empty.
    """
    figures_of_datasets = list(forecasts) or [{} for _ in datasets]
    screened: list[dict[str, Any]] = [
        {
            "frames_left_out": list(screening.left_out),
            **(screening.measured_offset.to_json() if screening.measured_offset else {}),
        }
        for screening in screenings
    ] or [{"frames_left_out": []} for _ in datasets]
    content = {
        "format": SUMMARY_FORMAT,
        "methods": _with_forecasts(pooled, figures_of_datasets[0] if len(datasets) == 1 else {}),
        "datasets": [
            {
                "name": name,
                "frames": len(dataset.correspondences.frames),
                "pairs": len(dataset.correspondences),
                "bars": len(dataset.correspondences.bars),
                "baseline_m": dataset.baseline_m,
                "target_distance_m": dataset.target_distance_m,
                "sha256": dataset.sha256,
                **screening,
                "methods": _with_forecasts(summary, forecast),
            }
            for (name, summary), dataset, screening, forecast in zip(
                by_dataset.items(), datasets, screened, figures_of_datasets, strict=True
            )
        ],
        "settings": settings.to_json(),
        "software": {"stereocal": __version__, "numpy": np.__version__},
    }
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def _with_forecasts(
    summaries: Mapping[Method, MethodSummary], forecasts: Mapping[Method, ForecastEntries]
) -> dict[str, Any]:
    """The figures by method, with those forecast under `predicted`."""
    figures: dict[str, Any] = {method: summary.to_json() for method, summary in summaries.items()}
    for method, forecast in forecasts.items():
        if method in figures:
            figures[method]["predicted"] = dict(forecast.figures)
    return figures


def validation_figures(
    pooled: Mapping[Method, MethodSummary], settings: EvaluationSettings
) -> dict[str, dict[str, Any]]:
    """The entry on the validation in the parameter files, by method: figures and protocol."""
    protocol = {"runs": settings.runs, "calibration_frames": settings.calibration_frames}
    return {method: {**protocol, **summary.to_json()} for method, summary in pooled.items()}


def validation_in_summary(path: Path, dataset: Pair) -> dict[str, dict[str, Any]]:
    """The result of `validation_figures` for a data set, from a `summary.json`."""
    content = read_json(read_whole(path), str(path))
    with damaged("this is not a summary.json of evaluate.", source=str(path)):
        known = {entry["sha256"]: entry["methods"] for entry in content["datasets"]}
        protocol = {name: content["settings"][name] for name in ("runs", "calibration_frames")}
    if dataset.sha256 not in known:
        raise StereocalError(f"{path}: it does not contain the data set {dataset.name}.")
    return {method: {**protocol, **figures} for method, figures in known[dataset.sha256].items()}


def unique_names(datasets: Sequence[Pair]) -> list[str]:
    """The names of data sets, with a number added to duplicates."""
    names: list[str] = []
    for dataset in datasets:
        name, copy = dataset.name, 2
        while name in names:
            name, copy = f"{dataset.name} ({copy})", copy + 1
        names.append(name)
    return names


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The runs of a finished evaluation, with their settings and data sets."""

    runs: Sequence[Sequence[RunCounts]]
    settings: EvaluationSettings
    names: Sequence[str]
    sha256: Sequence[str]
    """One name and one digest for each data set, in order."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content: equal for an evaluation that was read again."""
        digest = hashlib.sha256()  # uncompressed, which takes a tenth of the time
        for name, array in _content(self).items():
            digest.update(f"{name} {array.shape} {array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def is_of(self, datasets: Sequence[Pair]) -> bool:
        """Whether it is of these data sets, in this order."""
        return list(self.sha256) == [dataset.sha256 for dataset in datasets]

    @cached_property
    def summaries(self) -> dict[Method, MethodSummary]:
        """The figures by method, all data sets pooled."""
        return summarise(self.runs)


def pack_evaluation(evaluation: Evaluation) -> bytes:
    """An evaluation as one compressed file of plain arrays."""
    packed = io.BytesIO()
    np.savez_compressed(packed, **_content(evaluation))
    return packed.getvalue()


def _content(evaluation: Evaluation) -> dict[str, Any]:
    header = {
        "settings": evaluation.settings.to_json(),
        "names": list(evaluation.names),
        "sha256": list(evaluation.sha256),
    }
    arrays: dict[str, Any] = {"about": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
    for number, runs in enumerate(evaluation.runs):
        for name in ("counts", "nans", "angles", "correct_px"):
            arrays[f"{name}{number}"] = np.array([getattr(run, name) for run in runs])
        # The number of bars may differ between runs: frames with one target have none.
        arrays[f"bars{number}"] = np.array([run.lengths.shape[1] for run in runs])
        arrays[f"lengths{number}"] = np.concatenate([run.lengths for run in runs], axis=1)
    return arrays


def unpack_evaluation(content: bytes) -> Evaluation:
    """The evaluation of `pack_evaluation`."""
    with damaged("The last validation cannot be read; validate again."):
        arrays = read_arrays(content, "evaluation.npz")
        header = json.loads(arrays["about"].tobytes())
        names, digests = ([str(text) for text in header[key]] for key in ("names", "sha256"))
        if len(names) != len(digests):
            raise ValueError(names)
        runs = [_runs(arrays, k) for k in range(len(names))]
        return Evaluation(runs, EvaluationSettings.from_json(header["settings"]), names, digests)


def _runs(arrays: Mapping[str, Array], number: int) -> list[RunCounts]:
    """The runs of one data set."""
    counts = shaped(arrays[f"counts{number}"], "iu", None, None, 2, 2, BINS + 2).astype(np.int32)
    count, methods = counts.shape[:2]
    bars = shaped(arrays[f"bars{number}"], "iu", count)
    lengths = shaped(arrays[f"lengths{number}"], "f", methods, int(bars.sum()))
    nans = shaped(arrays[f"nans{number}"], "iu", count, methods, 2)
    angles = shaped(arrays[f"angles{number}"], "f", count, methods, 5)
    # Missing in validations from before the refined method.
    px = arrays.get(f"correct_px{number}", np.full((count, methods), np.nan))
    px = shaped(px, "f", count, methods)
    if not count or methods not in METHOD_COUNTS or min(bars.min(), counts.min(), nans.min()) < 0:
        raise ValueError(counts.shape)
    parts = np.split(lengths, np.cumsum(bars)[:-1], axis=1)
    return [RunCounts(*run) for run in zip(counts, nans, parts, angles, px, strict=True)]
