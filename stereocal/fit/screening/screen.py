"""Screening: detect frames that contradict the others, by a robust fit before all other methods.

A single frame with A and B exchanged in one camera rotates the paper's two sets by degrees. The
refined method's robust fit detects such frames. Its priors are wide, so that a wrong baseline or
lens, which affects all frames, is not taken for an error of single frames.

The frames left out are reported in every result, and the user can put them back.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stereocal.calibration.board_numbering import check_numbering
from stereocal.calibration.checks import refuse_same_points
from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.screening.movement import MovedError
from stereocal.fit.screening.two_recordings import camera_moved, other_size
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.fit.timing.time_offset import (
    InStep,
    fit_time_offset,
    frames_without_neighbours,
    usable_after,
)
from stereocal.rig.geometry import residuals
from stereocal.rig.pair import Pair
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

WIDE_LENS = LensPrior(0.05, 50.0)
WIDE_LENGTH_PRIOR = 0.1
"""Standard deviation of baseline and bar in the screening, relative."""

MINIMUM_FRAMES, MINIMUM_BOARDS = 8, 4
"""With fewer bars, a pose and two lenses can fit wrong points too; boards have more points."""

MOST_EXCHANGED = 40
"""Frames that are tried with their targets exchanged where each is tried by itself."""
MAXIMUM_LEFT_OUT = 0.2
"""If a larger fraction of the frames is left out, the frames kept may be the wrong ones."""
COMMON_CAUSE_PROBABILITY = 0.003
"""Significance level of each of the four tests for a common cause: together, they reject 1 % of the
correct recordings."""
MINIMUM_CASES = 3
NEIGHBOURS = 5
SHARED_RESIDUAL = 0.1
"""With a wrong lens, kept points near a point left out have at least this fraction of its
residual."""


@dataclass(frozen=True, eq=False)
class Screening:
    """The frames of a data set that contradict the others."""

    full_dataset: Pair
    """The data set with all frames, in step."""
    fit: RefinedResult | None
    """The robust fit; None if there is none."""
    left_out: tuple[int, ...]
    """Numbers of the frames that contradict the others, except those put back, of those that the
    user left out, of copies, and of those that could not be shifted in time; ascending."""
    exchanged: tuple[int, ...]
    """The frames of `left_out` that fit if A and B are exchanged in one of the cameras."""
    together: str
    """Message if the frames left out lie together in the image, in depth or in speed, so that the
    lenses or the timing are wrong rather than these frames; else empty."""
    failure: str = ""
    """Why the screening failed; else empty."""
    noise_px: float | None = None
    """Standard deviation of an image coordinate by the robust fit; None if there is none."""
    by_user: tuple[int, ...] = ()
    """The frames of `left_out` that the user left out."""
    measured_offset: MeasuredOffset | None = None
    """The time offset between the cameras; None if it was neither asked for nor significant, or if
    the motion does not determine it."""
    time_note: str = ""
    """What was found about it, in words; empty if it was neither asked for nor significant."""

    @cached_property
    def dataset(self) -> Pair:
        """The data set without the frames left out."""
        if not self.left_out:
            return self.full_dataset
        frames = self.full_dataset.correspondences.frames
        return self.full_dataset.of_frames(frames[~np.isin(frames, self.left_out)])

    @property
    def contradicting(self) -> tuple[int, ...]:
        """The frames of `left_out` that contradict the others."""
        known = {*self.by_user, *self.copies, *self.without_neighbours}
        return tuple(frame for frame in self.left_out if frame not in known)

    @cached_property
    def copies(self) -> dict[int, int]:
        """The frames of `left_out` that are copies, and the earlier frames with the same points.

        A copy adds no information, and the errors would be stated too small.
        """
        all_copies = self.full_dataset.correspondences.copies
        known = {*self.left_out} - {*self.by_user}
        return {frame: first for frame, first in all_copies.items() if frame in known}

    @cached_property
    def without_neighbours(self) -> tuple[int, ...]:
        """The frames of `left_out` with a point that could not be shifted in time."""
        return frames_without_neighbours(self.full_dataset)

    @property
    def shift(self) -> MeasuredOffset | None:
        """The offset by which the secondary points were shifted in time; None if as recorded."""
        offset, measured = self.full_dataset.time_offset, self.measured_offset
        if offset is None or measured is None or not offset.is_shift:
            return None
        return replace(measured, frames=offset.frames, drift=offset.drift)

    def solved_for(self, refined: RefineSettings, asked: CalibrationSettings) -> RefineSettings:
        """The settings of the refined method with the unknowns of time that were asked for, and
        those by which the points were shifted."""
        late, drift = asked.time_offset, asked.time_drift
        if (shift := self.shift) is not None:
            late, drift = True, drift or shift.drift != 0.0
        return replace(refined, time_offset=late, time_drift=drift)

    @property
    def share(self) -> float:
        """Fraction of the frames that contradict the others and were left out."""
        return len(self.contradicting) / len(self.full_dataset.correspondences.frames)


def unscreened(
    dataset: Pair, failure: str = "", by_user: tuple[int, ...] = (), copies: Collection[int] = ()
) -> Screening:
    """The result that keeps every frame but copies and those that the user left out."""
    left_out = tuple(sorted({*by_user, *copies}))
    return Screening(dataset, None, left_out, (), "", failure, by_user=by_user)


def screen(
    dataset: Pair,
    put_back: Collection[int] = (),
    leave_out: tuple[int, ...] = (),
    time_offset: bool = False,
    time_drift: bool = False,
) -> Screening:
    """Detect the frames that contradict the others.

    Args:
        put_back: numbers of frames that are kept in any case.
        leave_out: numbers of frames of the data set that are left out in any case.
        time_offset: bring the cameras into step, also by an offset that is not significant.
        time_drift: find the drift of the time offset too.
    """
    frames, by_user = dataset.correspondences.frames, tuple(leave_out)
    copies = {*dataset.correspondences.copies} - {*put_back}
    known = [*by_user, *copies]
    rest = dataset.of_frames(frames[~np.isin(frames, known)]) if known else dataset
    if not enough_frames(rest):
        return unscreened(dataset, by_user=by_user, copies=copies)
    note, measured = "", None
    try:
        fit, in_step = _fit(rest, time_offset, time_drift)
    except StereocalError as error:
        return unscreened(dataset, str(error), by_user, copies)
    if in_step is not None:
        note = in_step.note
        if in_step.fit is not None and in_step.fit.dataset.time_offset is not None:
            measured = in_step.fit.time_offset
            dataset = dataset.shifted(in_step.fit.dataset.time_offset)
    out = fit.outlying & ~np.isin(fit.frames, list(put_back))
    exchanged = out & _fit_exchanged(fit, rest)
    return Screening(
        dataset,
        fit,
        tuple(sorted({*known, *fit.frames[out].tolist(), *frames_without_neighbours(dataset)})),
        tuple(fit.frames[exchanged].tolist()),
        common_cause(fit, out & ~exchanged),
        noise_px=float(fit.sigma_px.value),
        by_user=by_user,
        measured_offset=measured,
        time_note=note,
    )


def _fit(dataset: Pair, time_offset: bool, time_drift: bool) -> tuple[RefinedResult, InStep | None]:
    """The robust fit, and what was found about the time offset if it was asked for, or if the
    cameras are out of step."""
    settings = wide_settings(dataset)
    if time_offset:
        in_step = fit_time_offset(dataset, replace(settings, time_drift=time_drift))
        return in_step.fit or refine(dataset, settings), in_step
    fit, note = with_offset_if_out_of_step(dataset, settings)
    return fit, InStep(fit, note) if note else None


def enough_frames(dataset: Pair) -> bool:
    """Whether there are enough to tell which of them contradict the others."""
    fewest = MINIMUM_FRAMES if dataset.board is None else MINIMUM_BOARDS
    return len(dataset.correspondences.frames) >= fewest


def wide_settings(dataset: Pair) -> RefineSettings:
    """The settings of the screening's fit, with wide priors."""
    return RefineSettings(
        lenses=dict.fromkeys(dataset.recording.labels, WIDE_LENS),
        baseline_sigma_m=WIDE_LENGTH_PRIOR * dataset.baseline_m,
        distance_sigma_m=WIDE_LENGTH_PRIOR * dataset.target_distance_m,
    )


