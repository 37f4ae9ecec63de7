"""The comparison of a stated input with the other data, and its messages."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

LENGTHS = {
    "baseline": ("Baseline", "the measured baseline"),
    "distance": ("Distance A–B", "the measured distance between the targets"),
}
"""Of which the images determine only the ratio: titles, and names in a sentence."""
_PARTS = {
    "focal": ("Focal length", "focal length"),
    "centre": ("Image centre", "principal point"),
    "distortion": ("Distortion", "distortion"),
}
"""The same of parts of a lens."""
FAR_OFF = 0.05
"""Of a stated input: 2.5 % of the image diagonal for a centre."""
_LENGTH_NAMES = {"baseline": "The baseline", "distance": "The distance between the targets"}


@dataclass(frozen=True, eq=False)
class Input:
    """One stated input compared with the other data.

    Arrays have one number, two for (fx, fy) and (cx, cy), or four for (k1, k2, p1, p2).
    """

    key: str
    """`baseline`, `distance`, `primary focal`, `primary centre`, `primary distortion`, ..."""
    unit: str
    """`m` or `px`; empty for a distortion."""
    stated: FloatArray
    prior_sigma: FloatArray
    estimate: FloatArray
    """Estimate that includes the prior."""
    sigma: FloatArray
    """Standard error of `estimate`."""
    standard_errors: float
    """Test value: disagreement with the other data in standard errors; NaN if they have no
    information about this input."""
    sigma_stated: bool
    """Whether its uncertainty was stated; otherwise a default is assumed."""
    detectable: FloatArray
    """Smallest error that the test would detect; infinite if the other data have no information."""
    accused: bool = False
    """Whether the input disagrees with the other data; the following are of accused ones."""
    others_say: FloatArray | None = None
    """Its estimate from the other data alone."""
    others_sigma: FloatArray | None = None
    rivals: tuple[str, ...] = ()
    """Keys of inputs whose error would explain the data equally well."""
    advice: str = ""
    """Message with the disagreement and the remedy."""

    @property
    def title(self) -> str:
        """Its name in figures and tables."""
        return _names(self.key)[0]


def undetectable_errors(inputs: Sequence[Input]) -> str:
    """Message about errors that cannot be detected because uncertainties were not stated.

    It says how large such errors can be and what to state; empty if all uncertainties are stated.
    """
    hidden, assumed, remedies = [], [], []
    for keys, name, remedy in _ASKED:
        unstated = [item for item in inputs if item.key in keys and not item.sigma_stated]
        if not unstated:
            continue
        # Of the two cameras, the one about which the images have most information.
        item = min(unstated, key=lambda item: float(item.detectable.min() / item.prior_sigma.min()))
        detectable, unit = float(item.detectable.min()), item.unit
        sigma = float(item.prior_sigma.min())
        if unit == "m":
            detectable, sigma, unit = 1000 * detectable, 1000 * sigma, "mm"
        limit = (
            f"up to {_round_up(detectable)} {unit}" if np.isfinite(detectable) else "of any size"
        )
        hidden.append(f"of {name} {limit}")
        assumed.append(f"± {_round_up(sigma)} {unit}")
        remedies += [remedy] * (remedy not in remedies)
    if not hidden:
        return ""
    return (
        f"State {'; '.join(remedies)}: otherwise errors {', '.join(hidden)} go unnoticed "
        f"(assumed: {', '.join(assumed)})."
    )


def moved_lengths(inputs: Sequence[Input]) -> str:
    """Message about measured lengths that the fit leaves by more than their uncertainty; or empty.

    Such a length may be within what chance allows, and so not accused, but it is another one than
    was measured, and the refined set has it.
    """
    messages = (
        moved_length(
            _LENGTH_NAMES[item.key],
            float(item.estimate[0]),
            float(item.stated[0]),
            float(item.prior_sigma[0]),
            "stated" if item.sigma_stated else "assumed",
        )
        for item in inputs
        if item.key in LENGTHS
    )
    return " ".join(filter(None, messages))


def moved_length(name: str, fitted_m: float, measured_m: float, sigma_m: float, known: str) -> str:
    """Message about one measured length of a fit; empty if it is within its uncertainty.

    Args:
        known: `stated` or `assumed`, of the uncertainty.
    """
    away = abs(fitted_m - measured_m)
    if not away > sigma_m > 0:
        return ""
    fitted, measured = (in_digits(np.array([m]), np.array([away])) for m in (fitted_m, measured_m))
    return (
        f"{name} is {fitted} m in the fit and {measured} m as measured: {rounded(1000 * away)} mm "
        f"apart, more than its {known} uncertainty of {rounded(1000 * sigma_m)} mm. Measure it "
        "again, or state how it was measured."
    )


def far_off(inputs: Sequence[Input]) -> str:
    """Why no set is to be relied on, if an accused input is far off; or empty."""
    names = [_names(item.key)[1] for item in inputs if item.accused and _is_far_off(item)]
    if not names:
        return ""
    return f"The images contradict {' and '.join(names)} by far: correct it first."


def _is_far_off(item: Input) -> bool:
    """Whether a length, a focal length or a centre is off by `FAR_OFF`."""
    if item.others_say is None or item.key.endswith("distortion"):
        return False
    away = np.linalg.norm(item.others_say - item.stated)
    return bool(away > FAR_OFF * np.linalg.norm(item.stated))


_LENGTHS_ASKED = "how the lengths were measured (laser 2 mm, tape 5 mm)"
_LENSES_ASKED = "the standard errors of the lens calibration"
_ASKED = (
    (("baseline",), "the baseline", _LENGTHS_ASKED),
    (("distance",), "the distance between the targets", _LENGTHS_ASKED),
    (("primary focal", "secondary focal"), "a focal length", _LENSES_ASKED),
    (("primary centre", "secondary centre"), "an image centre", _LENSES_ASKED),
)


def advice_on(
    key: str, stated: FloatArray, say: FloatArray, sigma: FloatArray, coefficients: Sequence[str]
) -> str:
    """The message for an accused input.

    Args:
        key: as in `Input`.
        stated: the stated value.
        say: the estimate from the other data.
        sigma: its standard error.
        coefficients: names of the distortion coefficients of the accused camera.
    """
    camera, _, part = key.partition(" ")
    name, unit, others, remedy = {
        "baseline": (
            "The measured baseline is",
            " m",
            "images and bars",
            "Measure between the entrance pupils, or widen its uncertainty.",
        ),
        "distance": (
            "The measured distance between the targets is",
            " m",
            "images and baseline",
            "Measure between the centres of the targets, or widen its uncertainty.",
        ),
        "distortion": (
            f"The {camera} camera's distortion ({', '.join(coefficients)}) is stated as",
            "",
            "images and lengths",
            "Was the lens calibrated with another focus, or with few points near the edges? "
            "Calibrate it again, or let this fit estimate it (Estimate the distortion of, in the "
            "settings of Calibrate; or --free-distortion).",
        ),
        "focal": (
            f"The {camera} camera's focal length (fx, fy) is stated as",
            " px",
            "images and lengths",
            "Was focus or zoom changed after this lens was calibrated? Calibrate it again, or "
            "widen its uncertainty.",
        ),
        "centre": (
            f"The {camera} camera's principal point (cx, cy) is stated as",
            " px",
            "images and lengths",
            "Was the image cropped or the lens moved after it was calibrated? Calibrate it again, "
            "or widen its uncertainty.",
        ),
    }[part or key]
    estimate = f"{in_digits(say, sigma)} ± {in_digits(sigma, sigma)}"
    return f"{name} {in_digits(stated, sigma)}{unit}; {others} say {estimate}{unit}. {remedy}"


def note_on_rivals(rivals: tuple[str, ...]) -> str:
    """A sentence that names the inputs that would explain the data equally well; or empty."""
    if not rivals:
        return ""
    names = " or ".join(_names(key)[1] for key in rivals)
    return f" An error of {names} would explain the images as well."


def _names(key: str) -> tuple[str, str]:
    """The title of an input, and its name in a sentence."""
    if key in LENGTHS:
        return LENGTHS[key]
    camera, _, part = key.partition(" ")
    title, name = _PARTS[part]
    return f"{title}, {camera}", f"the {camera} camera's {name}"


def in_digits(values: FloatArray, sigma: FloatArray) -> str:
    """The values as text, rounded to the first two digits of the smallest standard error."""
    smallest = max(float(np.min(sigma)), 1e-12)
    digits = int(np.clip(1 - np.floor(np.log10(smallest)), 0, 9))
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _round_up(value: float) -> str:
    """Two significant digits, rounded up."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / step) * step:.{max(0, -int(np.floor(np.log10(step))))}f}"


def pair_advice(cases_of: Sequence[tuple[Input, FloatArray, FloatArray]]) -> str:
    """The message for a baseline and a bar that contradict each other.

    Args:
        cases_of: for each of the two, the likelier one first: the input, its estimate from the
            other data, and the standard error of that.
    """
    item = cases_of[0][0]
    cases = []
    for length, say, sigma in cases_of:
        off = float(np.abs(say - length.stated)[0] / length.prior_sigma[0])
        stated, (_, name) = "stated" if length.sigma_stated else "assumed", _names(length.key)
        cases.append(
            f"{name} is {in_digits(say, sigma)} ± {in_digits(sigma, sigma)} m and not "
            f"{in_digits(length.stated, sigma)} m, an error of {rounded(off)} times its {stated} "
            "uncertainty"
        )
    reason = (
        "Measure it again, between the entrance pupils inside the lenses."
        if item.key == "baseline"
        else "Measure it again, between the centres of the targets."
    )
    return (
        "Baseline and distance between the targets contradict each other; the images fix their "
        f"ratio, not which is wrong. Either {cases[0]}; or {cases[1]}. The first is likelier. "
        f"{reason}"
    )
