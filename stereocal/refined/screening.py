"""Which frames contradict the others: the refined method's robust fit, before all other methods.

One frame with A and B exchanged in one camera turns the paper's two sets by degrees. The robust
fit finds such frames whatever the other methods would make of them. Its priors are wide, so that a
wrong baseline or lens, which all frames share, is not taken for an error of some of them.

A frame left out is one of the person's frames: it is named everywhere, and can be put back.
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
WIDE_LENGTHS = 0.1
"""Standard deviation of baseline and bar in the screening, as a fraction of them."""

FEWEST_FRAMES = 8
"""Five angles and two lenses fit the images of fewer bars, whichever of them is wrong."""

TOGETHER = 0.003
"""Frames left out lie together where chance would put them so in one of so many recordings; there
are four ways to lie together, so sound recordings are accused in 1 %."""
FEWEST_TOGETHER = 3
NEIGHBOURS = 5
ALIKE = 0.1
"""Kept points near one left out have so large a part of its residual where the lens is wrong."""

MOST_LEFT_OUT = 0.2
"""Where more frames than this contradict the others, the others may be the wrong ones."""


@dataclass(frozen=True, eq=False)
class Screening:
    """What the frames of a data set say of each other."""

    given: Dataset
    """All frames."""
    fit: RefinedResult | None
    """The robust fit; None where there was none."""
    left_out: tuple[int, ...]
    """Numbers of the frames that contradict the others, less those put back; in order."""
    exchanged: tuple[int, ...]
    """Of `left_out`, those that fit when A and B are exchanged in one of the cameras."""
    together: str
    """Where the frames left out lie together, which accuses the model and not them; else empty."""
    failure: str = ""
    """Why no frame could be judged; else empty."""

    @cached_property
    def dataset(self) -> Dataset:
        """The data set without the frames left out."""
        if not self.left_out:
            return self.given
        frames = self.given.correspondences.frames
        return self.given.of_frames(frames[~np.isin(frames, self.left_out)])

    @property
    def share(self) -> float:
        """The part of the frames that was left out."""
        return len(self.left_out) / len(self.given.correspondences.frames)


def unscreened(dataset: Dataset, failure: str = "") -> Screening:
    """Every frame is kept."""
    return Screening(dataset, None, (), (), "", failure)


def screen(dataset: Dataset, put_back: Collection[int] = ()) -> Screening:
    """Find the frames that contradict the others.

    Args:
        put_back: numbers of frames that are kept whatever the fit says of them.
    """
    frames = dataset.correspondences.frames
    if len(frames) < FEWEST_FRAMES:
        return unscreened(dataset)
    try:
        fit = refine(dataset, _wide(dataset))
    except StereocalError as error:
        return unscreened(dataset, str(error))
    out = fit.outlying & ~np.isin(fit.frames, list(put_back))
    exchanged = out & _fit_exchanged(fit)
    return Screening(
        dataset,
        fit,
        tuple(fit.frames[out].tolist()),
        tuple(fit.frames[exchanged].tolist()),
        _together(fit, out & ~exchanged),
    )


def _wide(dataset: Dataset) -> RefineSettings:
    return replace(
        WIDE,
        baseline_sigma_m=WIDE_LENGTHS * dataset.baseline_m,
        distance_sigma_m=WIDE_LENGTHS * dataset.target_distance_m,
    )


def _fit_exchanged(fit: RefinedResult) -> BoolArray:
    """(f,): the frames that would fit with their targets exchanged in the secondary image.

    Exchanged in the primary image instead, the same pairs would carry each other's names.
    """
    bad = fit.frames[fit.outlying]
    solve = Solve(fit.dataset.with_targets_exchanged(bad), fit.pose, fit.settings)
    misfits = solve.judged(fit.unknowns, fit.p, fit.sigma_px.value, fit.scatter_m.value)
    return np.asarray(fit.outlying & (misfits <= solve.limit))


def _together(fit: RefinedResult, out: BoolArray) -> str:
    """A sentence on what the frames left out have in common; empty where it may be chance.

    Frames left out one after the other are one case: what hides a target hides it for a while.
    """
    first = out & ~np.append(False, out[:-1])
    if np.count_nonzero(first) < FEWEST_TOGETHER:
        return ""
    depth = fit.places_m[:, :, 2].mean(axis=1)
    places = (
        (_from_centre(fit), "farther from the centre of the images", "a lens distortion"),
        (depth, "farther away", "a lens or a baseline"),
        (-depth, "nearer", "a lens or a baseline"),
    )
    for values, where, cause in places if _like_neighbours(fit, out) else ():
        if _higher(values, first, ~out):
            return (
                f"The frames left out lie {where} than the others, and the frames beside them are "
                f"off in the same way: that is {cause} that does not fit, rather than an error of "
                "these frames. Calibrate the lenses again."
            )
    if _higher(_speed(fit), first, ~out):
        return (
            "The frames left out are those in which the bar moved fast: that is two cameras that "
            "do not expose at the same moment, or motion blur, rather than an error of these "
            "frames. Look at how the cameras are triggered."
        )
    return ""


def _higher(values: FloatArray, some: BoolArray, others: BoolArray) -> bool:
    """Whether values are higher in some frames than in others, beyond chance."""
    known = np.isfinite(values)
    one, other = values[some & known], values[others & known]
    if min(len(one), len(other)) < FEWEST_TOGETHER:
        return False
    # Importing it takes 0.4 s, which every command and worker would wait for.
    from scipy.stats import mannwhitneyu

    return bool(mannwhitneyu(one, other, alternative="greater").pvalue < TOGETHER)


def _from_centre(fit: RefinedResult) -> FloatArray:
    """(f,): the largest distance of a frame's points from the middle of their image, in pixels."""
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
    """(f,): how far a target moved in the primary image from or to the next frame, in pixels.

    The larger of both; NaN where neither the frame before nor the one after is there.
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
            place = np.searchsorted(fit.frames, number)
            found[place] = np.fmax(found[place], moved)
    return found


def _like_neighbours(fit: RefinedResult, out: BoolArray) -> bool:
    """Whether the residuals of the frames left out go on smoothly from those of the frames kept.

    A wrong lens moves all points of a part of the image alike. Of each frame left out, the point
    farthest from its epipolar line is compared with the kept points nearest to it in both images.
    Measured: 0.0 on the real recording ewand12, whose bad frames are bad detections; 0.33 there
    with a flipped distortion, and 0.1 to 0.5 on simulated rigs.
    """
    rows, view = fit.dataset.correspondences, fit.apply(fit.dataset)
    signed = residuals(fit.pose.essential, view.rays[:2].T, view.rays[2:].T)
    places = np.column_stack([rows.primary, rows.secondary])
    left_out = np.isin(rows.frame, fit.frames[out])
    kept = np.flatnonzero(~left_out)
    ratios = []
    for frame in fit.frames[out]:
        own = np.flatnonzero(rows.frame == frame)
        worst = own[np.argmax(np.abs(signed[own]))]
        distance = np.linalg.norm(places[kept] - places[worst], axis=1)
        nearest = kept[np.argsort(distance)[:NEIGHBOURS]]
        ratios.append(np.median(signed[nearest]) / signed[worst])
    return bool(np.median(ratios) > ALIKE)


def screened(dataset: Dataset, settings: CalibrationSettings) -> Screening:
    """Which frames of a data set to leave out, as the settings say."""
    return unscreened(dataset) if settings.all_frames else screen(dataset, settings.frames_put_back)
