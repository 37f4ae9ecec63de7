"""What the points say of a stated window: that there is none, or how well they determine it."""

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import erf

from stereocal.calibration.methods import POOR_LENGTH, errors_of
from stereocal.calibration.mistakes import INTO_WATER
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import FACTOR
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.least_squares.views import fit_points
from stereocal.fit.refine import refine
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.start.pairs import pairs_worth_a_fit
from stereocal.rig.camera import camera_in_words
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.window import THICKNESS_M, StatedWindow
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

CLEARLY, ALIKE = 1.5, 1.2
"""Noise through the window over that in air from which there is none; and in air over that through
the window up to which the points do not tell."""
DRAWS = 200
LARGEST_EXCESS = 1.09
"""Of the length errors over those of what is known exactly, in 95 % of the draws. Of 260 simulated
rigs 9 were over 1.15, all with 25 bars, and this was 1.096 to 1.37 there."""
FEW, SOUND_PX = 4.0, 2.0
"""How many times smaller errors of lengths are with a window that nobody has stated, and the most
noise that it leaves."""
SMALL_ERROR = 5e-4
"""A mean error of lengths, a fraction, that is of no concern."""


def no_window(air: "Fit", noise_px: float) -> str:
    """A message if the points fit better in air than through the stated window; else empty.

    Args:
        air: as of `in_air`.
        noise_px: that the window leaves; infinite if nothing fits.
    """
    if not (air.is_sound and CLEARLY * air.px < noise_px):
        return ""
    return (
        f"There is no window: in air the points fit to {rounded(air.px)} px, through the stated "
        "window worse. Calibrate without it, or check the index of its medium."
    )


def into_water(recording: Recording) -> str:
    """A message if a window before water explains the points of two cameras that are stated in air;
    else empty.

    Behind one the points fit in air with other angles and baselines, and the lengths do not: by 22
    % with a wall at 0.4 m.
    """
    if recording.has_windows:
        return ""
    window = StatedWindow(tuple(recording.cameras), THICKNESS_M)
    for pair in pairs_worth_a_fit(recording)[:1]:
        air, through = (
            _fit_of(replace(recording, windows=windows), pair) for windows in ((), (window,))
        )
        if through.is_sound and through.px < CLEARLY * air.px and through.p95 < air.p95 / FEW:
            return (
                f"The images seem to be {INTO_WATER}: so the lengths of {camera_in_words(*pair)} "
                f"are right to {rounded(100 * through.p95)} %, 95 % of the time. State the window, "
                'which the calibration then finds: "window" in dataset.json, as {"thickness_m": '
                '0.01, "medium": 1.333}, or the question on the page Data.'
            )
    return ""


def stated_otherwise(recording: Recording) -> dict[str, tuple[StatedWindow, ...]]:
    """What else may be meant by stated windows, by what is said of it: the least change first."""
    free = tuple(
        StatedWindow(
            it.cameras,
            it.thickness_m,
            it.glass,
            it.medium,
            medium_sigma=it.medium_sigma,
            glass_sigma=it.glass_sigma,
        )
        for it in recording.windows
    )
    every = tuple(recording.cameras)
    one = replace(free[0], cameras=every)
    others = {
        "with its distance and direction left to be found": free,
        "with one window for all cameras": (one,),
        "with one window for each camera": tuple(replace(one, cameras=(name,)) for name in every),
    }
    return {said: windows for said, windows in others.items() if windows != recording.windows}


class Fit(NamedTuple):
    """The noise of a pair's points, and 95 % of the errors of its lengths."""

    px: float
    p95: float

    @property
    def is_sound(self) -> bool:
        """Whether it is one that a user would take."""
        return self.px < SOUND_PX and self.p95 < POOR_LENGTH


