"""The answer of a check in words, and as `check.json`."""

from typing import Any

import numpy as np

from stereocal.evaluation.summary import Estimate
from stereocal.field.checking.findings import LARGEST_NOISE_RATIO, Recheck
from stereocal.field.checking.repair import length_error
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import decimals_of, rounded
from stereocal.verdict.in_words import digits, named_frames

CHECK_FORMAT = "stereocal-check/1"
AXES = ("horizontal", "vertical", "optical")
CERTAIN = 0.99
ALIKE = 1.5
"""Design effect from which on it is reported."""
FEW = 1.5
"""Independent bars or points that are as good as one."""
NEAR_AXIS, MOSTLY = 0.94, 0.8
"""Cosines of 20 and 37 degrees."""
OWN_IMAGES = (
    "Cannot tell with these: the parameters come from these images, which do not show what "
    "has changed since. Check with new ones."
)


def sentence(check: Recheck) -> str:
    """The answer: what happened, by how much, since when."""
    if not check.usable:
        return (
            f"Cannot tell with these: the points fit no pose of these cameras within "
            f"{LARGEST_NOISE_RATIO:g} times the noise of the calibration "
            f"({digits(check.noise.sigma_px, 2)} px instead of {digits(check.prior.sigma_px, 2)} "
            "px). Check that the pairs are right, and of the same cameras."
        )
    if check.images.own:
        return OWN_IMAGES
    if not check.changed:
        return _unchanged(check)
    text, since = what_changed(check), check.since
    if since is not None:
        between = f" (between {since.low} and {since.high})" * (since.low != since.high)
        text += f" Since frame {since.frame}{between}."
    return f"{text} {_repair(check)}".rstrip()


def to_json(check: Recheck, repaired: str | None = None) -> dict[str, Any]:
    """The content of `check.json`; `repaired` names the repaired file, if one is written."""
    turn, vector = check.turn
    baseline, power, since = check.prior.rig.pose.baseline, check.power, check.since
    return {
        "format": CHECK_FORMAT,
        "verdict": check.verdict,
        "reason": sentence(check),
        "rotation_rad": vars(turn),
        "rotation_axis": (vector / max(float(np.linalg.norm(vector)), 1e-300)).tolist(),
        "baseline_m": vars(check.baseline_m)
        if check.baseline_m
        else {"value": baseline, "low": None, "high": None},
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
        "frames_left_out": _left_out(check),
        "repaired": repaired,
        "notes": notes(check),
    }


def notes(check: Recheck) -> list[str]:
    """Further messages: groups left out, other noise, what matched points do not show."""
    messages = list(check.images.notes)
    if left_out := _left_out(check):
        more = f" and {len(left_out) - 5} more" if len(left_out) > 5 else ""
        messages.append(
            f"Points of {named_frames(left_out[:5])}{more} contradict the others and were left out."
        )
    if not check.noise.as_before and check.usable:
        messages.append(
            f"The noise is {digits(check.noise.sigma_px, 2)} px, at the calibration it was "
            f"{digits(check.prior.sigma_px, 2)} px; that of the new images was used."
        )
    if check.noise.design_effect >= ALIKE:
        groups = int((~check.noise.outlying).sum())
        what, independent = "bars" if check.scale else "points", groups / check.noise.design_effect
        as_few = f"{groups} {what} tell as much as about {independent:.0f} independent ones."
        if independent < FEW:
            as_few = (
                f"the {groups} {what} tell hardly more than one. Take more of them, near and far "
                "and all over the images; if the calibration says that its lenses do not fit, "
                "calibrate them first."
            )
        messages.append(f"Errors of neighbouring frames are alike: {as_few}")
    if not check.scale:
        messages.append(
            "Matched points alone do not show the baseline: that of the file was kept. To check "
            "it, record a few bars."
        )
    return messages


def _left_out(check: Recheck) -> list[int]:
    return sorted({int(n) for n in check.images.numbers[check.noise.outlying]})


def what_changed(check: Recheck) -> str:
    """What happened, and by how much."""
    lenses = _refocused(check)
    both_free = "would explain the images about as well; in the repaired parameters both are free."
    if not check.pose_moved:
        also = f"A movement {both_free}" if check.ambiguous else "The cameras have not moved."
        return f"Refocused: {lenses}. {also}"
    text = f"Moved: {_turn(check)}."
    change, baseline = check.baseline_change, check.baseline_m
    if change is not None and baseline is not None and change.low * change.high > 0:
        text += f" The baseline is {_longer(change)}: {rounded(baseline.value, 4)} m."
    if lenses:
        return f"{text} Besides, {lenses}."
    return f"{text} A refocused lens {both_free}" if check.ambiguous else text


