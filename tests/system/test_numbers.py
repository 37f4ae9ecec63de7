"""Numbers in sentences: sensible digits, and no exponents where people read metres and pixels."""

from __future__ import annotations

import pytest

from stereocal.system.numbers import rounded


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
