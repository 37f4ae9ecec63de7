"""The time offset between the cameras, and its drift, as unknowns of the refined method.

If the secondary camera is late by d frames, its point at the instant of the primary's frame k is
that of its own frame k - d. The points are interpolated there (`rig.tracks`), and the fit has the
remaining offset as an unknown: it moves each secondary point along its velocity. Interpolation and
fit are repeated until the remaining offset is small against its standard error, so that the
covariance of the last fit is that of all unknowns together.
"""

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.design_effect import design_effect
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import fit_from, refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.first_poses import median_residual, robust_pose
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from stereocal.system.array_types import BoolArray
from stereocal.system.numbers import rounded

TIME_OFFSET, TIME_DRIFT = (f"{CAMERAS[1]} time {what}" for what in ("offset", "drift"))
"""Names of free parameters."""
LARGEST, STEP = 3.0, 0.25
"""Range and step of the search for a first value, in frames."""
SAMPLES = 300
"""Of a pose for a first value. At wrong offsets all are drawn, at the right one some ten suffice;
with 1,000 the same offset is found, in 2.5 times as long."""
MAXIMUM_ROUNDS = 10
LARGEST_MOVE = 0.5
"""Of one round, in frames."""
CONVERGED = 0.05
"""A remaining offset below this fraction of its standard error is left to the fit."""
CLAIMED = 3.2
"""Standard errors above which the cameras count as out of step; those in step exceed it in 0.14 %
of the cases."""
DRIFTING = 5.0
"""The same for a drift that was not asked for."""
MAXIMUM_SIGMA = 0.1
"""In frames: with a larger standard error, the motion does not determine the offset."""
RUNS = 8
"""Of frames that follow each other, of which each is held out once (`spread_over_runs`)."""
MINIMUM_ROWS = 16
"""Points with neighbours that a fit of the offset needs."""


class InStep(NamedTuple):
    """What was found about the time offset of a data set, with a note in words.

    The fit has the offset as an unknown, of the frames that could be shifted; if the cameras are in
    step, of all frames as recorded. None if the motion does not determine the offset.
    """

    fit: RefinedResult | None
    note: str


def usable_rows(dataset: Pair) -> BoolArray:
    """(n,): the rows that a shift in time has not left without a position."""
    return dataset.recording.usable[len(dataset.correspondences) :]


def usable_after(dataset: Pair, offset: TimeOffset) -> Pair:
    """The data set shifted in time, without the rows that have no neighbours."""
    shifted = dataset.shifted(offset)
    return shifted.where(usable_rows(shifted))


def frames_without_neighbours(dataset: Pair) -> tuple[int, ...]:
    """The frames of a shifted data set with a point that could not be shifted; ascending."""
    frame = dataset.correspondences.frame
    return tuple(np.unique(frame[~usable_rows(dataset)]).tolist())


def fit_time_offset(dataset: Pair, settings: RefineSettings, near: float | None = None) -> InStep:
    """Fit the time offset, and the drift if `settings.time_drift`, with all other unknowns.

    Args:
        near: the offset to start from, in frames; searched for if None.
    """
    settings = replace(settings, time_offset=True)
    reference = dataset.correspondences.mean_time
    recorded = dataset.shifted(TimeOffset(reference=reference))
    if np.isfinite(recorded.correspondences.motion[:, 0]).sum() < MINIMUM_ROWS:
        note = (
            "The time offset between the cameras cannot be determined: too few points have "
            "neighbours in time. Record the moving bar in consecutive frames; their recorded "
            "numbers belong in the column time_frame."
        )
        return InStep(None, note)
    known = None if near is None else (TimeOffset(near, reference=reference), None)
    fit = fit_in_step(dataset, settings, *(known or first_value(dataset, reference)))
    measured = fit.time_offset
    if not measured.sigma < MAXIMUM_SIGMA:
        note = (
            "The motion is too slow to tell the time offset between the cameras: its standard "
            f"error would be {rounded(measured.sigma)} frames. The points are used as recorded. "
            "Move the bar faster, or record fewer frames a second."
        )
        return InStep(None, note)
    if measured.is_claimed(CLAIMED):
        fit = fit if settings.time_drift else drifting(dataset, fit)
        note = offset_note(fit)
        if abs(measured.frames) > LARGEST - STEP:
            note += " This is at the end of the range searched: check which frames belong together."
        return InStep(fit, note)
    fit = refine(recorded, settings, fit.pose)
    note = (
        "The cameras are in step, as far as the motion shows: the time offset is "
        f"{fit.time_offset.interval(fit.time_offset.frames)} frame intervals. "
        "The points are used as recorded."
    )
    return InStep(fit, note)


def offset_note(fit: RefinedResult) -> str:
    """What was found about the time offset of a fit, and what it does to the residuals."""
    return f"{fit.time_offset.sentence()} {_effect(fit)}"


def _effect(fit: RefinedResult) -> str:
    """How well the points fit as recorded and shifted, with the same pose."""
    rows, used = fit.dataset.correspondences, fit.used_rows
    recorded, shifted = (
        float(np.sqrt(np.mean(np.square(fit.rig.epipolar_distances(rows.primary, points)[used]))))
        for points in (rows.recorded_secondary, rows.secondary)
    )
    return (
        f"Epipolar RMS: {rounded(recorded)} px as recorded, {rounded(shifted)} px when "
        "shifted by that."
    )


