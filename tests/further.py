"""Further cases of what one case shows: tests of the whole `make soak`."""

from typing import Any

import pytest

from tests.soak import SHORT


def further(*cases: Any) -> list[Any]:
    """Parameters of a test that only the soak tests; none of them in a short one."""
    tuples = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [] if SHORT else [pytest.param(*each, marks=pytest.mark.soak) for each in tuples]
