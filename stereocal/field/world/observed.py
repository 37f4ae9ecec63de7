"""What was observed to find the world frame: surveyed points, lines, a thrown object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray, IntArray

LineKind = Literal["plumb", "level", "horizon"]
KINDS: tuple[LineKind, ...] = ("plumb", "level", "horizon")
Source = Literal["survey", "plumb", "level", "throw"]
SOURCES: tuple[Source, ...] = ("survey", "plumb", "level", "throw")


@dataclass(frozen=True, eq=False)
class Survey:
    """Points with surveyed coordinates, n rows; several rows may be of one point."""

    names: tuple[str, ...]
    """(n,)."""
    world_m: FloatArray
    """(n, 3): surveyed coordinates."""
    pixels: FloatArray
    """(n, 4): raw pixels u, v in the primary and in the secondary; NaN if `measured_m` is given."""
    measured_m: FloatArray
    """(n, 3): already reconstructed, in the primary's frame; NaN if `pixels` is given."""


@dataclass(frozen=True, eq=False)
class Line:
    """Points along a straight line; those of the two images need not be the same points."""

    name: str
    kind: LineKind
    pixels: tuple[FloatArray, FloatArray]
    """(m, 2) raw pixels in the primary, (k, 2) in the secondary; m or k may be 0."""


@dataclass(frozen=True, eq=False)
class Throw:
    """Images of objects in free flight, n rows, with a time for each frame."""

    tracks: tuple[str, ...]
    """(n,): names of the throws; all are of the same object."""
    frames: IntArray
    """(n,)."""
    pixels: FloatArray
    """(n, 4): raw pixels u, v in the primary and in the secondary."""
    frame_rate: float
    """Frames per second."""

    def __post_init__(self) -> None:
        if not 0.1 <= self.frame_rate <= 1e6:
            raise StereocalError(
                f"The frame rate is {self.frame_rate:g} frames per second; it must be from 0.1 to "
                "1,000,000."
            )


Observed = Survey | Sequence[Line] | Throw
