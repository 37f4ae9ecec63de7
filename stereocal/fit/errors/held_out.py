"""A rig's errors on frames that it was not fitted to.

The frames are divided into parts; each part is measured with the rig fitted to all others. Frames
drawn at random have neighbours among the fitted ones where they follow each other, and share their
errors; so such a recording is divided into whole runs too: as many as parts, for shorter ones lie
between fitted ones. (Halves of 12 simulated recordings of 300 frames, lenses off by 0.1 to 0.4 px
in ways that no model contains: errors in the other half are 1.02 times those so held out, of runs
as long as errors show to be alike 1.09, of single frames 1.12.)
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import camera_at
from stereocal.fit.least_squares.views import Cameras, fit_points
from stereocal.rig.clusters import evenly_divided
from stereocal.system.array_types import FloatArray, IntArray

PARTS = 5
"""Into which the frames are divided: as the paper's splits, four fifths are fitted."""
FEWEST = 2 * PARTS
"""Frames that are divided at least."""
SEED = 0
Groups = Literal["frames", "runs"]


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of frames measured with a rig that was fitted without them."""

    frames: int
    reprojection_px: float
    """Root mean square distance of the images of a frame from those of its points, over frames."""
    length_error_p95: float | None
    """95 % of the lengths are within this fraction; None without known lengths."""


@dataclass(frozen=True)
class HeldOut:
    """Errors of a rig on frames not fitted."""

    errors: HeldOutErrors
    apart_px: Mapping[str, float]
    """Median distance of the images of each camera from where two others or more see the point;
    NaN without such points."""


def point_fits(
    cameras: Cameras, seen: Observations, units: IntArray | slice = slice(None)
) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2, 3) of units, from their pixels alone, and residuals (n, 2, c, 2) in pixels; NaN
    where not seen."""
    shape = -1, seen.pixels.shape[2], 2
    pixels, rays = (values[units].reshape(shape) for values in (seen.pixels, seen.rays))
    fits = fit_points(cameras, pixels, rays)
    return fits.points.reshape(-1, 2, 3), fits.residuals.reshape(-1, 2, *shape[1:])


def frame_errors(residuals: FloatArray, of_frame: IntArray, frames: int) -> FloatArray:
    """(f,): root mean square distance of the images of each frame; NaN for a frame without any.

    Args:
        residuals: (n, 2, c, 2), as of `point_fits`; `of_frame`: (n,), the index of each frame.
    """
    squares = np.square(residuals).sum(axis=3)
    seen = np.isfinite(squares)
    total = np.bincount(of_frame, np.where(seen, squares, 0.0).sum(axis=(1, 2)), frames)
    count = np.bincount(of_frame, seen.sum(axis=(1, 2)), frames)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def relative_length_errors(points: FloatArray, distances: FloatArray) -> FloatArray:
    """Relative errors of the known distances (n,) of points (n, 2, 3)."""
    errors = np.linalg.norm(points[:, 0] - points[:, 1], axis=1) / distances - 1.0
    return np.asarray(errors[np.isfinite(errors)])


def seen_by_others(fit: RobustFit, seen: Observations, units: IntArray) -> FloatArray:
    """(n, c): distances, in pixels, of the images of points from where the other cameras see the
    point; NaN where fewer than two of them do."""
    shape = -1, seen.pixels.shape[2], 2
    pixels, rays = (values[units].reshape(shape) for values in (seen.pixels, seen.rays))
    there = np.isfinite(pixels[..., 0])
    apart = np.full(there.shape, np.nan)
    stated, at = fit.recording.cameras.values(), fit.at
    for number, (camera, pose) in enumerate(zip(stated, fit.poses, strict=True)):
        rows = np.flatnonzero(there[:, number] & (there.sum(axis=1) > 2))
        others, own_rays = pixels[rows], rays[rows]
        others[:, number], own_rays[:, number] = np.nan, np.nan
        points = pose.apply(fit_points(at, others, own_rays).points)
        images = camera_at(camera, at, number).project(points)
        apart[rows, number] = np.linalg.norm(images - pixels[rows, number], axis=1)
    return apart


def held_out(fit: RobustFit, by: Groups) -> HeldOut | None:
    """The errors with frames drawn at random left out (`frames`), or with whole runs of frames that
    follow each other left out (`runs`); None for fewer than `FEWEST`, or if a fit fails.

    Args:
        fit: of all frames; those that it leaves out are in no part.
    """
    count = len(fit.used)
    if count < FEWEST:
        return None
    if by == "runs":
        return _errors(fit, evenly_divided(count, PARTS).of_frames)
    return _errors(fit, np.random.default_rng(SEED).permutation(count) % PARTS)


def fitted_to(fit: RobustFit, frames: IntArray, near: bool) -> RobustFit | None:
    """A fit of some frames from the end of one; None if it fails.

    Args:
        near: begin with the frames that `fit` leaves out, and its noise. Not where these are in
            question: frames after a camera moved by 2 degrees are left out so, and stay it.
    """
    settings = replace(fit.settings, time_offset=False, time_drift=False)  # they are in step
    rows = np.isin(fit.recording.frame, frames)
    again = RobustFit.of(fit.recording.where(rows), fit.poses, settings)
    known = fit.unknowns.named(fit.p)
    if near:
        again.start_near(known, fit.sigma_px, fit.scatter)
    else:
        again.start_at(known, fit.sigma_px)
    return again if again.run() else None


def _errors(fit: RobustFit, parts: IntArray) -> HeldOut | None:
    """The errors of all parts (f,) of the used frames; None if a fit fails."""
    seen, used = fit.seen, fit.used
    pixels, lengths, apart = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for part in range(PARTS):
        out = used[parts == part]
        again = fitted_to(fit, seen.frames[used[parts != part]], near=True)
        if again is None:
            return None
        units = np.flatnonzero(np.isin(seen.frame_of, out))
        points, residuals = point_fits(again.at, seen, units)
        pixels.append(frame_errors(residuals, seen.frame_of[units], len(seen.frames))[out])
        lengths.append(relative_length_errors(points, seen.distances[units]))
        apart.append(seen_by_others(again, seen, units))
    every, relative, distances = map(np.concatenate, (pixels, lengths, apart))
    errors = HeldOutErrors(
        len(every),
        float(np.sqrt(np.nanmean(np.square(every)))),
        float(np.quantile(np.abs(relative), 0.95)) if len(relative) else None,
    )
    known = (px[np.isfinite(px)] for px in distances.T)
    medians = (float(np.median(px)) if len(px) else float("nan") for px in known)
    return HeldOut(errors, dict(zip(fit.recording.cameras, medians, strict=True)))
