"""Test which input disagrees with the others: baseline, bar, or a part of a lens.

If an input with prior variance P is estimated with posterior variance C, the difference between
the estimate and the stated value has the variance P - C, provided that all inputs are correct. The
test value is the difference over its standard deviation (Baarda's w-test). The input with the
largest value is the likeliest to be wrong. It is reported and freed, and the others are tested
again without it, because a wrong input biases the estimates of the correct ones.

A wrong input also increases the residuals, which must not count as noise. The noise is therefore
estimated with all priors ten times as wide, and held fixed during the tests. (Measured with a
baseline that is 3 % wrong: test value 7.5, and 4.8 without this.)

The images determine the ratio of baseline and bar, not which of the two is wrong. Of inputs that
explain the conflict equally well, the one with the smallest error in units of its own uncertainty
is reported first, and the others are its rivals. The baseline may have twice the error, because it
ends at invisible points inside the lenses.

A distortion without a stated uncertainty is held fixed and has no prior to test. It is tested by
how much chi-square falls when it is free (F test of k1, k2, p1 and p2). The F test divides by the
chi-square that remains, so that a noise that is estimated too large because of the wrong distortion
does not hide it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtri, ndtri_exp

from stereocal.errors import StereocalError
from stereocal.fit.errors.stated_inputs import (
    LENGTHS,
    Input,
    advice_on,
    note_on_rivals,
    pair_advice,
)
from stereocal.fit.least_squares.small_steps import FACTOR, baseline_direction, lens_places
from stereocal.fit.least_squares.unknowns import (
    LensPrior,
    RefineSettings,
    baseline_sigma_m,
    distance_sigma_m,
    free_distortion,
    lens_prior,
    lenses_of,
)
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import CAMERAS, LENS_UNKNOWNS
from stereocal.system.array_types import FloatArray

ACCUSED = 3.2
"""Threshold of the test value, in standard errors: with six correct inputs, one of them exceeds it
in 1 % of the cases."""

WIDER = 10.0

COEFFICIENTS = 4
"""Of a distortion: k1, k2, p1, p2."""

EQUAL_FIT = 0.95
"""An input whose test value is this fraction of the largest explains the conflict equally well."""

UNCERTAINTY_FACTOR = {"baseline": 2.0}
"""Factor of the uncertainty of an input when it is compared with its rivals."""

MINIMUM_INFORMATION = 1e-4
"""The images have no information about an input if they reduce its prior variance by less than this
fraction."""


INPUTS: Mapping[str, tuple[tuple[str, ...], list[int]]] = {
    "baseline": ((), []),
    "distance": (("object",), [FACTOR]),
    **{
        f"{camera} {part}": (tuple(f"{camera} {key}" for key in keys), lens_places(number)[span])
        for number, camera in enumerate(CAMERAS)
        for part, keys, span in (
            ("focal", ("focal", "fx", "fy"), slice(0, 2)),
            ("centre", ("cx", "cy"), slice(2, 4)),
            ("distortion", LENS_UNKNOWNS[4:], slice(4, 8)),
        )
    },
}
"""Names of the free parameters of each, and its places in q; the baseline is a length of T."""


@dataclass(frozen=True, eq=False)
class InputComparison:
    """All inputs compared with the other data."""

    inputs: list[Input]
    """The accused inputs first, then the others by falling `standard_errors`."""
    model: RefinedResult
    """The fit without the priors of the accused inputs; the given one if none is accused."""


def compare_inputs(result: RefinedResult) -> InputComparison:
    """Test all inputs that have a prior, and a fixed distortion; solves again for each test.

    Those of a pair of a rig are the rig's, which tests its own.
    """
    if result.settings.of_rig is not None:
        return InputComparison([], result)
    current = _with_its_noise(result)
    tests = _tests(current)
    inputs = {key: _input(result, key, value) for key, (value, _) in tests.items()}
    named: list[str] = []
    undetermined: set[str] = set()
    while True:
        known = current.settings
        # Nothing else fixes the scale once the other length has been freed.
        scale = {"baseline": known.distance_sigma_m, "distance": known.baseline_sigma_m}
        suspects = {
            k: t
            for k, t in tests.items()
            if t[0] >= ACCUSED and k not in {*named, *undetermined} and scale.get(k) != np.inf
        }
        if not suspects:
            break
        largest = max(value for value, _ in suspects.values())
        alike = [k for k, (value, _) in suspects.items() if value >= EQUAL_FIT * largest]
        key, *rivals = sorted(alike, key=lambda k: suspects[k][1] / UNCERTAINTY_FACTOR.get(k, 1.0))
        try:
            freed = {
                k: refine(result.dataset, _freed(current, k), current.pose, result.rows)
                for k in (key, *(set(rivals) & LENGTHS.keys() if key in LENGTHS else ()))
            }
        except StereocalError:  # the other data do not say what it is instead
            undetermined.add(key)
            continue
        named.append(key)
        inputs[key] = _accused(inputs[key], freed, tuple(rivals), inputs)
        current = freed[key]
        tests = _tests(current)
    rest = sorted(
        (key for key in inputs if key not in named),
        key=lambda key: -np.nan_to_num(inputs[key].standard_errors, nan=-1.0),
    )
    model = result
    if named:
        settings = replace(
            current.settings, sigma_px=result.settings.sigma_px, scatter_m=result.settings.scatter_m
        )
        model = refine(result.dataset, settings, current.pose, result.rows)
    return InputComparison([inputs[key] for key in [*named, *rest]], model)


def _with_its_noise(result: RefinedResult) -> RefinedResult:
    """The result of a solve whose noise, unless given, was estimated with wide priors."""
    settings, dataset = result.settings, result.dataset
    lenses = lenses_of(dataset.recording, settings)
    wide = replace(
        settings,
        lenses={label: _widened(prior) for label, prior in lenses.items()},
        baseline_sigma_m=WIDER * baseline_sigma_m(dataset, settings),
        distance_sigma_m=WIDER * distance_sigma_m(dataset.recording, settings),
    )
    try:
        noise = refine(dataset, wide, result.pose, result.rows, near=result)
        held = replace(settings, sigma_px=noise.sigma_px.value, scatter_m=noise.scatter_m.value)
        return refine(dataset, held, result.pose, result.rows, near=result)
    except StereocalError:  # too few frames for wide priors
        return result


def _widened(lens: LensPrior) -> LensPrior:
    k1, k2, p1, p2 = (WIDER * sigma for sigma in lens.distortion)
    focal, centre_px = WIDER * lens.focal, WIDER * lens.centre_px
    return replace(lens, focal=focal, centre_px=centre_px, distortion=(k1, k2, p1, p2))


def _tests(result: RefinedResult) -> dict[str, tuple[float, float]]:
    """The test value of each input, and the error that would explain the conflict.

    The test value is (estimate - stated) / sqrt(P - C) with the variances P before and C after the
    fit (Baarda; docs/refined.md, *What disagrees*). An input of several values has the normal
    number as likely as its chi-square in the directions that the images inform about.

    The error is in units of the input's own uncertainty; of a distortion without one it is 1.
    """
    tests, M, C = {}, result.unknowns.M, result.p_covariance_by_model
    # What frames that follow each other add to the variance of the estimates, but not to C.
    spread = C - (result.design_effect - 1.0) * C @ M.T @ result.information @ M @ C
    for key in INPUTS:
        columns = _columns(result, key)
        if not len(columns) and key.endswith("distortion"):
            tests[key] = _distortion_test(result, key), 1.0
        if not len(columns) or not np.isfinite(prior := _prior(result, key, columns)).all():
            continue
        gained = prior - columns @ spread @ columns.T
        scale = 1.0 / np.sqrt(np.diag(prior))
        informed, along = np.linalg.eigh(gained * np.outer(scale, scale))
        moved = along.T @ (columns @ result.p * scale)
        keep = informed > MINIMUM_INFORMATION
        if not keep.any():
            tests[key] = float("nan"), float("nan")
            continue
        moved, informed = moved[keep], informed[keep]
        square = float(np.sum(np.square(moved) / informed))
        tests[key] = _as_normal(square, len(moved)), float(np.linalg.norm(moved / informed))
    return tests


def _distortion_test(result: RefinedResult, key: str) -> float:
    """|z| of the F test whether a distortion that is held fixed differs from the stated one."""
    noise: dict[str, Any] = {
        name: getattr(result, name).value for name in ("sigma_px", "scatter_m")
    }
    settings = replace(_freed(result, key), **noise, loss="squares")
    try:
        freed = refine(result.dataset, settings, result.pose, result.used_rows)
    except StereocalError:
        return float("nan")
    used = int(result.degrees_of_freedom[~result.outlying].sum())
    left = max(used - len(result.unknowns.names) - COEFFICIENTS, 1)
    gain = max(result.cost - freed.cost, 0.0) / COEFFICIENTS / freed.design_effect
    return _as_z(float(fdtrc(COEFFICIENTS, left, gain / max(freed.cost / left, 1e-12))))


def _as_normal(chi_square: float, degrees_of_freedom: int) -> float:
    """|z| of the normal distribution with the p-value of this chi-square."""
    if degrees_of_freedom == 1:
        return float(np.sqrt(chi_square))
    if degrees_of_freedom == 2:
        return max(float(-ndtri_exp(-0.5 * chi_square - np.log(2.0))), 0.0)
    return _as_z(float(chdtrc(degrees_of_freedom, chi_square)))


def _as_z(probability: float) -> float:
    return max(float(-ndtri(0.5 * max(probability, 1e-300))), 0.0)


def _columns(result: RefinedResult, key: str) -> FloatArray:
    """(m, k): the m values of an input by the free parameters; none if it is held fixed."""
    names = result.unknowns.names
    if key == "baseline":
        known = baseline_sigma_m(result.dataset, result.settings) > 0.0
        return np.asarray(baseline_direction(result.at) @ result.unknowns.M)[None][: int(known)]
    return np.eye(len(names))[[names.index(name) for name in INPUTS[key][0] if name in names]]


def _prior(result: RefinedResult, key: str, columns: FloatArray) -> FloatArray:
    """(m, m): the prior covariance of an input; infinite if it has none."""
    if key == "baseline":
        return np.full((1, 1), baseline_sigma_m(result.dataset, result.settings) ** 2)
    free = np.flatnonzero(columns.any(axis=0))
    if not np.isfinite(result.unknowns.sigma[free]).all():
        return np.full((len(free), len(free)), np.inf)
    return result.unknowns.prior_covariance(free.tolist())


def _values(result: RefinedResult, key: str) -> tuple[FloatArray, FloatArray]:
    """The values of an input, in its unit, and their standard errors."""
    if key == "baseline":
        along = baseline_direction(result.at)
        sigma = np.sqrt(along @ result.covariance @ along)
        return np.array([result.pose.baseline]), np.array([sigma])
    unit, places = result.dataset.target_distance_m if key == "distance" else 1.0, INPUTS[key][1]
    sigmas = np.sqrt(np.diag(result.covariance)[places])
    return unit * result.at.q[places], unit * sigmas


def _input(result: RefinedResult, key: str, standard_errors: float) -> Input:
    columns, places = _columns(result, key), INPUTS[key][1]
    prior = _prior(result, key, columns)
    if key == "baseline":
        stated, before = np.array([result.dataset.baseline_m]), np.sqrt(np.diag(prior))
    else:
        unit = result.dataset.target_distance_m if key == "distance" else 1.0
        M, free = result.unknowns.M[places], np.flatnonzero(columns.any(axis=0))
        spread = np.abs(M[:, free]) * result.unknowns.sigma[free]
        before = unit * np.sqrt(np.square(spread).sum(axis=1))
        stated = unit * result.unknowns.origin[places]
    estimate, after = _values(result, key)
    with np.errstate(divide="ignore", invalid="ignore"):
        informed = 1.0 - np.square(after / before)
        detectable = ACCUSED * before / np.sqrt(informed)
    return Input(
        key=key,
        unit="m" if key in LENGTHS else "" if key.endswith("distortion") else "px",
        stated=stated,
        prior_sigma=before,
        estimate=estimate,
        sigma=after,
        standard_errors=standard_errors,
        sigma_stated=_sigma_stated(result, key),
        detectable=np.where(informed > MINIMUM_INFORMATION, detectable, np.inf),
    )


def _sigma_stated(result: RefinedResult, key: str) -> bool:
    settings, dataset = result.settings, result.dataset
    if key == "baseline":
        return {settings.baseline_sigma_m, dataset.baseline_sigma_m} != {None}
    if key == "distance":
        return {settings.distance_sigma_m, dataset.target_distance_sigma_m} != {None}
    which = key.split()[0]
    camera, given = getattr(dataset, which), settings.lenses.get(which)
    if key.endswith("distortion"):
        return any(lens_prior(camera, given).distortion)
    # The settings of a result have explicit lens priors: the default ones were not stated.
    return given not in (None, LensPrior()) or camera.uncertainty is not None


def _freed(result: RefinedResult, key: str) -> RefineSettings:
    """The settings of a result without the prior of one input."""
    change: dict[str, Any] = {f"{key}_sigma_m": np.inf}
    if key in LENGTHS:
        return replace(result.settings, **change)
    which, part = key.split()
    camera = getattr(result.dataset, which)
    priors: dict[str, dict[str, Any]] = {
        "focal": {"focal": np.inf},
        "centre": {"centre_px": np.inf},
        "distortion": {"distortion": free_distortion(camera)},
    }
    lenses = lenses_of(result.dataset.recording, result.settings)
    lenses[which] = replace(lenses[which], **priors[part])
    return replace(result.settings, lenses=lenses)


def _accused(
    item: Input,
    freed: Mapping[str, RefinedResult],
    rivals: tuple[str, ...],
    inputs: Mapping[str, Input],
) -> Input:
    """An input with its estimate from the other data, and the message about it."""
    others = {key: _values(fit, key) for key, fit in freed.items()}
    (say, sigma), fit = others[item.key], freed[item.key]
    if len(freed) > 1:
        other = next(key for key in freed if key != item.key)
        cases = (item, *others[item.key]), (inputs[other], *others[other])
        advice = pair_advice(cases) + note_on_rivals(tuple(set(rivals) - LENGTHS.keys()))
    else:
        camera = fit.secondary if item.key.startswith("secondary") else fit.primary
        advice = advice_on(item.key, item.stated, say, sigma, camera.lens_names[4:8])
        advice += note_on_rivals(rivals)
    return replace(
        item, accused=True, others_say=say, others_sigma=sigma, rivals=rivals, advice=advice
    )
