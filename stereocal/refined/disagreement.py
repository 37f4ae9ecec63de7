"""Which input disagrees with the others: the baseline, the bar, a focal length, a principal point.

An input with prior variance P that is estimated with posterior variance C differs from the stated
value by a number of variance P - C, if all is as stated. That quotient is the test of a single
observation (Baarda's w-test), and of several wrong suspects the one with the largest is the
likeliest. So the largest is named, freed, and the others are tested again without it: one wrong
input pulls at all of them, and the healthy ones must not be accused for it.

A wrong input also leaves residuals, which must not be taken for noise: the noise is estimated with
all priors ten times as wide, and held while testing. (Measured, baseline typed 3 % wrong: without
this the test's value is 4.8, with it 7.5.)

Images fix the ratio of baseline and bar, not which of the two is wrong. Of inputs that explain the
conflict equally well, the one is named that has to be off by the fewest of its own uncertainties
(the baseline by twice as many: it ends at points inside the lenses, that nobody can see or touch);
the others are its rivals and are named beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import ndtri_exp

from stereocal.errors import StereocalError
from stereocal.refined.bar_fit import BAR, BASELINE, PRIMARY, SECONDARY, SHARED
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.stated_inputs import LENGTHS, Input, advice_on, doubt, pair_advice
from stereocal.refined.unknowns import (
    LensPrior,
    RefineSettings,
    baseline_sigma_m,
    distance_sigma_m,
    lens_prior,
)
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray

ACCUSED = 3.2
"""In standard errors. With six inputs, a sound rig is accused in 1 % of all cases."""

WIDER = 10.0

AS_WELL = 0.95
"""An input whose test comes so near to the largest explains the conflict as well."""

EASILY_WRONG = {"baseline": 2.0}
"""An input so many times as easily off as its uncertainty says, compared with its rivals."""

SILENT = 1e-4
"""Where the images lower the prior's variance by a smaller part, they say nothing about it."""


def what_disagrees(result: RefinedResult) -> list[Input]:
    """All inputs that have a prior; the accused ones first, then by `standard_errors`.

    Solves again for each accused input.
    """
    current = _with_its_noise(result)
    found = {key: _input(result, key, value) for key, (value, _) in _tests(current).items()}
    named: list[str] = []
    while True:
        suspects = {
            k: t
            for k, t in _tests(current).items()
            if t[0] >= ACCUSED and not _the_only_scale(current, k)
        }
        if not suspects:
            break
        largest = max(value for value, _ in suspects.values())
        alike = [k for k, (value, _) in suspects.items() if value >= AS_WELL * largest]
        key, *rivals = sorted(alike, key=lambda k: suspects[k][1] / EASILY_WRONG.get(k, 1.0))
        named.append(key)
        freed = {
            each: refine(result.dataset, _freed(current, each), current.pose, result.rows)
            for each in (key, *(set(rivals) & LENGTHS if key in LENGTHS else ()))
        }
        found[key] = _accused(found[key], freed, tuple(rivals), found)
        current = freed[key]
    rest = sorted(
        (key for key in found if key not in named),
        key=lambda key: -np.nan_to_num(found[key].standard_errors, nan=-1.0),
    )
    return [found[key] for key in [*named, *rest]]


def _the_only_scale(result: RefinedResult, key: str) -> bool:
    """Whether nothing else fixes the scale: the other length is free already."""
    settings = result.settings
    other = {"baseline": settings.distance_sigma_m, "distance": settings.baseline_sigma_m}.get(key)
    return other is not None and bool(np.isinf(other))


def _with_its_noise(result: RefinedResult) -> RefinedResult:
    """The result with the noise of a solve whose priors are wide, where it was not given."""
    settings, dataset = result.settings, result.dataset
    wide = replace(
        settings,
        primary=_widened(lens_prior(dataset.primary, settings.primary)),
        secondary=_widened(lens_prior(dataset.secondary, settings.secondary)),
        baseline_sigma_m=WIDER * baseline_sigma_m(dataset, settings),
        distance_sigma_m=WIDER * distance_sigma_m(dataset, settings),
    )
    try:
        noise = refine(dataset, wide, result.pose, result.rows)
        held = replace(settings, sigma_px=noise.sigma_px.value, scatter_m=noise.scatter_m.value)
        return refine(dataset, held, result.pose, result.rows)
    except StereocalError:  # so few frames that wide priors fit anything
        return result


def _widened(lens: LensPrior) -> LensPrior:
    return replace(lens, focal=WIDER * lens.focal, centre_px=WIDER * lens.centre_px)


def _tests(result: RefinedResult) -> dict[str, tuple[float, float]]:
    """Of each input that has a prior: how many standard errors the data want to move it, and by
    how many of its own uncertainties it must be off for the conflict to vanish.
    """
    found = {}
    for key, columns in _columns(result).items():
        prior = np.diag(np.square(result.unknowns.sigma[columns]))
        if not np.isfinite(prior).all():
            continue
        gained = prior - result.p_covariance[np.ix_(columns, columns)]
        scale = 1.0 / np.sqrt(np.diag(prior))
        informed, along = np.linalg.eigh(gained * np.outer(scale, scale))
        moved = along.T @ (result.p[columns] * scale)
        keep = informed > SILENT
        if not keep.any():
            found[key] = float("nan"), float("nan")
            continue
        moved, informed = moved[keep], informed[keep]
        square = float(np.sum(np.square(moved) / informed))
        found[key] = _as_normal(square, len(moved)), float(np.linalg.norm(moved / informed))
    return found


