"""Refusals: the error, and the names and numbers that its message must hold, not its words."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from stereocal.errors import StereocalError

Raised = pytest.ExceptionInfo[StereocalError]


@contextmanager
def refused(
    *said: object, by: type[StereocalError] = StereocalError
) -> Iterator[pytest.ExceptionInfo[StereocalError]]:
    """What is done within is refused, and the message holds each of `said`."""
    with pytest.raises(by) as error:
        yield error
    told = str(error.value)
    assert [each for each in said if str(each) not in told] == [], told
