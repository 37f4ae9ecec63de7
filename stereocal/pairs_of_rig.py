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
from stereocal.network.rig_file import RigFile
from stereocal.network.unknowns import lens_places
from stereocal.refined.unknowns import FIXED_LENS, RefineSettings
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import Pair, Recording
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


def data_of_pair(recording: Recording, pair: Pair, rig: RigFile | None) -> Dataset:
    """The points that both cameras of a pair see, with lenses and baseline of the rig, if there.

    The lenses are uncertain by the rig's standard errors, the baseline by 1 %.
    """
    dataset = recording.pair(*pair)
    if rig is None or not {*pair} <= {*rig.names}:
        return dataset
    primary, secondary = (_lens(rig, name) for name in pair)
    own = replace(dataset, primary=primary, secondary=secondary)
    if not dataset.baseline_is_free:
        return own
    baseline = (rig.poses[pair[1]] @ rig.poses[pair[0]].inverse()).baseline
    return replace(own, baseline_m=baseline, baseline_sigma_m=None)


def _lens(rig: RigFile, name: str) -> Camera:
    """A camera of the rig with its standard errors."""
    places, camera = lens_places(rig.names.index(name)), rig.cameras[name]
    errors = np.sqrt(np.maximum(np.diag(rig.covariance)[places], 0.0))
    distortion = np.zeros_like(camera.distortion)
    fx, fy, cx, cy = errors[:4].tolist()
    known = min(len(distortion), len(errors) - 4)
    distortion[:known] = errors[4 : 4 + known]
    return replace(camera, uncertainty=LensUncertainty(fx, fy, cx, cy, distortion))


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