def drifting(dataset: Pair, fit: RefinedResult) -> RefinedResult:
    """The fit with a drift of the offset, if that is significant; else as it is."""
    offset = fit.dataset.time_offset
    assert offset is not None
    with_drift = fit_in_step(dataset, replace(fit.settings, time_drift=True), offset, fit.pose)
    measured = with_drift.time_offset
    return with_drift if abs(measured.drift) > DRIFTING * measured.drift_sigma else fit


def first_value(dataset: Pair, reference: float) -> tuple[TimeOffset, Pose | None]:
    """The offset with the smallest epipolar residuals, of a robust pose for each."""
    cameras = dataset.primary, dataset.secondary
    best = np.inf, TimeOffset(reference=reference), robust_pose(cameras, dataset.rays)
    for frames in sorted(np.arange(-LARGEST, LARGEST + STEP, STEP), key=abs):
        offset = TimeOffset(float(frames), reference=reference)
        shifted = dataset.shifted(offset)
        known = np.isfinite(shifted.correspondences.motion[:, 0])
        if known.sum() < MINIMUM_ROWS:
            continue
        rays = np.ascontiguousarray(shifted.rays[:, known])
        pose = robust_pose(cameras, rays, SAMPLES)
        if pose is None:
            continue
        residual = median_residual(pose, rays)
        if residual < best[0]:
            best = residual, offset, pose
    _, offset, pose = best
    return offset, pose and Pose(pose.R, dataset.baseline_m * pose.T)


def fit_in_step(
    dataset: Pair, settings: RefineSettings, offset: TimeOffset, pose: Pose | None
) -> RefinedResult:
    """Interpolate and fit until the remaining offset is small against its standard error."""
    fit: RefinedResult | None = None
    for _ in range(MAXIMUM_ROUNDS):
        fit = refine(usable_after(dataset, offset), settings, pose, near=fit)
        measured, pose = fit.time_offset, fit.pose
        move, turn = measured.frames - offset.frames, measured.drift - offset.drift
        if (
            abs(move) <= CONVERGED * measured.sigma
            and abs(turn) <= CONVERGED * measured.drift_sigma
        ):
            break
        offset = replace(
            offset,
            frames=offset.frames + float(np.clip(move, -LARGEST_MOVE, LARGEST_MOVE)),
            drift=measured.drift,
        )
        fit = _left_at(fit, measured, offset)
    assert fit is not None
    return fit


def _left_at(fit: RefinedResult, measured: MeasuredOffset, shift: TimeOffset) -> RefinedResult:
    """The fit as a start for points that are shifted further: with what remains of its offset."""
    remaining = {TIME_OFFSET: measured.frames - shift.frames, TIME_DRIFT: 0.0}
    names = fit.unknowns.names
    p = [remaining.get(name, value) for name, value in zip(names, fit.p.tolist(), strict=True)]
    return replace(fit, p=np.array(p))


def spread_over_runs(fit: RefinedResult) -> float:
    """The standard error of the offset by the jackknife over runs of frames; 0 if they are too few.

    The errors of a bar that is waved are alike in frames that follow each other: of windows of 60
    to 400 frames of a real recording, 75 % of the offsets are within 1.96 standard errors of the
    fit, 91 % within as many of the larger of both.
    """
    offsets, used = list[float](), fit.frames[~fit.outlying]
    for run in np.array_split(used, RUNS):
        rest = fit.dataset.of_frames(np.setdiff1d(used, run))
        with suppress(StereocalError):
            offsets.append(refine(rest, fit.settings, fit.pose).time_offset.frames)
    return float((RUNS - 1) ** 0.5 * np.std(offsets)) if len(offsets) == RUNS else 0.0


def apparent_offset(fit: RefinedResult) -> MeasuredOffset | None:
    """The offset, and its drift, that the residuals of a fit without them suggest, by one
    Gauss-Newton step.

    None if too few points have neighbours. This is the score test: of all that the fit leaves of
    the residuals, the part that follows the velocities in the image.
    """
    table = fit.dataset.correspondences
    recorded = fit.dataset.shifted(TimeOffset(reference=table.mean_time))
    if np.isfinite(recorded.correspondences.motion[:, 0]).sum() < MINIMUM_ROWS:
        return None
    settings = replace(
        fit.settings,
        time_offset=True,
        time_drift=True,
        sigma_px=fit.sigma_px.value,
        scatter_m=fit.scatter_m.value,
    )
    solve = fit_from(recorded, fit.pose, settings, fit.rows)
    names = solve.unknowns.names
    known = {**fit.unknowns.named(fit.p), TIME_OFFSET: 0.0, TIME_DRIFT: 0.0}
    solve.take(np.array([known[name] for name in names]), fit.sigma_px.value, fit.scatter_m.value)
    limits = np.where(fit.outlying[fit.frame_of], 0.0, np.inf)
    _, H, g = solve.sum_at(1 / solve.scatter, limits, solve.points, np.empty(len(solve.points)))
    unknowns, late = solve.at_end, [names.index(TIME_OFFSET), names.index(TIME_DRIFT)]
    with np.errstate(invalid="ignore"):  # of points behind a camera
        step = -unknowns.covariance(H) @ (unknowns.M.T @ g + solve.prior_gradient)
        # Of what the offset does not explain: bars that are waved by cameras out of step have
        # errors that follow each other for that reason alone.
        effect = design_effect(solve, fit.used, fit.clusters, step)
        sigmas = np.sqrt(np.diag(unknowns.covariance(H / effect))[late])
    assert recorded.time_offset is not None
    reference = recorded.time_offset.reference
    frames, drift = step[late].tolist()
    return MeasuredOffset(frames, drift, reference, *sigmas.tolist())
