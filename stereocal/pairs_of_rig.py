"""The pairs of a rig: their data with the rig's lenses, and their parameter files."""

from dataclasses import replace
from typing import Any

import numpy as np

from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.network.pairs import Progress
from stereocal.network.placings import rows_where
from stereocal.network.rig_file import RigFile
from stereocal.network.screening import WrongImage, rows_of
from stereocal.network.unknowns import lens_places
from stereocal.refined.parameter_file import refined_parameters
from stereocal.refined.refine import refine, settings_for
from stereocal.refined.rest import Rest
from stereocal.refined.robust import RobustFit
from stereocal.refined.time_offset import usable_after
from stereocal.refined.two_views import BAR, SHARED
from stereocal.refined.unknowns import RefineSettings, shared_unknowns
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Pair, Recording
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.verdict.forecast import outlook_of
from stereocal.workflow import answer, calibrate

FIGURES = ("fcp_reprojection", "median_error_3d", "p95_error_3d", "threshold_px")
TIED = 1.0 - 1e-9
"""Correlation of fx and fy from which on they share one factor."""


def files_of_pairs(
    recording: Recording, rig: RigFile, paper: bool = False, progress: Progress | None = None
) -> tuple[dict[str, bytes], dict[str, dict[str, Any]], list[str]]:
    """The files by name, figures of each pair for rig.json, and notes on pairs without files.

    Args:
        paper: whether to compute the paper's two sets, with the rig's lenses, and the forecast.
        progress: called with the pairs done, and those in all.
    """
    files: dict[str, bytes] = {}
    figures: dict[str, dict[str, Any]] = {}
    notes: list[str] = []
    pairs = [name for name, own in rig.about["pairs"].items() if "frames" in own]
    for number, name in enumerate(pairs):
        try:
            for method, found in _files(recording, rig, name, paper, figures).items():
                files[f"{name}_{method}.json"] = found.dumps().encode()
        except (StereocalError, KeyError) as error:
            notes.append(f"The pair {name} has no files: {error}")
        if progress is not None:
            progress(number + 1, len(pairs))
    return files, figures, notes


def _files(
    recording: Recording, rig: RigFile, name: str, paper: bool, figures: dict[str, dict[str, Any]]
) -> dict[str, RigParameters]:
    """The files of a pair by method; `figures` gets those of its forecast."""
    pair = recording.pair_named(name)
    dataset = data_of_pair(recording, pair, rig)
    settings = settings_of_pair(dataset, pair, rig)
    late = rig.pair(*pair).time_offset
    if not paper:
        own = refined_parameters(refine(dataset, settings), left_out=rig.about["frames_left_out"])
        return {"refined": replace(own, time_offset=late)}
    # The rig has left out the frames that contradict it.
    calibration = calibrate(dataset, CalibrationSettings(all_frames=True), refined=settings)
    outlook = outlook_of(calibration)
    if outlook is None:
        raise StereocalError("there is no forecast for it.")
    sets = answer(calibration, outlook).sets
    predicted = dict(sets["refined"].predicted or {})
    figures[name] = {figure: predicted[figure] for figure in FIGURES}
    left_out = rig.about["frames_left_out"]
    return {
        method: replace(found, time_offset=late, frames_left_out=tuple(left_out))
        for method, found in sets.items()
    }


def data_of_pair(recording: Recording, pair: Pair, rig: RigFile | None) -> Dataset:
    """The points that both cameras of a pair see; with a rig, those that it was fitted to, with its
    lenses and baseline, and in step.

    The lenses are uncertain by the rig's standard errors, the baseline by 1 %.
    """
    if rig is None or not {*pair} <= {*rig.names}:
        return recording.pair(*pair)
    wrong = [WrongImage(**own) for own in rig.about.get("wrong_images", [])]
    out = rows_of(recording, wrong) | np.isin(recording.frame, rig.about["frames_left_out"])
    dataset = rows_where(recording, ~out).pair(*pair)
    late = rig.time_offsets[pair[1]] - rig.time_offsets[pair[0]]
    if late:
        shifted = usable_after(dataset, TimeOffset(late)).correspondences
        unknown = np.full_like(shifted.motion, np.nan)
        shifted = replace(shifted, recorded=shifted.recorded * np.nan, motion=unknown)
        dataset = replace(dataset, correspondences=shifted)
    primary, secondary = (_lens(rig, name) for name in pair)
    own = replace(dataset, primary=primary, secondary=secondary)
    if not dataset.baseline_is_free:
        return own
    return replace(own, baseline_m=rig.pair(*pair).pose.baseline, baseline_sigma_m=None)


def settings_of_pair(dataset: Dataset, pair: Pair, rig: RigFile) -> RefineSettings:
    """The settings with which the refined set of a pair is the rig's, with its covariance.

    Args:
        dataset: of `data_of_pair`.
    """
    own, figures = rig.pair(*pair), rig.about["figures"]
    values = shared_unknowns(Rig(own.primary, own.secondary, own.pose))
    values[BAR] = rig.q[-1]
    known = np.array((own.uncertainties or {})["covariance"]["matrix"])
    covariance = np.zeros((SHARED, SHARED))
    covariance[: len(known), : len(known)] = known
    settings = RefineSettings(
        baseline_sigma_m=dataset.baseline_sigma_m,
        distance_sigma_m=dataset.target_distance_sigma_m,
        sigma_px=rig.noise_px,
        scatter_m=figures["length_scatter_m"],
        loss="squares",  # the rig has left out what contradicts it
    )
    solve = RobustFit.of_pair(dataset, own.pose, settings_for(dataset, settings))
    H, g, _ = solve.equations(values, [np.arange(len(solve.frames))])
    effect = figures["design_effect"]
    rest = Rest.of(values, covariance, solve.unknowns, (H[0], g[0]), effect)
    return replace(settings, rest=rest)


def _lens(rig: RigFile, name: str) -> Camera:
    """A camera of the rig with its standard errors."""
    places, camera = lens_places(rig.names.index(name)), rig.cameras[name]
    covariance = rig.covariance[np.ix_(places, places)]
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    distortion = np.zeros_like(camera.distortion)
    fx, fy, cx, cy = errors[:4].tolist()
    known = min(len(distortion), len(errors) - 4)
    distortion[:known] = errors[4 : 4 + known]
    unit = np.where(errors > 0.0, errors, 1.0)
    whole = np.where(np.eye(len(unit)), 1.0, covariance / np.outer(unit, unit))
    correlation = whole if abs(whole[0, 1]) < TIED else None
    return replace(camera, uncertainty=LensUncertainty(fx, fy, cx, cy, distortion, correlation))
