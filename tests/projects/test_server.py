"""Settings of the server come from the environment, with a sentence for what is none."""

from __future__ import annotations

import math

import pytest

from stereocal.projects.server_settings import ServerSettings


def test_what_is_given_holds_and_the_rest_is_as_on_a_persons_own_computer() -> None:
    read = ServerSettings.from_environment
    assert read({"STEREOCAL_SHARED": " "}) == ServerSettings(False, math.inf, 30.0)
    given = {"STEREOCAL_SHARED": "1", "STEREOCAL_KEEP_DAYS": "90", "STEREOCAL_UNDO_DAYS": "0"}
    assert read(given) == ServerSettings(True, 90.0, 0.0)


@pytest.mark.parametrize(("value", "workers"), [("1", 1), ("3.9", 3), ("inf", 1000)])
def test_workers(value: str, workers: int) -> None:
    assert ServerSettings.from_environment({"STEREOCAL_WORKERS": value}).workers == workers