def _fit_exchanged(fit: RefinedResult, recorded: Pair) -> BoolArray:
    """(f,): true for the frames that fit with A and B exchanged in the secondary image.

    Exchanging them in the primary image gives the same pairs, with A and B swapped.

    Args:
        recorded: the data set of the fit before a shift in time.
    """
    bad, offset = fit.frames[fit.outlying], fit.dataset.time_offset
    if offset is None or not offset.is_shift:
        fitting = _fitting(fit, fit.dataset.with_targets_exchanged(bad))
        return np.asarray(fit.outlying & np.isin(fit.frames, fitting))
    # One by one: a point between two frames is wrong too if one of them is exchanged.
    exchanged = [
        frame
        for frame in bad[:MOST_EXCHANGED]
        if frame in _fitting(fit, usable_after(recorded.with_targets_exchanged([frame]), offset))
    ]
    return np.isin(fit.frames, exchanged)


def _fitting(fit: RefinedResult, dataset: Pair) -> IntArray:
    """The frames of a changed data set that the parameters of a fit explain."""
    changed = fit.fit_of(dataset)
    return np.asarray(changed.frames[changed.explained()])


def screened(dataset: Pair, settings: CalibrationSettings) -> Screening:
    """Screen a data set, unless the settings trust all frames.

    Raises:
        StereocalError: corners of a board have other numbers; both cameras have the same points;
            some frames are of another pose of
            the cameras, or show another bar or board: says since when, or in which frames.
    """
    check_numbering(dataset.recording)
    refuse_same_points(dataset.recording)
    leave_out, frames = settings.frames_left_out, dataset.correspondences.frames
    by_user = tuple(frames[np.isin(frames, leave_out)].tolist())
    if len(by_user) == len(frames):
        raise StereocalError("Every frame is left out: put some back.")
    if settings.all_frames and not settings.time_offset:
        return unscreened(dataset, by_user=by_user)
    put_back = frames.tolist() if settings.all_frames else settings.frames_put_back
    screening = screen(dataset, put_back, by_user, settings.time_offset, settings.time_drift)
    fit = screening.fit
    size = fit and other_size(fit, MAXIMUM_LEFT_OUT)
    if fit and (moved := camera_moved(fit)):
        raise MovedError(f"{size} Or: {moved}" if size else moved)
    if size:
        raise StereocalError(size)
    return screening


