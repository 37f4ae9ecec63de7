"""Numbers in sentences, tables and JSON."""

import math
from collections.abc import Mapping
from typing import Any

POSSIBLE_M = (1e-9, 1e6)
"""Lengths and their errors that can be computed with: the square of 1e308 is infinite, of 1e-320
zero. What is plausible is narrower."""
POSSIBLE_PX = (1e-6, 1e6)
"""The same of errors and sizes in an image."""
SEEDS = (0, 2**63 - 1)


def digits(value: float, significant: int = 3) -> str:
    """A number with `significant` digits, with an exponent only from 1e5 or below 1e-4."""
    if not math.isfinite(value):
        return "none"
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        decimals = 0 if value == 0 else significant - 1 - math.floor(math.log10(abs(value)))
        return f"{value:.{max(0, decimals)}f}"
    return f"{value:.{significant - 1}e}"


def rounded(value: float, significant: int = 2) -> str:
    """Significant digits, no zeros at the end: `4.5`, not `4.500`; 238 is `238`, not `2.4e+02`."""
    text = digits(value, significant)
    mantissa, exponent, power = text.partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return mantissa + exponent + power


def distance(metres: float) -> str:
    """A length in the unit that suits it."""
    if metres < 0.01:
        return f"{rounded(1000 * metres)} mm"
    return f"{rounded(100 * metres)} cm" if metres < 1 else f"{rounded(metres)} m"


SINGULAR = {"are": "is", "were": "was", "have": "has", "do": "does", "lie": "lies"}


def with_error(value: float, sigma: float, least: int = 0) -> str:
    """`7124.3 ± 1.4`: the error with two significant digits, the value with as many decimals."""
    decimals = max(decimals_of(sigma), least)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"


def decimals_of(sigma: float) -> int:
    """Decimals that show two digits of an error; 3 of one that is 0."""
    return min(max(1 - math.floor(math.log10(sigma)), 0), 9) if 0 < sigma < math.inf else 3


def is_number(text: str) -> bool:
    """Whether a text is a number as Python reads it, infinity and NaN too."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def plural(n: int, what: str) -> str:
    """A noun as it follows this number: `frame` of 1, `frames` of 0, 2 and more."""
    return what if n == 1 else f"{what}s"


def count(n: int, what: str, verb: str = "") -> str:
    """`1 frame`, `1,150 frames`; with a verb in the plural `1 frame is`, `25 frames are`."""
    counted = f"{n:,} {plural(n, what)}"
    return f"{counted} {SINGULAR[verb] if n == 1 else verb}" if verb else counted


def without_nan(value: Any) -> Any:
    """The value with NaN and infinity replaced by None, since JSON has neither."""
    if isinstance(value, Mapping):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