def _turn(check: Recheck) -> str:
    (turn, vector), change = check.turn, check.baseline_change
    if turn.low <= 0:
        if change is not None and change.low * change.high > 0:
            return (
                "the distance of the cameras changed, without a turn above "
                f"{rounded(np.degrees(turn.high))}°"
            )
        return f"the pose of the cameras changed a little, {_limits(check)}"
    angle = size_range(turn, 180 / np.pi, "°")
    match check.possible_causes:
        case ("primary",):
            in_primary = -check.prior.rig.pose.R.T @ vector
            return f"the primary turned in place by {angle} {_about(in_primary)}"
        case ("secondary",):
            return f"the secondary turned in place by {angle} {_about(vector)}"
    by = f"by {angle} " + _about(vector, "the secondary's")
    if check.possible_causes:
        return f"one camera turned relative to the other {by}; which one, images cannot tell"
    return f"one camera turned and moved relative to the other, {by}"


def _about(vector: FloatArray, whose: str = "its") -> str:
    unit = np.abs(vector) / np.linalg.norm(vector)
    first, second, _ = np.argsort(-unit)
    if unit[first] < MOSTLY:
        return f"about an axis between {whose} {AXES[first]} and {AXES[second]} axes"
    mostly = "" if unit[first] > NEAR_AXIS else "mostly "
    return f"{mostly}about {whose} {AXES[first]} axis"


def _refocused(check: Recheck) -> str:
    parts = [
        f"the focal length of the {which} is {_longer(change)}"
        for which, change in check.focal_changes.items()
    ]
    other = "primary" if check.refocused == ("secondary",) else "secondary"
    doubt = f", or that of the {other} (images cannot tell which)" if check.either_lens else ""
    return " and ".join(parts) + doubt


def _repair(check: Recheck) -> str:
    if not check.offers_repair:
        was, now = check.held_out.length or check.held_out.px
        what, unit, per = ("bars", " %", 100.0) if check.held_out.length else ("points", " px", 1.0)
        return (
            f"No repaired parameters are offered: held-out {what} are measured no better with them "
            f"({digits(per * now, 2)}{unit} instead of {digits(per * was, 2)}{unit}). Calibrate "
            "again."
        )
    error = length_error(check.best, check.noise.sigma_px)
    if error is None:
        return ""
    return (
        "The repaired parameters measure similar bars with an expected error of "
        f"{digits(100 * error, 2)} %."
    )


def _limits(check: Recheck) -> str:
    """How large the changes of turn and baseline are at most."""
    change = check.baseline_change
    text = f"by a turn below {rounded(np.degrees(check.turn[0].high))}°"
    if change is None:
        return text
    reach = digits(100 * max(abs(change.low), abs(change.high)), 2)
    return f"{text} and a change of the baseline below {reach} %"


def _unchanged(check: Recheck) -> str:
    if check.negligible:
        return f"Same: a change is seen, but smaller than matters: {_limits(check)}."
    power, turn = check.power, f"{rounded(np.degrees(check.smallest.turn_rad))}°"
    baseline = f"{rounded(100 * check.smallest.baseline)} %"
    if check.verdict == "same":
        least = power.turn if power.baseline is None else min(power.turn, power.baseline)
        chance = f"{100 * least:.0f} %" if least < CERTAIN else f"more than {100 * CERTAIN:.0f} %"
        also = "" if power.baseline is None else f" or a change of the baseline by {baseline}"
        return (
            f"Same: no movement is seen; a turn of one camera by {turn}{also} would have been "
            f"found with a probability of {chance}."
        )
    less = f"one camera turned by less than {rounded(np.degrees(power.detectable_turn_rad))}°"
    if power.detectable_baseline is not None:
        percent = digits(100 * power.detectable_baseline, 2)
        less += f", or the baseline changed by less than {percent} %"
        turn += f" and {baseline}"
    return (
        f"Cannot tell with {check.images.described} whether {less}: a larger movement would be "
        f"found (with a probability of 80 %), and none is seen. What matters is {turn}: more of "
        "them, near and far and all over the images, show smaller movements."
    )


def _longer(change: Estimate) -> str:
    return f"{size_range(change, 100, ' %')} {'longer' if change.value > 0 else 'shorter'}"


def size_range(estimate: Estimate, factor: float, unit: str) -> str:
    """The size of a value with its interval, in the digits that the interval leaves."""
    places = decimals_of(factor * (estimate.high - estimate.low))
    ends = (estimate.low, estimate.high) if estimate.value >= 0 else (-estimate.high, -estimate.low)
    value, low, high = (f"{factor * x:.{places}f}" for x in (abs(estimate.value), *ends))
    return f"{value}{unit} ({low} to {high})"
