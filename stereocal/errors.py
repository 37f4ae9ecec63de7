"""The one error that people see: what is wrong, where, and what to do."""

from __future__ import annotations


class StereocalError(ValueError):
    """Input that cannot be used. Its text is one sentence for the person who gave the input."""
