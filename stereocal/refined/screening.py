"""Screening: detect frames that contradict the others, by a robust fit before all other methods.

A single frame with A and B exchanged in one camera rotates the paper's two sets by degrees. The
refined method's robust fit detects such frames. Its priors are wide, so that a wrong baseline or
lens, which affects all frames, is not taken for an error of single frames.

The frames left out are reported in every result, and the user can put them back.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.solve import Solve
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import residuals

WIDE = RefineSettings(primary=LensPrior(0.05, 50.0), secondary=LensPrior(0.05, 50.0))
WIDE_LENGTH_PRIOR = 0.1
"""Standard deviation of baseline and bar in the screening, relative."""

MINIMUM_FRAMES = 8
"""With fewer bars, five angles and two lenses can fit wrong points too."""

COMMON_CAUSE_PROBABILITY = 0.003
"""Significance level of each of the four tests for a common cause: together, they reject 1 % of the
correct recordings."""
MINIMUM_CASES = 3
NEIGHBOURS = 5
SHARED_RESIDUAL = 0.1
"""With a wrong lens, kept points near a point left out have at least this fraction of its
residual."""

MAXIMUM_LEFT_OUT = 0.2
"""If a larger fraction of the frames is left out, the frames kept may be the wrong ones."""


@dataclass(frozen=True, eq=False)
class Screening:
    """The frames of a data set that contradict the others."""

    full_dataset: Dataset
    """The data set with all frames."""
    fit: RefinedResult | None
    """The robust fit; None if there is none."""
    left_out: tuple[int, ...]
    """Numbers of the frames that contradict the others, except those put back, and of those that
    the user left out; ascending."""
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

    @cached_property
    def dataset(self) -> Dataset:
        """The data set without the frames left out."""
        if not self.left_out:
            return self.full_dataset
        frames = self.full_dataset.correspondences.frames
        return self.full_dataset.of_frames(frames[~np.isin(frames, self.left_out)])

    @property
    def contradicting(self) -> tuple[int, ...]:
        """The frames of `left_out` that contradict the others."""
        return tuple(frame for frame in self.left_out if frame not in self.by_user)

    @property
    def share(self) -> float:
        """Fraction of the frames that contradict the others and were left out."""
        return len(self.contradicting) / len(self.full_dataset.correspondences.frames)


def unscreened(dataset: Dataset, failure: str = "", by_user: tuple[int, ...] = ()) -> Screening:
    """The result that keeps every frame but those that the user left out."""
    return Screening(dataset, None, by_user, (), "", failure, by_user=by_user)


def screen(
    dataset: Dataset, put_back: Collection[int] = (), leave_out: tuple[int, ...] = ()
) -> Screening:
    """Detect the frames that contradict the others.

    Args:
        put_back: numbers of frames that are kept in any case.
        leave_out: numbers of frames of the data set that are left out in any case.
    """
    frames, by_user = dataset.correspondences.frames, tuple(leave_out)
    rest = dataset.of_frames(frames[~np.isin(frames, by_user)]) if by_user else dataset
    if len(rest.correspondences.frames) < MINIMUM_FRAMES:
        return unscreened(dataset, by_user=by_user)
    try:
        fit = refine(rest, _wide(rest))
    except StereocalError as error:
        return unscreened(dataset, str(error), by_user)
    out = fit.outlying & ~np.isin(fit.frames, list(put_back))
    exchanged = out & _fit_exchanged(fit)
    return Screening(
        dataset,
        fit,
        tuple(sorted([*by_user, *fit.frames[out].tolist()])),
        tuple(fit.frames[exchanged].tolist()),
        _common_cause(fit, out & ~exchanged),
        noise_px=float(fit.sigma_px.value),
        by_user=by_user,
    )


def _wide(dataset: Dataset) -> RefineSettings:
    return replace(
        WIDE,
        baseline_sigma_m=WIDE_LENGTH_PRIOR * dataset.baseline_m,
        distance_sigma_m=WIDE_LENGTH_PRIOR * dataset.target_distance_m,
    )


def _fit_exchanged(fit: RefinedResult) -> BoolArray:
    """(f,): true for the frames that fit with A and B exchanged in the secondary image.

    Exchanging them in the primary image gives the same pairs, with A and B swapped.
    """
    bad = fit.frames[fit.outlying]
    solve = Solve(fit.dataset.with_targets_exchanged(bad), fit.pose, fit.settings)
    chi_squares = solve.chi_squares_for(
        fit.unknowns, fit.p, fit.sigma_px.value, fit.scatter_m.value
    )
    return np.asarray(fit.outlying & (chi_squares <= solve.limit))


def _common_cause(fit: RefinedResult, out: BoolArray) -> str:
    """A message on what the frames left out have in common; empty if it may be chance.

    Consecutive frames count as one case: a target that is hidden stays hidden for a while.
    """
    first = out & ~np.append(False, out[:-1])
    if np.count_nonzero(first) < MINIMUM_CASES:
        return ""
    depth = fit.points_m[:, :, 2].mean(axis=1)
    properties = (
        (_from_centre(fit), "farther from the centre of the images", "a wrong lens distortion"),
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


def _from_centre(fit: RefinedResult) -> FloatArray:
    """(f,): the largest distance of a frame's points from the image centre, in pixels."""
    rows = fit.dataset.correspondences
    half = [0.5 * (np.array(c.image_size) - 1.0) for c in (fit.primary, fit.secondary)]
    radius = np.maximum(
        np.linalg.norm(rows.primary - half[0], axis=1),
        np.linalg.norm(rows.secondary - half[1], axis=1),
    )
    found = np.zeros(len(fit.frames))
    np.maximum.at(found, np.searchsorted(fit.frames, rows.frame), radius)
    return found


def _speed(fit: RefinedResult) -> FloatArray:
    """(f,): the largest motion of a target in the primary image, in pixels per frame.

    Of the motions from the previous frame and to the next; NaN if both are missing.
    """
    rows = fit.dataset.correspondences
    at = {
        (int(frame), int(target)): row
        for row, (frame, target) in enumerate(zip(rows.frame, rows.target, strict=True))
    }
    found = np.full(len(fit.frames), np.nan)
    for (frame, target), row in at.items():
        before = at.get((frame - 1, target))
        if before is None:
            continue
        moved = float(np.linalg.norm(rows.primary[row] - rows.primary[before]))
        for number in (frame - 1, frame):
            index = np.searchsorted(fit.frames, number)
            found[index] = np.fmax(found[index], moved)
    return found


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
        own = np.flatnonzero(rows.frame == frame)
        worst = own[np.argmax(np.abs(signed[own]))]
        distance = np.linalg.norm(positions[kept] - positions[worst], axis=1)
        nearest = kept[np.argsort(distance)[:NEIGHBOURS]]
        ratios.append(np.median(signed[nearest]) / signed[worst])
    return bool(np.median(ratios) > SHARED_RESIDUAL)


def screened(dataset: Dataset, settings: CalibrationSettings) -> Screening:
    """Screen a data set, unless the settings trust all frames.

    Raises:
        StereocalError: the settings leave out every frame.
    """
    leave_out, frames = settings.frames_left_out, dataset.correspondences.frames
    by_user = tuple(frames[np.isin(frames, leave_out)].tolist())
    if len(by_user) == len(frames):
        raise StereocalError("Every frame is left out: put some back.")
    if settings.all_frames:
        return unscreened(dataset, by_user=by_user)
    return screen(dataset, settings.frames_put_back, by_user)
