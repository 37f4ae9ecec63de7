"""Settings that all tests share."""

from __future__ import annotations

from hypothesis import settings

# No deadline: a first call may compile. The same examples in every run: a failure is a change.
settings.register_profile("stereocal", deadline=None, derandomize=True)
settings.load_profile("stereocal")
