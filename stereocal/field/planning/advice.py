"""What limits a plan, and what would help most, by the expected refined set of its variants."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.field.planning.expected import ExpectedFit, expect
from stereocal.field.planning.plan import LARGEST_TOE_IN_DEG, AimedPose, Plan
from stereocal.fit.errors.uncertainty import point_covariances
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import distance, rounded
from stereocal.verdict.in_words import digits, percent

BASELINES = 2.0 ** np.arange(-1.5, 2.01, 0.5)
"""Factors of the planned baseline that are tried: 0.35 to 4."""
KEPT_VIEW = 0.6
"""Share of the common view that another baseline must keep."""
NEARLY_LEAST = 1.1
"""The shortest baseline with an error up to this factor of the least is proposed."""
MORE_FRAMES = 4.0
"""Number of frames at which the error of a calibration by noise is halved."""
WORTH_IT = 0.93
"""Errors above this fraction of the planned one are no improvement."""
LENSES_TWICE = {"primary": 0.5, "secondary": 0.5}
LIMITS = {
    "image noise": "the noise of the image points",
    "calibration": "the number of bars to calibrate with",
    "lenses": "how well the lenses are known",
    "baseline": "the baseline",
}


@dataclass(frozen=True, eq=False)
class Advice:
    """What limits a plan and what would help.

    `limited_by` names the part that lowers the length error most if it is twice as good: half the
    noise in the images, 4 times as many frames, lenses known twice as well, or a baseline twice as
    long or measured twice as well. Where half the noise and twice the baseline gain about the same,
    it names the baseline, which can be changed.
    """

    limited_by: str
    sentences: tuple[str, ...]
    """The changes worth making, best first."""
    baselines_m: FloatArray
    baseline_errors: FloatArray
    """What 95 % of lengths are within with each of `baselines_m`; NaN where a plan cannot work."""


def advise(fit: ExpectedFit) -> Advice:
    """What limits a plan and what would help, by its expected refined set."""
    plan, sigma = fit.plan, fit.plan.uncertainty
    H, P = fit.result.information, fit.result.unknowns.precision

    def known(**better: float) -> float:
        return fit.length_p95_with(H, fit.precision_knowing(better))

    baselines, errors = _baseline_scan(fit)
    half_noise, lenses = fit.length_p95_with(4.0 * H, P, 0.5), known(**LENSES_TWICE)
    twice = errors[np.argmin(np.abs(baselines - 2 * plan.baseline_m))]
    halves = {  # of LIMITS, with one of them twice as good
        "image noise": half_noise,
        "calibration": fit.length_p95_with(MORE_FRAMES * H, P),
        "lenses": lenses,
        "baseline": float(np.nanmin([twice, known(baseline=0.5, object=0.5)])),
    }
    limit = min(halves, key=lambda name: halves[name])
    if limit == "image noise" and halves["baseline"] <= NEARLY_LEAST * halves[limit]:
        limit = "baseline"
    better_lenses = (
        f"Lenses calibrated twice as well (focal length to {percent(0.5 * sigma.focal)} %, centre "
        f"to {digits(0.5 * sigma.centre_px, 2)} px)"
    )
    baseline, bar = digits(500 * sigma.baseline_m, 2), digits(500 * sigma.bar_m, 2)
    noise = digits(0.5 * plan.noise_px, 2)
    positions, better = (
        _position_error(fit, precision) for precision in (P, fit.precision_knowing(LENSES_TWICE))
    )
    # Each with the fraction of the planned error that is left, and that error.
    improvements = [
        (
            error / fit.length_p95,
            f"{text}: 95 % of lengths within {percent(error)} % instead of "
            f"{percent(fit.length_p95)} %.",
        )
        for text, error in (
            *_another_baseline(plan, baselines, errors),
            _more_bars(fit),
            (better_lenses, lenses),
            (f"The baseline measured to {baseline} mm", known(baseline=0.5)),
            (f"The bar measured to {bar} mm", known(object=0.5)),
            (
                f"Half the noise in the images, {noise} px (larger targets, sharper images)",
                half_noise,
            ),
            *_longer_bar(fit),
        )
    ]
    instead = f"positions to {distance(better)} instead of {distance(positions)}."
    improvements.append((better / positions, f"{better_lenses}: {instead}"))
    worth = [
        text
        for fraction, text in sorted(improvements, key=lambda improvement: improvement[0])
        if fraction < WORTH_IT
    ]
    nothing = (
        "No single change would help much: neither another baseline, more bars, better known "
        "lenses nor a longer bar."
    )
    return Advice(limit, tuple(worth) or (nothing,), baselines, errors)


def _baseline_scan(fit: ExpectedFit) -> tuple[FloatArray, FloatArray]:
    """Baselines in m, and the length error with each; NaN where the common view is lost."""
    plan = fit.plan
    baselines = plan.baseline_m * BASELINES
    errors = np.where(BASELINES == 1.0, fit.length_p95, np.nan)
    for k in np.flatnonzero(BASELINES != 1.0):
        with suppress(StereocalError):
            other = with_baseline(plan, float(baselines[k]))
            if len(other.common_points) >= KEPT_VIEW * len(plan.common_points):
                errors[k] = expect(other).length_p95
    return baselines, errors


def with_baseline(plan: Plan, baseline_m: float) -> Plan:
    """The plan with another baseline, the cameras aimed at the same place as before."""
    stated, factor = plan.stated_pose, baseline_m / plan.baseline_m
    if isinstance(stated, AimedPose):
        toe = float(np.degrees(np.arctan(factor * np.tan(np.radians(stated.toe_in_deg)))))
        toe = float(np.clip(toe, -LARGEST_TOE_IN_DEG, LARGEST_TOE_IN_DEG))
        height = min(abs(stated.height_difference_m), 0.9 * baseline_m)
        height = float(np.copysign(height, stated.height_difference_m))
        return replace(plan, stated_pose=AimedPose(baseline_m, round(toe, 2), height))
    pose = plan.pose
    aim = plan.common_points.mean(axis=0)
    before, centre = pose.apply(aim), -factor * pose.R.T @ pose.T
    after = pose.R @ (aim - centre)
    turned = Rotation.align_vectors(before, after)[0].as_matrix() @ pose.R
    return replace(plan, stated_pose=Pose(turned, -turned @ centre))


def _another_baseline(
    plan: Plan, baselines: FloatArray, errors: FloatArray
) -> list[tuple[str, float]]:
    if not np.isfinite(errors).any():
        return []
    k = int(np.flatnonzero(errors <= NEARLY_LEAST * np.nanmin(errors))[0])
    text = f"A baseline of {rounded(baselines[k])} m instead of {rounded(plan.baseline_m, 3)} m"
    stated = with_baseline(plan, float(baselines[k])).stated_pose
    if isinstance(stated, AimedPose):
        text += f", each camera turned in by {rounded(stated.toe_in_deg)}°"
    return [(text, float(errors[k]))]


def _more_bars(fit: ExpectedFit) -> tuple[str, float]:
    """Twice as many bars, where they help most."""
    result, depths = fit.result, fit.ends_m[..., 2].mean(axis=1)
    directions = fit.ends_m.mean(axis=1)[:, :2] / depths[:, None]
    away = np.linalg.norm(directions - np.median(directions, axis=0), axis=1)
    third, two_thirds = np.quantile(depths, [1 / 3, 2 / 3])
    places = {
        "all over the volume": np.ones(len(depths), dtype=np.bool_),
        f"nearer than {rounded(third)} m": depths <= third,
        f"farther than {rounded(two_thirds)} m": depths >= two_thirds,
        "towards the edges of the images": away >= np.median(away),
    }
    errors = {
        f"{fit.plan.frames} more bars, {where}": fit.length_p95_with(
            result.information + fit.plan.frames * fit.information_of(np.asarray(among)),
            result.unknowns.precision,
        )
        for where, among in places.items()
    }
    return min(errors.items(), key=lambda item: item[1])


def _position_error(fit: ExpectedFit, precision: FloatArray) -> float:
    """Mean standard error of the ends of the bars in m, with a precision of the priors."""
    known = replace(fit.result.unknowns, precision=precision)
    covariances = point_covariances(replace(fit.result, unknowns=known), fit.ends_m.reshape(-1, 3))
    return float(np.mean(np.sqrt(np.trace(covariances, axis1=1, axis2=2))))


def _longer_bar(fit: ExpectedFit) -> list[tuple[str, float]]:
    """A bar twice as long, for lengths like the planned one's."""
    longer = 2.0 * fit.plan.bar_m
    try:
        other = expect(replace(fit.plan, bar_m=longer)).result
    except StereocalError:
        return []
    error = fit.length_p95_with(other.information, other.unknowns.precision)
    return [(f"A bar of {rounded(longer)} m instead of {rounded(fit.plan.bar_m)} m", error)]