def common_cause(fit: RefinedResult, out: BoolArray) -> str:
    """A message on what the frames left out have in common; empty if it may be chance.

    Consecutive frames count as one case: a target that is hidden stays hidden for a while.
    """
    if out.any() and (size := other_size(fit)):
        return size
    first = out & ~np.append(False, out[:-1])
    if np.count_nonzero(first) < MINIMUM_CASES:
        return ""
    rows, from_centre = fit.dataset.correspondences, np.zeros(len(fit.frames))
    frame_of = np.searchsorted(fit.frames, rows.frame)
    for points, camera in ((rows.primary, fit.primary), (rows.secondary, fit.secondary)):
        middle = 0.5 * (np.array(camera.image_size) - 1.0)
        np.maximum.at(from_centre, frame_of, np.linalg.norm(points - middle, axis=1))
    depth = fit.middles_m[:, 2]
    properties = (
        (from_centre, "farther from the centre of the images", "a wrong lens distortion"),
        (depth, "farther away", "a wrong lens or baseline"),
        (-depth, "nearer", "a wrong lens or baseline"),
    )
    for values, where, cause in properties if _like_neighbours(fit, out) else ():
        if _higher(values, first, ~out):
            return (
                f"The frames left out lie {where} than the others, and neighbouring points deviate "
                f"in the same way: this suggests {cause} rather than errors of these frames. "
                "Calibrate the lenses again."
            )
    if _higher(_speed(fit), first, ~out):
        return (
            "The frames left out are those in which the bar moved fast: this suggests cameras that "
            "do not expose at the same moment, or motion blur, rather than errors of these "
            "frames. Check how the cameras are triggered."
        )
    return ""


def _higher(values: FloatArray, some: BoolArray, others: BoolArray) -> bool:
    """Whether values are significantly higher in some frames than in others (Mann-Whitney)."""
    known = np.isfinite(values)
    one, other = values[some & known], values[others & known]
    if min(len(one), len(other)) < MINIMUM_CASES:
        return False
    # Importing it takes 0.4 s, which every command and worker would wait for.
    from scipy.stats import mannwhitneyu

    return bool(mannwhitneyu(one, other, alternative="greater").pvalue < COMMON_CAUSE_PROBABILITY)


def _speed(fit: RefinedResult) -> FloatArray:
    """(f,): the largest motion of a target in the primary image, in pixels per frame.

    Of the motions from the previous recorded frame and to the next; NaN if both are missing.
    """
    rows, speed = fit.dataset.correspondences, np.full(len(fit.frames), np.nan)
    order = np.lexsort([rows.time_frame, rows.target])
    before, after = order[:-1], order[1:]
    follows = (rows.target[before] == rows.target[after]) & (
        rows.time_frame[before] + 1 == rows.time_frame[after]
    )
    moved = np.linalg.norm(rows.primary[after] - rows.primary[before], axis=1)[follows]
    for rows_of in (before, after):
        np.fmax.at(speed, np.searchsorted(fit.frames, rows.frame[rows_of[follows]]), moved)
    return speed


def _like_neighbours(fit: RefinedResult, out: BoolArray) -> bool:
    """Whether kept points near those left out have residuals of the same sign and similar size.

    A wrong lens shifts all points in a part of the image in the same way. In each frame left out,
    the point with the largest residual is compared with the nearest kept points in both images.
    Measured median ratio: 0.0 on the real recording ewand12, whose bad frames are bad detections;
    0.33 there with a distortion of the wrong sign, and 0.1 to 0.5 on simulated rigs.
    """
    rows, view = fit.dataset.correspondences, fit.apply(fit.dataset)
    signed = residuals(fit.pose.essential, view.rays[:2].T, view.rays[2:].T)
    positions = np.column_stack([rows.primary, rows.secondary])
    left_out = np.isin(rows.frame, fit.frames[out])
    kept = np.flatnonzero(~left_out)
    ratios = []
    for frame in fit.frames[out]:
        of_frame = np.flatnonzero(rows.frame == frame)
        worst = of_frame[np.argmax(np.abs(signed[of_frame]))]
        distance = np.linalg.norm(positions[kept] - positions[worst], axis=1)
        nearest = kept[np.argsort(distance)[:NEIGHBOURS]]
        ratios.append(np.median(signed[nearest]) / signed[worst])
    return bool(np.median(ratios) > SHARED_RESIDUAL)
