"""One stated input against what the other data say, and the words for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import FloatArray

LENGTHS = {"baseline", "distance"}
"""Images fix their ratio, so one of them must stay known."""


@dataclass(frozen=True, eq=False)
class Input:
    """One stated input against what the other data say. Arrays: one number, or two for a point."""

    key: str
    """`baseline`, `distance`, `primary focal`, `primary centre`, `secondary focal`, ..."""
    unit: str
    """`m` or `px`."""
    stated: FloatArray
    prior_sigma: FloatArray
    estimate: FloatArray
    """With the prior."""
    sigma: FloatArray
    standard_errors: float
    """How far the data want to move it: the test's value; NaN where they say nothing."""
    accused: bool
    others_say: FloatArray | None
    """The estimate without its own prior, for an accused input."""
    others_sigma: FloatArray | None
    rivals: tuple[str, ...]
    """Keys of inputs that, wrong, would explain as much as this accused one."""
    sigma_stated: bool
    """Whether somebody said how well it is known; else a usual figure is assumed."""
    noticed: FloatArray
    """From which error on the images would contradict it; infinite where they say nothing."""
    advice: str
    """What disagrees and what to do, for an accused input; else empty."""


def what_could_not_be_told(inputs: Sequence[Input]) -> str:
    """What nobody stated the uncertainty of, which errors that hides, and what to state.

    Empty where all was stated.
    """
    hidden, assumed, remedies = [], [], []
    for keys, name, remedy in _ASKED:
        unstated = [item for item in inputs if item.key in keys and not item.sigma_stated]
        if not unstated:
            continue
        # The one of a kind that the images say most of.
        item = min(unstated, key=lambda each: float(each.noticed.min() / each.prior_sigma.min()))
        noticed, unit = float(item.noticed.min()), item.unit
        sigma = float(item.prior_sigma.min())
        if unit == "m":
            noticed, sigma, unit = 1000 * noticed, 1000 * sigma, "mm"
        limit = f"up to {_round(noticed)} {unit}" if np.isfinite(noticed) else "of any size"
        hidden.append(f"of {name} {limit}")
        assumed.append(f"± {_round(sigma)} {unit}")
        remedies += [remedy] * (remedy not in remedies)
    if not hidden:
        return ""
    return (
        f"Cannot tell errors {', '.join(hidden)}: how well these are known was not stated, and "
        f"{', '.join(assumed)} {'was' if len(assumed) == 1 else 'were'} assumed. To settle it, "
        f"state {'; '.join(remedies)}."
    )


_ASKED = (
    (("baseline",), "the baseline", "how the lengths were measured (laser 2 mm, tape 5 mm)"),
    (
        ("distance",),
        "the distance between the targets",
        "how the lengths were measured (laser 2 mm, tape 5 mm)",
    ),
    (
        ("primary focal", "secondary focal"),
        "a focal length",
        "the standard errors of the lens calibration",
    ),
    (
        ("primary centre", "secondary centre"),
        "an image centre",
        "the standard errors of the lens calibration",
    ),
)


def advice_on(key: str, stated: FloatArray, say: FloatArray, sigma: FloatArray) -> str:
    given, found = in_digits(stated, sigma), f"{in_digits(say, sigma)} ± {in_digits(sigma, sigma)}"
    if key == "baseline":
        return (
            f"The measured baseline is {given} m; images and bars say {found} m. Measure between "
            "the entrance pupils, or widen its uncertainty."
        )
    if key == "distance":
        return (
            f"The measured distance between the targets is {given} m; images and baseline say "
            f"{found} m. Measure between the centres of the targets, or widen its uncertainty."
        )
    camera, part = key.split()
    if part == "focal":
        return (
            f"The {camera} camera's focal length (fx, fy) is given as {given} px; images and "
            f"lengths say {found} px. Were focus or zoom touched after this lens was calibrated? "
            "Calibrate it again, or widen its uncertainty."
        )
    return (
        f"The {camera} camera's principal point (cx, cy) is given as {given} px; images and "
        f"lengths say {found} px. Was the image cropped or the lens moved after it was calibrated? "
        "Calibrate it again, or widen its uncertainty."
    )


def doubt(rivals: tuple[str, ...]) -> str:
    if not rivals:
        return ""
    names = " or ".join(NAMES[key] for key in rivals)
    return f" An error of {names} would explain the images as well."


NAMES = {
    "baseline": "the measured baseline",
    "distance": "the measured distance between the targets",
    **{
        f"{camera} {part}": f"the {camera} camera's {name}"
        for camera in CAMERAS
        for part, name in (("focal", "focal length"), ("centre", "principal point"))
    },
}


def in_digits(values: FloatArray, sigma: FloatArray) -> str:
    """As many digits as the standard error allows: its first two."""
    smallest = max(float(np.min(sigma)), 1e-12)
    digits = int(np.clip(1 - np.floor(np.log10(smallest)), 0, 9))
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _round(value: float) -> str:
    """Two significant digits, rounded up: an error above it shows."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / step) * step:.{max(0, -int(np.floor(np.log10(step))))}f}"


def pair_advice(cases_of: Sequence[tuple[Input, FloatArray, FloatArray]]) -> str:
    """Baseline and bar, which the images cannot tell apart, with what speaks against each.

    Args:
        cases_of: the likelier one first: what was stated, what the others say, its standard error.
    """
    item = cases_of[0][0]
    cases = []
    for each, say, sigma in cases_of:
        off = float(np.abs(say - each.stated)[0] / each.prior_sigma[0])
        stated = "stated" if each.sigma_stated else "assumed"
        cases.append(
            f"{NAMES[each.key]} is {in_digits(say, sigma)} ± {in_digits(sigma, sigma)} m and not "
            f"{in_digits(each.stated, sigma)} m, off by {off:.2g} times its {stated} uncertainty"
        )
    reason = (
        "It ends at points inside the lenses: measure it again, between the entrance pupils."
        if item.key == "baseline"
        else "Measure it again, between the centres of the targets."
    )
    return (
        "Baseline and distance between the targets do not go together; the images fix their "
        f"ratio, not which is wrong. Either {cases[0]}; or {cases[1]}. The first is likelier. "
        f"{reason}"
    )
