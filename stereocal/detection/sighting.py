"""The two targets of a photograph where each has its own name: balls and tags."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Spot:
    """The centre of a target in raw pixels."""

    u: float
    v: float
    sigma_px: float
    """Standard error of one coordinate."""
    radius_px: float
    """Of a ball; half the side of a tag."""
    doubts: tuple[str, ...] = ()
    """What the user should check, as messages."""
    score: float = 1.0
    """How much it looks like the target, 0 to 1."""


@dataclass(frozen=True)
class Sighting:
    """The result for one photograph."""

    spots: tuple[Spot | None, Spot | None]
    """Targets A and B."""
    missing: str
    """Why a target is missing; empty if both are there."""
    unreadable: bool = False
    """The photograph could not be read."""
    candidates: tuple[tuple[Spot, ...], ...] = ()
    """All that may be the target, best first: for A and B, or once for balls of one colour."""
