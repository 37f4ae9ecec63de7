"""Numbers in sentences: sensible digits, and no exponents where people read metres and pixels."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from stereocal.system.numbers import digits, rounded

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("value", "significant", "expected"),
    [
        (238.4, 2, "238"),
        (99.96, 2, "100"),
        (4.5, 4, "4.5"),
        (4.9764, 4, "4.976"),
        (0.00371, 2, "0.0037"),
        (0.0, 2, "0"),
        (-12.04, 3, "-12"),
        (float("nan"), 2, "none"),
        (3.2e-14, 2, "3.2e-14"),
        (5e6, 3, "5e+06"),
    ],
)
def test_rounded(value: float, significant: int, expected: str) -> None:
    assert rounded(value, significant) == expected


def test_digits_keeps_the_zeros_of_a_measured_value() -> None:
    assert digits(4.5, 4) == "4.500"


def test_no_sentence_formats_a_number_so_that_100_becomes_1e2() -> None:
    """`f"{100:.2g}"` is 1e+02; only numbers that are read back, and costs and steps, may be so."""
    found = [
        f"{path.name}: {line.strip()}"
        for folder in ("stereocal", "pages")
        for path in (ROOT / folder).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.search(r":\.\dg\}", line) and not re.search(r"float\(f\"|cost %|step %", line)
    ]
    assert not found
