"""The parameter files of a rig's pairs: the refined set of the rig, and the paper's two sets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.network.pair_of_rig import pair_dataset, pair_name, pair_parameters
from stereocal.network.pairs import Progress
from stereocal.network.result import RigCalibration
from stereocal.refined.unknowns import FIXED_LENS, RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import Pair, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.verdict.forecast import outlook_of
from stereocal.workflow import answer, calibrate

FIGURES = ("fcp_reprojection", "median_error_3d", "p95_error_3d", "threshold_px")


def files_of_pairs(
    rig: RigCalibration, paper: bool = False, progress: Progress | None = None
) -> tuple[dict[str, bytes], dict[Pair, dict[str, Any]], list[str]]:
    """The files by name, figures of each pair for rig.json, and notes on pairs without files.

    Args:
        paper: whether to compute the paper's two sets, with the rig's lenses, and the forecast.
        progress: called with the pairs done, and those in all.
    """
    files: dict[str, bytes] = {}
    figures: dict[Pair, dict[str, Any]] = {}
    notes: list[str] = []
    pairs = [pair for pair in rig.pairs.fits if {*pair} <= {*rig.names}]
    for number, pair in enumerate(pairs):
        name = pair_name(pair)
        try:
            own = pair_parameters(rig, pair)
            if paper:
                sets, figures[pair] = _paper_sets(rig, pair)
                for method in ("2d", "3d"):
                    set_of_pair = replace(sets[method], camera_names=pair)
                    files[f"{name}_{method}.json"] = set_of_pair.dumps().encode()
                own = replace(
                    own,
                    matching_threshold_px=figures[pair]["threshold_px"]["value"],
                    predicted=sets["refined"].predicted,
                )
            files[f"{name}_refined.json"] = own.dumps().encode()
        except (StereocalError, KeyError) as error:
            notes.append(f"The pair {name} has no files: {error}")
        if progress is not None:
            progress(number + 1, len(pairs))
    return files, figures, notes


def bars_of_pair(recording: Recording, pair: Pair, baseline_m: float | None) -> Dataset:
    """The bars that both cameras of a pair see, as a data set of two cameras.

    Args:
        baseline_m: of the rig, to be held to its standard error of 1 %; None: left free.
    """
    one, other = recording.object.longest
    ends = np.isin(recording.target, (one, other))
    bar = RigidObject.bar(float(recording.object.distances[one, other]), recording.object.sigma_m)
    columns = {name: getattr(recording, name)[ends] for name in ("frame", "camera", "points")}
    target = np.where(recording.target[ends] == one, 0, 1)
    sigma = recording.sigma_px[ends]
    own = replace(recording, object=bar, target=target, sigma_px=sigma, **columns)
    found = replace(own.pair(*pair), camera_names=None)
    if baseline_m is None or not found.baseline_is_free:
        return found
    return replace(found, baseline_m=baseline_m)


def _paper_sets(rig: RigCalibration, pair: Pair) -> tuple[dict[Method, Any], dict[str, Any]]:
    """The sets of a pair with the rig's lenses, and the forecast of its refined set."""
    dataset = replace(pair_dataset(rig, pair), baseline_sigma_m=None)
    held = RefineSettings(
        primary=FIXED_LENS, secondary=FIXED_LENS, baseline_sigma_m=1e-3 * dataset.baseline_m
    )
    calibration = calibrate(dataset, refined=held)
    outlook = outlook_of(calibration)
    if outlook is None:
        raise StereocalError("there is no forecast for it.")
    sets = answer(calibration, outlook).sets
    predicted = dict(sets["refined"].predicted or {})
    return sets, {name: predicted[name] for name in FIGURES}