def _fit_of(recording: Recording, pair: CameraPair) -> Fit:
    """Of two cameras; infinite where nothing fits."""
    with suppress(StereocalError):
        fit = refine(with_rough_baseline(recording.pair(*pair)), RefineSettings())
        errors = errors_of(fit.apply(fit.dataset), fit.pose)
        return Fit(float(fit.sigma_px.value), errors.p95_length)
    return Fit(math.inf, math.inf)


def in_air(recording: Recording) -> Fit:
    """The fit of the two cameras that share most points, without windows."""
    worth = pairs_worth_a_fit(recording)
    nothing = Fit(math.inf, math.inf)
    return _fit_of(replace(recording, windows=()), worth[0]) if worth else nothing


def window_warnings(rig: RigCalibration, air: Fit) -> list[str]:
    """That the points do not tell of the window, or how much more its being known would help.

    Args:
        air: as of `in_air`, of what the rig was calibrated from.
    """
    warnings = list[str]()
    if air.is_sound and air.px < ALIKE * rig.fit.sigma_px:
        warnings.append(
            "The points fit as well in air: they hardly tell of the window. Turn the cameras "
            "towards each other, and hold the bar where they see it at the edges of their images."
        )
    excess = length_excess(rig)
    error = np.mean(np.abs(rig.length_errors)) if len(rig.length_errors) else 0.0
    if excess > LARGEST_EXCESS and excess * error > SMALL_ERROR:
        warnings.append(
            "The window and the cameras are determined by few bars: lengths may be up to "
            f"{rounded(excess, 3)} times as far off as if both were known exactly. More bars near "
            "the window and far from it would help, or its measured distance."
        )
    return warnings


def length_excess(rig: RigCalibration) -> float:
    """How many times larger the mean length error of the recorded bars, relative to the object, is
    than if cameras and windows were known exactly: up to this, in 95 % of the cases; NaN without
    known lengths.

    A length has a normal error by the noise of its images, with the deviation s, and by the rig one
    that all bars share to first order, d: the mean of |error| is s sqrt(2 / pi) exp(-d^2 / 2 s^2) +
    |d| erf(|d| / s sqrt(2)).
    """
    fit, seen = rig.fit, rig.fit.seen
    known = np.isfinite(seen.distances) & ~fit.outlying[fit.frame_of]
    shape = -1, seen.pixels.shape[2], 2
    fits = fit_points(
        fit.at, seen.pixels[known].reshape(shape), seen.rays[known].reshape(shape), True
    )
    ends = fits.points.reshape(-1, 2, 3)
    along = ends[:, 0] - ends[:, 1]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    covariances = fits.covariances.reshape(-1, 2, 3, 3).sum(axis=1)
    s = fit.sigma_px * np.sqrt(np.einsum("ni,nij,nj->n", along, covariances, along))
    by_end = fits.by_shared.reshape(-1, 2, 3, fits.by_shared.shape[-1])
    by_unknown = np.einsum("ni,niq->nq", along, by_end[:, 0] - by_end[:, 1])
    by_unknown[:, FACTOR] -= seen.distances[known]  # relative to the object as it was found
    slopes = by_unknown @ fit.unknowns.M
    usable = np.isfinite(s) & np.isfinite(slopes).all(axis=1)
    if not usable.any():
        return float("nan")
    covariance = fit.at_end.covariance(fit.H / rig.design_effect)
    d = np.abs(_drawn(covariance) @ slopes[usable].T)
    of_noise, s = np.sqrt(2 / np.pi) * s[usable], s[usable]
    mean = of_noise * np.exp(-0.5 * (d / s) ** 2) + d * erf(d / (s * np.sqrt(2.0)))
    return float(np.quantile(mean.mean(axis=1) / of_noise.mean(), 0.95))


def _drawn(covariance: FloatArray) -> FloatArray:
    """(DRAWS, k): what free parameters with a covariance (k, k) may be off by."""
    values, axes = np.linalg.eigh(covariance)
    spread = np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T
    return np.asarray(np.random.default_rng(0).standard_normal((DRAWS, len(values))) @ spread)
