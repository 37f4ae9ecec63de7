"""Further cases of what one case shows: tests of the whole `make soak`."""

from collections.abc import Callable
from typing import Any, TypeVar

import pytest

from tests.soak import SHORT

OF_A_WHOLE_SOAK = [pytest.mark.soak, *([pytest.mark.skip("of a whole soak")] if SHORT else [])]

Test = TypeVar("Test", bound=Callable[..., None])


def of_a_whole_soak(test: Test) -> Test:
    """A test that only the soak runs, and a short one skips."""
    for mark in OF_A_WHOLE_SOAK:
        test = mark(test)
    return test


def further(*cases: Any) -> list[Any]:
    """Parameters of a test that only the soak tests, and a short one skips."""
    tuples = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*each, marks=OF_A_WHOLE_SOAK) for each in tuples]