def _as_normal(square: float, freedom: int) -> float:
    """|z| of a normal number that is as rare as this value of chi-squared with 1 or 2 degrees."""
    if freedom == 1:
        return float(np.sqrt(square))
    return max(float(-ndtri_exp(-0.5 * square - np.log(2.0))), 0.0)


def _columns(result: RefinedResult) -> dict[str, list[int]]:
    """The free numbers of each input."""
    names = result.unknowns.names
    groups = {"baseline": ["baseline"], "distance": ["bar"]}
    for camera in CAMERAS:
        groups[f"{camera} focal"] = [f"{camera} {key}" for key in ("focal", "fx", "fy")]
        groups[f"{camera} centre"] = [f"{camera} {key}" for key in ("cx", "cy")]
    found = {
        key: [names.index(name) for name in members if name in names]
        for key, members in groups.items()
    }
    return {key: columns for key, columns in found.items() if columns}


def _values(result: RefinedResult, key: str, values: FloatArray) -> FloatArray:
    """What belongs to an input of the 15 shared unknowns, in its unit."""
    if key == "baseline":
        return values[[BASELINE]]
    if key == "distance":
        return values[[BAR]] * result.dataset.target_distance_m
    at = PRIMARY if key.startswith("primary") else SECONDARY
    return values[at : at + 2] if key.endswith("focal") else values[at + 2 : at + 4]


def _input(result: RefinedResult, key: str, standard_errors: float) -> Input:
    columns = _columns(result)[key]
    M, sigma = result.unknowns.M[:, columns], result.unknowns.sigma[columns]
    prior = np.sqrt(np.sum(np.square(M * sigma), axis=1)) if len(columns) else np.zeros(SHARED)
    before = _values(result, key, prior)
    after = _values(result, key, np.sqrt(np.diag(result.covariance)))
    with np.errstate(divide="ignore", invalid="ignore"):
        informed = 1.0 - np.square(after / before)
        noticed = np.where(informed > SILENT, ACCUSED * before / np.sqrt(informed), np.inf)
    return Input(
        key=key,
        unit="m" if key in LENGTHS else "px",
        stated=_values(result, key, result.unknowns.origin),
        prior_sigma=before,
        estimate=_values(result, key, result.q),
        sigma=after,
        standard_errors=standard_errors,
        accused=False,
        others_say=None,
        others_sigma=None,
        rivals=(),
        sigma_stated=_sigma_stated(result, key),
        noticed=noticed,
        advice="",
    )


def _sigma_stated(result: RefinedResult, key: str) -> bool:
    settings, dataset = result.settings, result.dataset
    if key == "baseline":
        return (settings.baseline_sigma_m or dataset.baseline_sigma_m) is not None
    if key == "distance":
        return (settings.distance_sigma_m or dataset.target_distance_sigma_m) is not None
    which = key.split()[0]
    # A result has its lens priors written out: nobody stated the usual ones.
    usual = getattr(settings, which) in (None, LensPrior())
    return not usual or getattr(dataset, which).uncertainty is not None


def _freed(result: RefinedResult, key: str) -> RefineSettings:
    """The settings of a result without the prior of one input."""
    settings = result.settings
    if key == "baseline":
        return replace(settings, baseline_sigma_m=np.inf)
    if key == "distance":
        return replace(settings, distance_sigma_m=np.inf)
    camera, part = key.split()
    lens = lens_prior(getattr(result.dataset, camera), getattr(settings, camera))
    lens = replace(lens, focal=np.inf) if part == "focal" else replace(lens, centre_px=np.inf)
    return (
        replace(settings, primary=lens)
        if camera == "primary"
        else replace(settings, secondary=lens)
    )


def _accused(
    item: Input,
    freed: Mapping[str, RefinedResult],
    rivals: tuple[str, ...],
    inputs: Mapping[str, Input],
) -> Input:
    say, sigma = _others_say(item.key, freed)
    if item.key in LENGTHS and len(freed) > 1:
        advice = pair_advice(
            [
                (each, *_others_say(each.key, freed))
                for each in (item, *(inputs[key] for key in freed if key != item.key))
            ]
        ) + doubt(tuple(set(rivals) - LENGTHS))
    else:
        advice = advice_on(item.key, item.stated, say, sigma) + doubt(rivals)
    return replace(
        item, accused=True, others_say=say, others_sigma=sigma, rivals=rivals, advice=advice
    )


def _others_say(key: str, freed: Mapping[str, RefinedResult]) -> tuple[FloatArray, FloatArray]:
    """What the others say of an input, and its standard error."""
    own = freed[key]
    return _values(own, key, own.q), _values(own, key, np.sqrt(np.diag(own.covariance)))
