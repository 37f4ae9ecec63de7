"""What has changed since a result, and what is computed once."""

from typing import Any

import pytest

from stereocal.errors import StereocalError
from stereocal.projects.database import DiskFullError
from stereocal.system.latest import once_or_refused, read_once
from stereocal.system.made_from import as_digests, changed
from tests.refused import refused

THEN = {"baseline": "1 m", "Δ": 0.001, "drift": False, "frames": None, "points": [3, (4, 5)]}


def test_equal_parts_are_current_as_they_are_read_again() -> None:
    assert changed({**THEN, "points": [3, [4, 5]]}, THEN) == ""
    assert changed(THEN, {**THEN, "Δ": 0.001, "runs": 10}) == ""  # an earlier version had no runs


@pytest.mark.parametrize(
    ("now", "words"),
    [
        ({"baseline": "1.5 m"}, "baseline (1 m, now 1.5 m)"),
        ({"Δ": 0.002}, "Δ (0.001, now 0.002)"),
        ({"drift": True}, "drift (off, now on)"),
        ({"frames": 20}, "frames (all, now 20)"),
        ({"points": [3, [4, 6]]}, "points"),
        ({"Δ": 0.002, "points": []}, "Δ (0.001, now 0.002), points"),
    ],
)
def test_what_changed_is_named_with_short_values(now: dict[str, Any], words: str) -> None:
    assert changed(THEN, THEN | now) == words


def test_a_change_in_the_last_digits_is_seen() -> None:
    assert changed({"length": 0.1}, {"length": 0.1 + 1e-16 * 2}) != ""


def test_digests_tell_what_changed_without_its_values() -> None:
    assert changed(as_digests(THEN), as_digests(THEN | {"Δ": 0.002})) == "Δ"


def test_a_refusal_that_may_not_last_is_not_kept() -> None:
    def refuse() -> int:
        refusals.append(1)
        raise DiskFullError("full") if len(refusals) < 3 else StereocalError("no table")

    refusals: list[int] = []
    for _ in range(5):
        with pytest.raises(StereocalError):
            once_or_refused("a test", "of refusals", refuse)
    assert len(refusals) == 3


def test_a_file_is_read_once_for_all_draws_of_a_page() -> None:
    calls = []

    def read(content: bytes, label: str, refuse: bool = False) -> int:
        calls.append(label)
        if refuse:
            raise StereocalError(f"{label} is damaged")
        return len(content)

    for _ in range(3):
        assert read_once(read, b"abc", "a") == 3
        with refused("b is damaged"):
            read_once(read, b"abc", "b", refuse=True)
    assert calls == ["a", "b"]
    assert read_once(read, b"abcd", "a") == 4
    assert read_once(read, b"abc", "c") == 3
