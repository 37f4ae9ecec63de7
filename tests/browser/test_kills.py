"""A server that is killed while somebody works: `python -m tests.browser.kills` in small."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.kills import Trial

pytestmark = pytest.mark.browser


def test_nothing_acknowledged_is_lost_when_the_server_is_killed(tmp_path: Path) -> None:
    trial = Trial(tmp_path, seed=3, log=None)
    for activity in (
        "upload a table",
        "type lengths",
        "upload zips",
        "correct targets",
        "find targets",
        "calibrate",
        "validate",
    ):
        trial.kill_during(activity)
    assert "0 are not in the list" in trial.finish()
    assert trial.problems == []
    assert sum(count["kills"] for count in trial.counts.values()) == 7
    assert sum(count["acknowledged"] for count in trial.counts.values()) > 0
