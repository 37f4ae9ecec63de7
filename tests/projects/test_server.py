"""Settings of the server come from the environment, with a sentence for what is none."""

from __future__ import annotations

import math

import pytest

from stereocal.projects.server_settings import ServerSettings


def test_defaults_are_those_of_a_persons_own_computer() -> None:
    settings = ServerSettings.from_environment({"STEREOCAL_SHARED": " "})
    assert settings == ServerSettings(False, math.inf, 30.0)


def test_what_is_given_holds() -> None:
    settings = ServerSettings.from_environment(
        {"STEREOCAL_SHARED": "1", "STEREOCAL_KEEP_DAYS": "90", "STEREOCAL_UNDO_DAYS": "0"}
    )
    assert settings == ServerSettings(True, 90.0, 0.0)


@pytest.mark.parametrize(("value", "workers"), [("1", 1), ("3.9", 3), ("inf", 1000)])
def test_workers(value: str, workers: int) -> None:
    assert ServerSettings.from_environment({"STEREOCAL_WORKERS": value}).workers == workers
