"""A rig's errors on frames that it was not fitted to.

The frames are divided into parts; each part is measured with the rig fitted to all others. Frames
drawn at random have neighbours among the fitted ones where they follow each other, and share their
errors; so such a recording is divided into whole runs of frames too.
"""

from dataclasses import dataclass, replace

import numpy as np

from stereocal.network.fit import RigFit
from stereocal.refined.observations import Observations
from stereocal.refined.views import Cameras, fit_points
from stereocal.rig.clusters import Clusters
from stereocal.rig.compiled import FloatArray, IntArray

PARTS = 5
"""Into which the frames are divided: as the paper's splits, four fifths are fitted."""
FEWEST = 2 * PARTS
"""Frames, or runs, that are divided at least."""
SEED = 0


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of frames measured with a rig that was fitted without them."""

    frames: int
    reprojection_px: float
    """Root mean square distance of the images of a frame from those of its points, over frames."""
    length_error_p95: float | None
    """95 % of the lengths are within this fraction; None without known lengths."""


def point_fits(
    cameras: Cameras, seen: Observations, units: IntArray | slice = slice(None)
) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2, 3) of units, from their pixels alone, and residuals (n, 2, c, 2) in pixels; NaN
    where not seen."""
    shape = -1, seen.pixels.shape[2], 2
    pixels, rays = (values[units].reshape(shape) for values in (seen.pixels, seen.rays))
    found = fit_points(cameras, pixels, rays)
    return found.points.reshape(-1, 2, 3), found.residuals.reshape(-1, 2, *shape[1:])


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
    found = np.linalg.norm(points[:, 0] - points[:, 1], axis=1) / distances - 1.0
    return np.asarray(found[np.isfinite(found)])


def held_out(fit: RigFit, clusters: Clusters) -> dict[str, HeldOutErrors]:
    """The errors with frames drawn at random left out (`frames`), and for a recording of frames
    that follow each other with whole runs left out (`runs`); empty for fewer than `FEWEST`.

    Args:
        fit: of all frames; those that it leaves out are in no part.
        clusters: of its other frames.
    """
    draws, count = np.random.default_rng(SEED), len(clusters.of_frames)
    groups = {"frames": np.arange(count)}
    if clusters.has_runs:
        groups["runs"] = clusters.of_frames
    found: dict[str, HeldOutErrors] = {}
    for name, of_frames in groups.items():
        number = int(of_frames.max(initial=-1)) + 1
        if number < FEWEST:
            continue
        parts = (draws.permutation(number) % PARTS)[of_frames]
        errors = _errors(fit, parts)
        if errors is not None:
            found[name] = errors
    return found


def predicted_apart(fit: RigFit, frame: int) -> float:
    """How much worse the frames before and from one on predict each other than the halves of each
    do, as a factor; above 1 something changed there, and not only where the object was."""
    used = fit.frames[fit.used]
    parts = used[used < frame], used[used >= frame]
    within = (_ratio(fit, *np.array_split(part, 2)) for part in parts)
    return _ratio(fit, *parts) / max(1.0, *within)


def _ratio(fit: RigFit, first: IntArray, second: IntArray) -> float:
    """How many times worse frames are predicted by others than they fit by themselves, the smaller
    factor of the two (medians); 1 where a part cannot be fitted."""
    fits = [_fitted_to(fit, part) for part in (first, second)]
    ratios = []
    for part, own, other in zip((first, second), fits, fits[::-1], strict=True):
        if own is None or other is None:
            return 1.0
        units = np.flatnonzero(np.isin(fit.frames[fit.frame_of], part))
        itself, predicted = (
            float(np.nanmedian(frame_errors(residuals, fit.frame_of[units], len(fit.frames))))
            for _, residuals in (point_fits(each.cameras, fit.seen, units) for each in (own, other))
        )
        ratios.append(predicted / itself)
    return min(ratios)


def _fitted_to(fit: RigFit, frames: IntArray) -> RigFit | None:
    """A fit of some frames from the end of one; None if it fails."""
    settings = replace(fit.rig_settings, time_offsets=False)  # the points are in step already
    again = RigFit(fit.recording.where(np.isin(fit.recording.frame, frames)), fit.poses, settings)
    again.start_at(fit.unknowns.named(fit.p), fit.sigma_px)
    return again if again.run() else None


def _errors(fit: RigFit, parts: IntArray) -> HeldOutErrors | None:
    """The errors of all parts (f,) of the used frames; None if a fit fails."""
    seen, used = fit.seen, fit.used
    pixels, lengths = list[FloatArray](), list[FloatArray]()
    for part in range(PARTS):
        out = used[parts == part]
        again = _fitted_to(fit, seen.frames[used[parts != part]])
        if again is None:
            return None
        units = np.flatnonzero(np.isin(seen.frame_of, out))
        points, residuals = point_fits(again.cameras, seen, units)
        pixels.append(frame_errors(residuals, seen.frame_of[units], len(seen.frames))[out])
        lengths.append(relative_length_errors(points, seen.distances[units]))
    every, relative = np.concatenate(pixels), np.concatenate(lengths)
    return HeldOutErrors(
        len(every),
        float(np.sqrt(np.nanmean(np.square(every)))),
        float(np.quantile(np.abs(relative), 0.95)) if len(relative) else None,
    )
