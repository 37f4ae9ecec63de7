"""Repaired parameters: the old ones as prior, the movement free, and new images; their errors."""

from dataclasses import dataclass

import numpy as np

from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import Fit
from stereocal.field.checking.since import Since
from stereocal.fit.errors.uncertainty import MEAN_OF_NORMAL, length_sigmas
from stereocal.fit.least_squares.noise import ESTIMATED, GIVEN
from stereocal.fit.least_squares.small_steps import FACTOR
from stereocal.fit.parameter_file import covariance_entry, standard_errors
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray

REPAIRED = "parameters_repaired.json"
"""Name of the file that is written."""


def repaired_parameters(check: Recheck, sha256: str | None) -> RigParameters:
    """The repaired parameter file: method `refined`, purpose `both`.

    It names the file that is repaired by its digest, if it was a file, and its inputs in any case.
    """
    old, rig, fit = check.prior.rig, check.repaired, check.best
    images = check.after
    bar = images.dataset.target_distance_m if check.scale else old.inputs.get("target_distance_m")
    errors = standard_errors(fit.covariance, rig)
    uncertainties = {
        "sigma_px": {
            "value": check.noise.sigma_px,
            "source": ESTIMATED,
            "degrees_of_freedom": check.noise.degrees,
        },
        "bar_scatter_m": {"value": check.prior.scatter_m, "source": GIVEN},
        "standard_errors": {name: value.sigma for name, value in errors.items()},
        "covariance": covariance_entry(fit.covariance, rig),
        "design_effect": check.noise.design_effect,
    }
    if isinstance(bar, int | float):
        uncertainties["bar_length_m"] = {
            "stated": bar,
            "estimate": bar * float(fit.q[FACTOR]),
            "standard_error": bar * float(np.sqrt(fit.covariance[FACTOR, FACTOR])),
        }
    return RigParameters(
        method="refined",
        primary=rig.primary,
        secondary=rig.secondary,
        pose=rig.pose,
        cost=float(fit.cost),
        settings=old.settings,
        inputs={
            "sha256": images.dataset.sha256,
            "name": images.dataset.name,
            "baseline_m": rig.pose.baseline,
            "target_distance_m": bar,
            "frames": sorted({int(number) for number in images.numbers[~check.outlying]}),
            "repaired_from": {"sha256": sha256, "method": old.method, "inputs": dict(old.inputs)},
        },
        matching_threshold_px=None if old.method == "3d" else old.matching_threshold_px,
        uncertainties=uncertainties,
        noise_px=check.noise.sigma_px,
        volume=old.volume,
    )


def length_error(fit: Fit, sigma_px: float) -> float | None:
    """Expected length error of bars like the new ones, as a fraction; None without bars.

    The mean of |error| of a normal error, from the noise and the covariance of the parameters.
    """
    if not fit.seen.has_lengths:
        return None
    bars = np.isfinite(fit.seen.distances) & ~fit.outlying[fit.frame_of]
    ends = fit.points[bars].reshape(-1, 3)
    a, b = ends[0::2], ends[1::2]
    sigmas = length_sigmas(fit.at, sigma_px, fit.covariance, a, b)
    return MEAN_OF_NORMAL * float(np.mean(sigmas / np.linalg.norm(a - b, axis=1)))


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors of one parameter set, each (n,); NaN behind a camera."""

    reprojection_px: FloatArray
    """Mean of all points of a frame, of both cameras."""
    length: FloatArray | None
    """|reconstructed - stated| / stated length of the bar, NaN without one; None without bars."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """The errors of all frames with the old parameters and, if they are offered, the repaired."""

    frames: IntArray
    """(n,): the frame numbers."""
    before: FrameErrors
    after: FrameErrors | None
    changed: bool
    """Whether the old parameters no longer hold."""
    since: Since | None = None
    """The frame from which they do not, if there are frames before it."""


def residuals_of(check: Recheck) -> Residuals:
    images = check.images
    numbers, row = np.unique(images.numbers, return_inverse=True)

    def errors(rig: Rig) -> FrameErrors:
        px, length = images.errors_with(rig)  # bars are one group a frame
        return FrameErrors(np.bincount(row, px) / np.bincount(row), length if images.bars else None)

    repaired = errors(check.repaired) if check.offers_repair else None
    since = check.since if check.changed else None
    return Residuals(numbers, errors(check.prior.rig), repaired, check.changed, since)
