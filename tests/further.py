"""Further cases of what one case shows: tests of `make soak`."""

from typing import Any

import pytest


def further(*cases: Any) -> list[Any]:
    """Parameters of a test that only the soak tests."""
    tuples = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*each, marks=pytest.mark.soak) for each in tuples]
