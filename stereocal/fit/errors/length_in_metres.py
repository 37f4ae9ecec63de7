"""The error of a length in metres, in words.

It has two parts: what lengths scatter by relative to the bar, which held-out bars show, and the
error of the bar itself, which all lengths share and no bar shows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.fit.least_squares.unknowns import DEFAULT_DISTANCE
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import distance, rounded

NEARLY_ALL, MOST = 0.8, 0.5
"""Shares of the square of an error."""
NORMAL_95 = 1.96
"""Standard deviations that 95 % of a normal distribution are within."""
BETTER_KNOWN, CONTRADICTED = 0.7, 1.5
"""Times what was stated of the bar: below it its error is known by the baseline as well; above it
the images contradict the bar, which is free then."""


@dataclass(frozen=True)
class BarKnown:
    """How well the known distances are known."""

    word: str
    """What has them: a bar, a board or another object."""
    length_m: float
    sigma_m: float
    """Its standard deviation, stated or assumed."""
    is_stated: bool
    p95: float
    """The relative error that 95 % are within, given all that is known."""

    @classmethod
    def of(
        cls, word: str, length_m: float, stated_m: float | None, p95: float | None
    ) -> "BarKnown":
        """What is known by what is stated of a bar, else by the default.

        Args:
            p95: by a fit that knows the baseline too; None: by what is stated alone.
        """
        sigma = DEFAULT_DISTANCE * length_m if stated_m is None else stated_m
        error_p95 = NORMAL_95 * sigma / length_m if p95 is None else p95
        return cls(word, length_m, sigma, stated_m is not None, error_p95)

    @property
    def _by_itself(self) -> float:
        """The same by what is stated or assumed alone."""
        return NORMAL_95 * self.sigma_m / self.length_m

    @property
    def in_words(self) -> str:
        """`the bar, which is taken as known to ± 0.9 mm`."""
        if self.p95 < BETTER_KNOWN * self._by_itself:
            return f"the lengths of {self.word} and baseline"
        if self.p95 > CONTRADICTED * self._by_itself:
            return f"the {self.word}, which the images contradict"
        known = f"± {rounded(1000 * self.sigma_m)} mm"
        if self.word != "bar":
            known = f"± {rounded(100 * self.sigma_m / self.length_m)} %"
        taken = "was stated to be known to" if self.is_stated else "is taken as known to"
        return f"the {self.word}, which {taken} {known}"

    @property
    def remedy(self) -> str:
        """What lowers its error."""
        them = "them" if self.p95 < BETTER_KNOWN * self._by_itself else "it"
        return f"measure {them} better" + ", or say how it was measured" * (not self.is_stated)


def p95_of_factor(factor: float, variance: float) -> float:
    """The relative error that 95 % of a fitted factor of the known distances are within."""
    return NORMAL_95 * math.sqrt(max(variance, 0.0)) / factor


def length_in_words(
    total: float, scatter: float | None, bar: BarKnown, lengths_m: FloatArray | Sequence[float]
) -> str:
    """How well a length is known, in its own unit, and which part of the error is the larger.

    Of the power of ten next to the known distances, because the share that image noise has in a
    relative error depends on the length.

    Args:
        total: the relative error that 95 % of lengths in metres are within.
        scatter: the same relative to the bar; None if unknown.
        lengths_m: the known distances.
    """
    length = 10.0 ** round(math.log10(float(np.median(lengths_m))))
    share = (bar.p95 / total) ** 2 if total > 0 else 0.0
    right_to = distance(total * length)
    text = f"A length of {distance(length)} is right to {right_to}, 95 % of the time"
    if share > MOST:
        part = "nearly all of it" if share > NEARLY_ALL else "most of it"
        text += f", {part} from {bar.in_words}: {bar.remedy}"
    else:
        text += ", most of it scatter of single lengths"
    alone = right_to if scatter is None else distance(scatter * length)
    if alone == right_to:
        return f"{text}."
    return f"{text}. Relative to the {bar.word} it is right to {alone}."
