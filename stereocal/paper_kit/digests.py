"""Whether two parameter files are the same: by digest, or within a tolerance.

On one computer the same versions give the same digests. Other processors round differently, which
was measured with other code paths of OpenBLAS and Numba (`OPENBLAS_CORETYPE`, `NUMBA_CPU_NAME`) on
two data sets: poses of refined sets changed by 1e-8, their other figures by 1e-4 at most. A search
may decide a move otherwise where two costs agree to rounding, and then ends elsewhere: one 3D set
of 25 bars changed by 2e-6 rad, one of its figures by 1 %.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from stereocal.system.numbers import rounded

NOT_COMPARED = ("created", "software")
PARAMETERS = ("cameras", "R", "T", "E", "angles", "baseline_m")
"""Entries of a parameter file that give the pose and the lenses."""
NUMBER = re.compile(r"\d+(?:\.(\d+))?(?:e([-+]?\d+))?")


@dataclass(frozen=True)
class Tolerance:
    """How much numbers may differ, relative to the largest number of their list or to themselves.

    An element of a rotation matrix thus differs by as many radians.
    """

    parameters: float
    figures: float

    def of(self, entry: str) -> float:
        """The tolerance of an entry of the file, by the name at its top level."""
        return self.parameters if entry in PARAMETERS else self.figures

    def __str__(self) -> str:
        return f"{self.parameters:g} of pose and lenses, {self.figures:g} of other figures"


SEARCHED, ADJUSTED = Tolerance(1e-4, 5e-2), Tolerance(1e-6, 1e-3)
"""Of the sets that a search found, and of the refined set."""


def compared(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a parameter file without what may differ between equal results."""
    return {name: value for name, value in content.items() if name not in NOT_COMPARED}


def digest_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of the JSON without `created` and `software`: keys sorted, no spaces, UTF-8."""
    text = json.dumps(
        compared(content),
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=False,
        allow_nan=False,
    )
    return hashlib.sha256(text.encode()).hexdigest()


def differences(
    archived: Mapping[str, Any], now: Mapping[str, Any], tolerance: Tolerance
) -> list[str]:
    """The entries of two parameter files that differ by more than the tolerance, in words."""
    one, other = compared(archived), compared(now)
    return [
        found
        for name in {**one, **other}
        for found in _differ(name, one.get(name), other.get(name), tolerance.of(name), 0.0)
    ]


def _differ(where: str, one: Any, other: Any, tolerance: float, scale: float) -> Iterator[str]:
    """Args: scale: the largest number beside these, of which the tolerance is a fraction."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for name in {**one, **other}:
            path = f"{where}.{name}"
            yield from _differ(path, one.get(name), other.get(name), tolerance, 0.0)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        beside = max((abs(each) for each in one if is_number(each)), default=0.0)
        for at, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _differ(f"{where}[{at}]", a, b, tolerance, beside)
    elif not _equal(one, other, tolerance, scale):
        yield _difference(where, one, other)


def _difference(where: str, archived: Any, now: Any) -> str:
    if isinstance(archived, list | dict) or isinstance(now, list | dict):
        return f"{where}: other contents"
    by = ""
    if is_number(archived) and is_number(now):
        by = f", a difference of {rounded(abs(now - archived))}"
    return f"{where}: {_shown(archived)} in the archive, now {_shown(now)}{by}"


def _equal(one: Any, other: Any, tolerance: float, scale: float) -> bool:
    if isinstance(one, str) and isinstance(other, str) and " " in one:
        # A sentence: only numbers may differ, by the tolerance and a unit of their last digit.
        pairs = zip(NUMBER.finditer(one), NUMBER.finditer(other), strict=False)
        return NUMBER.sub("#", one) == NUMBER.sub("#", other) and all(
            abs(float(a[0]) - float(b[0]))
            <= tolerance * max(float(a[0]), float(b[0])) + 1.001 * max(map(_unit, (a, b)))
            < math.inf
            for a, b in pairs
        )
    if is_number(one) and is_number(other) and isinstance(one + other, float):
        limit = tolerance * max(abs(one), abs(other), scale)
        return math.isclose(one, other, rel_tol=0.0, abs_tol=limit)
    return bool(one == other and type(one) is type(other))


def _unit(number: re.Match[str]) -> float:
    return float(f"1e{number[2] or 0}") * 10.0 ** -len(number[1] or "")


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.12g}"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 70 else f"{text[:66]}...{text[-1]}"
