"""CPU time of each test, which says more than wall time where other work runs beside.

    python -m pytest -p tests.cpu_time

Processes that a test starts and waits for count; what the first of a module prepares counts for it.
"""

import resource
from collections.abc import Generator

import pytest

SHOWN = 30
_TAKEN: dict[str, float] = {}


def _used() -> float:
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    found = map(resource.getrusage, kinds)
    return sum(each.ru_utime + each.ru_stime for each in found)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Measure a test with its fixtures."""
    before = _used()
    ran = yield
    _TAKEN[item.nodeid] = _used() - before
    return ran


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The sum, and the tests that took most."""
    terminalreporter.write_line(f"CPU time of {len(_TAKEN)} tests: {sum(_TAKEN.values()):.1f} s")
    for test in sorted(_TAKEN, key=lambda each: -_TAKEN[each])[:SHOWN]:
        terminalreporter.write_line(f"{_TAKEN[test]:7.2f} s  {test}")
