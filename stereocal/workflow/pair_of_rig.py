"""A pair of a rig: its data with the rig's lenses, and the fit that is the rig's.

Fitted by itself with the lenses of the rig as stated ones, a pair would count its own images twice:
they are in those lenses already. So its refined set is the rig's, and its covariance the rig's.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.fit.least_squares.distortion import lenses_of_cameras
from stereocal.fit.least_squares.small_steps import lens_places, window_places
from stereocal.fit.least_squares.stated_windows import is_shared
from stereocal.fit.least_squares.unknowns import RefineSettings, RigMarginal
from stereocal.fit.least_squares.views import EACH, TIME
from stereocal.fit.rig_file import RigFile
from stereocal.fit.screening.wrong_images import rows_of
from stereocal.fit.start.fuse import pair_at, pair_derivatives
from stereocal.fit.timing.time_offset import usable_after
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.pair import Pair
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.window import StatedWindow, windows_of_some

TIED = 1.0 - 1e-9
"""Correlation of fx and fy from which on they share one factor."""


def data_of_pair(recording: Recording, pair: CameraPair, rig: RigFile | None) -> Pair:
    """The points that both cameras of a pair see; with a rig, those that it was fitted to, with its
    lenses and baseline, and in step.

    The lenses are uncertain by the rig's standard errors, the baseline by 1 %.
    """
    if rig is None or not {*pair} <= {*rig.names}:
        return recording.pair(*pair)
    out = rows_of(recording, rig.about.wrong_images)
    out |= np.isin(recording.frame, rig.about.frames_left_out)
    dataset = recording.where(~out).pair(*pair)
    first, second = (
        rig.start_frames.get(name, 0) - recording.start_frames.get(name, 0) for name in pair
    )
    offset = rig.shift(*pair)
    offset = replace(offset, frames=offset.frames + second - first)
    if offset.is_shift:
        dataset = Pair(usable_after(dataset, offset).recording.taken_as_recorded())
    primary, secondary = (_lens(rig, name) for name in pair)
    dataset = Pair(replace(dataset.recording, windows=_windows(recording, pair, rig)))
    with_lenses = dataset.changed(primary=primary, secondary=secondary)
    if not dataset.baseline_is_free:
        return with_lenses
    return with_lenses.changed(baseline_m=rig.pair(*pair).pose.baseline, baseline_sigma_m=None)


def settings_of_pair(dataset: Pair, pair: CameraPair, rig: RigFile) -> RefineSettings:
    """The settings with which the refined set of a pair is the rig's, with its covariance.

    Args:
        dataset: of `data_of_pair`.
    """
    figures = rig.about.figures
    assert figures is not None, "a rig of a recording"
    first, second = (rig.names.index(name) for name in pair)
    lenses = lenses_of_cameras(*(rig.cameras[name] for name in pair))
    cameras = pair_at(first, second, rig.q, rig.R, lenses)
    cameras.q[EACH + TIME] = 0.0  # its points are in step
    J = pair_derivatives(first, second, rig.q, rig.R)
    if any(len(window.cameras) == 2 for window in dataset.recording.windows):
        one, other = (window_places(number, 2) for number in (0, 1))
        J[other], cameras.q[other] = J[one], cameras.q[one]  # in the first one's frame
    covariance = J @ rig.covariance @ J.T
    return RefineSettings(
        baseline_sigma_m=dataset.baseline_sigma_m,
        distance_sigma_m=dataset.target_distance_sigma_m,
        sigma_px=rig.noise_px,
        scatter_m=figures.length_scatter_m,
        loss="squares",  # the rig has left out what contradicts it
        of_rig=RigMarginal(
            tuple(Rotation.from_matrix(cameras.R[1]).as_rotvec().tolist()),
            tuple(cameras.q.tolist()),
            tuple(map(tuple, covariance.tolist())),
            figures.design_effect,
        ),
    )


def _windows(recording: Recording, pair: CameraPair, rig: RigFile) -> tuple[StatedWindow, ...]:
    """The windows of a pair where the rig has them; one for both only where the rig has one."""
    windows = list[StatedWindow]()
    for stated in windows_of_some(recording.windows, pair):
        shared = any(
            is_shared(window, rig.names) and {*stated.cameras} <= {*window.cameras}
            for window in recording.windows
        )
        for cameras in (stated.cameras,) if shared else [(name,) for name in stated.cameras]:
            seen = rig.cameras[cameras[0]].window
            assert seen is not None, "a window of the rig"
            at = {"distance_m": seen.distance_m, "normal": seen.normal}
            windows.append(replace(stated, cameras=cameras, **at))  # type: ignore[arg-type]
    return tuple(windows)


def _lens(rig: RigFile, name: str) -> Camera:
    """A camera of the rig with its standard errors, without its window."""
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
    errors_of_lens = LensUncertainty(fx, fy, cx, cy, distortion, correlation)
    return replace(camera, uncertainty=errors_of_lens, window=None)
