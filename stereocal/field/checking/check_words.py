"""The answer of a check in words, and as `check.json`."""

from __future__ import annotations

from typing import Any

import numpy as np

from stereocal.evaluation.summary import Estimate
from stereocal.field.checking.findings import LARGEST_NOISE_RATIO, Recheck
from stereocal.field.checking.repair import length_error
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import digits, listed

CHECK_FORMAT = "stereocal-check/1"
AXES = ("horizontal", "vertical", "optical")
CERTAIN = 0.99
ALIKE = 1.5
"""Design effect from which on it is reported."""
NEAR_AXIS, MOSTLY = 0.94, 0.8
"""Cosines of 20 and 37 degrees."""


def sentence(check: Recheck) -> str:
    """The answer: what happened, by how much, since when."""
    if not check.usable:
        return (
            f"Cannot tell with these: the points fit no pose of these cameras within "
            f"{LARGEST_NOISE_RATIO:g} times the noise of the calibration "
            f"({digits(check.noise.sigma_px, 2)} px instead of {digits(check.prior.sigma_px, 2)} "
            "px). Check that the pairs are right, and of the same cameras."
        )
    if check.changed:
        return " ".join([what_changed(check), *_since(check), *_repair(check)])
    return _same(check) if check.verdict == "same" else _cannot_tell(check)


def to_json(check: Recheck, repaired: str | None = None) -> dict[str, Any]:
    """The content of `check.json`.

    Args:
        repaired: name of the repaired file, if one is written.
    """
    turn, vector = check.turn
    baseline, power, since = check.baseline_m, check.power, check.since
    return {
        "format": CHECK_FORMAT,
        "verdict": check.verdict,
        "reason": sentence(check),
        "rotation_rad": vars(turn),
        "rotation_axis": (vector / max(float(np.linalg.norm(vector)), 1e-300)).tolist(),
        "baseline_m": {"value": check.prior.rig.pose.baseline, "low": None, "high": None}
        if baseline is None
        else vars(baseline),
        "pose_moved": check.pose_moved,
        "turned_in_place": list(check.possible_causes) if check.pose_moved else [],
        "refocused": {name: vars(change) for name, change in check.focal_changes.items()},
        "ambiguous": check.ambiguous or check.either_lens,
        "since_frame": None
        if since is None or not check.changed
        else {"value": since.frame, "low": since.low, "high": since.high},
        "p_value": {"pose": check.p_pose, "focal_length": check.p_focal},
        "power": {
            "turn_rad": check.smallest.turn_rad,
            "turn": power.turn,
            "turn_about_random_axis": power.turn_anywhere,
            "baseline_fraction": check.smallest.baseline,
            "baseline": power.baseline,
            "detectable_turn_rad": power.detectable_turn_rad,
            "detectable_baseline_fraction": power.detectable_baseline,
        },
        "noise_px": check.noise.sigma_px,
        "frames_left_out": sorted({int(n) for n in check.images.numbers[check.noise.outlying]}),
        "repaired": repaired,
        "notes": notes(check),
    }


def notes(check: Recheck) -> list[str]:
    """Further messages: groups left out, other noise, what matched points do not show."""
    found = list(check.images.notes)
    left_out = sorted({int(n) for n in check.images.numbers[check.noise.outlying]})
    if left_out:
        many = f" and {len(left_out) - 5} more" if len(left_out) > 5 else ""
        found.append(
            f"Points of frame{'s' * (len(left_out) > 1)} {listed(left_out[:5])}{many} contradict "
            "the others and were left out."
        )
    if not check.noise.as_before and check.usable:
        found.append(
            f"The noise is {digits(check.noise.sigma_px, 2)} px, at the calibration it was "
            f"{digits(check.prior.sigma_px, 2)} px; that of the new images was used."
        )
    if check.noise.design_effect >= ALIKE:
        groups = int((~check.noise.outlying).sum())
        found.append(
            f"Errors of neighbouring frames are alike: {groups} "
            f"{'bars' if check.scale else 'points'} tell as much as about "
            f"{groups / check.noise.design_effect:.0f} independent ones."
        )
    if not check.scale:
        found.append(
            "Matched points alone do not show the baseline: that of the file was kept. To check "
            "it, record a few bars."
        )
    return found


def what_changed(check: Recheck) -> str:
    """What happened, and by how much."""
    lenses = _refocused(check)
    if not check.pose_moved:
        also = (
            "A movement would explain the images about as well; in the repaired parameters both "
            "are free."
            if check.ambiguous
            else "The cameras have not moved."
        )
        return f"Refocused: {lenses}. {also}"
    found = f"Moved: {_turn(check)}."
    change, baseline = check.baseline_change, check.baseline_m
    if change is not None and baseline is not None and change.low * change.high > 0:
        word = "longer" if change.value > 0 else "shorter"
        found += (
            f" The baseline is {_range(abs_of(change), 100, ' %')} {word}: "
            f"{rounded(baseline.value, 4)} m."
        )
    if lenses:
        found += f" Besides, {lenses}."
    elif check.ambiguous:
        found += (
            " A refocused lens would explain the images about as well; in the repaired parameters "
            "both are free."
        )
    return found


def _turn(check: Recheck) -> str:
    turn, vector = check.turn
    if turn.low <= 0:
        change = check.baseline_change
        if change is not None and change.low * change.high > 0:
            limit = f"without a turn above {_degrees(turn.high)}°"
            return f"the distance of the cameras changed, {limit}"
        return f"the pose of the cameras changed a little, {_limits(check)}"
    angle = _range(turn, 180 / np.pi, "°")
    causes = check.possible_causes
    if causes == ("primary",):
        own = -check.prior.rig.pose.R.T @ vector
        return f"the primary turned in place by {angle} {_about(own)}"
    if causes == ("secondary",):
        return f"the secondary turned in place by {angle} {_about(vector)}"
    which = (
        "one camera turned relative to the other"
        if causes
        else "one camera turned and moved relative to the other,"
    )
    tail = "; which one, images cannot tell" if causes else ""
    about = _about(vector, "the secondary's")
    return f"{which} by {angle} {about}{tail}"


def _about(vector: FloatArray, whose: str = "its") -> str:
    unit = np.abs(vector) / np.linalg.norm(vector)
    axis = int(np.argmax(unit))
    if unit[axis] < MOSTLY:
        first, second = np.argsort(-unit)[:2]
        return f"about an axis between {whose} {AXES[first]} and {AXES[second]} axes"
    mostly = "" if unit[axis] > NEAR_AXIS else "mostly "
    return f"{mostly}about {whose} {AXES[axis]} axis"


def _refocused(check: Recheck) -> str:
    parts = []
    for which, change in check.focal_changes.items():
        word = "longer" if change.value > 0 else "shorter"
        parts.append(
            f"the focal length of the {which} is {_range(abs_of(change), 100, ' %')} {word}"
        )
    other = "primary" if check.refocused == ("secondary",) else "secondary"
    doubt = f", or that of the {other} (images cannot tell which)" if check.either_lens else ""
    return " and ".join(parts) + doubt


def _since(check: Recheck) -> list[str]:
    if check.since is None:
        return []
    since = check.since
    if since.low == since.high:
        return [f"Since frame {since.frame}."]
    return [f"Since frame {since.frame} (between {since.low} and {since.high})."]


def _repair(check: Recheck) -> list[str]:
    if check.images.own:
        return [
            "These are the images that the parameters come from, so no repaired parameters are "
            "offered: they would hold no better for others. Check with new images."
        ]
    if not check.offers_repair:
        was, now = check.held_out.length or check.held_out.px
        unit, per = (" %", 100.0) if check.held_out.length else (" px", 1.0)
        return [
            f"No repaired parameters are offered: held-out {'bars' if unit == ' %' else 'points'} "
            f"are measured no better with them ({digits(per * now, 2)}{unit} instead of "
            f"{digits(per * was, 2)}{unit}). Calibrate again."
        ]
    error = length_error(check.best, check.noise.sigma_px)
    if error is None:
        return []
    return [
        "The repaired parameters measure similar bars with an expected error of "
        f"{digits(100 * error, 2)} %."
    ]


def _limits(check: Recheck) -> str:
    """How large the changes of turn and baseline are at most."""
    change = check.baseline_change
    found = f"by a turn below {_degrees(check.turn[0].high)}°"
    if change is None:
        return found
    reach = digits(100 * max(abs(change.low), abs(change.high)), 2)
    return f"{found} and a change of the baseline below {reach} %"


def _same(check: Recheck) -> str:
    if check.negligible:
        return f"Same: a change is seen, but smaller than matters: {_limits(check)}."
    power = check.power
    whole = power.turn if power.baseline is None else min(power.turn, power.baseline)
    chance = f"{100 * whole:.0f} %" if whole < CERTAIN else f"more than {100 * CERTAIN:.0f} %"
    return (
        f"Same: no movement is seen; {_smallest(check)} would have been found with a probability "
        f"of {chance}."
    )


def _cannot_tell(check: Recheck) -> str:
    power, images = check.power, check.images
    sizes = f"a turn of one camera by {_degrees(power.detectable_turn_rad)}° or more"
    asked = f"{_degrees(check.smallest.turn_rad)}°"
    if power.detectable_baseline is not None:
        percent = digits(100 * power.detectable_baseline, 2)
        sizes += f", or a change of the baseline of {percent} % or more"
        asked += f" and {rounded(100 * check.smallest.baseline)} %"
    return (
        f"Cannot tell with {images.described}: no movement is seen, but only {sizes} would be "
        f"found (with a probability of 80 %). What matters is {asked}: more of them, near and far "
        "and all over the images, show smaller movements."
    )


def _smallest(check: Recheck) -> str:
    turn = f"a turn of one camera by {_degrees(check.smallest.turn_rad)}°"
    if check.power.baseline is None:
        return turn
    return f"{turn} or a change of the baseline by {rounded(100 * check.smallest.baseline)} %"


def abs_of(change: Estimate) -> Estimate:
    """A change as its size: of a negative one, the sign is dropped and the ends are exchanged."""
    if change.value >= 0:
        return change
    return Estimate(-change.value, -change.high, -change.low)


def _degrees(angle_rad: float) -> str:
    return f"{rounded(np.degrees(angle_rad))}"


def _range(found: Estimate, factor: float, unit: str) -> str:
    """A value with its interval, in the digits that the interval leaves."""
    spread = max(factor * (found.high - found.low), 1e-9)
    places = int(np.clip(1 - np.floor(np.log10(spread)), 0, 6))
    value, low, high = (f"{factor * x:.{places}f}" for x in (found.value, found.low, found.high))
    return f"{value}{unit} ({low} to {high})"
