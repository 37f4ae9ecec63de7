"""What a matching or a measuring found, in numbers and in words."""

from dataclasses import dataclass, field

from stereocal.matching.names import NO_NAMES, Names


@dataclass(frozen=True)
class Report:
    """The result of matching tables of points, or of measuring what belongs together."""

    found: int
    """Rows of the table that was written: pairs, tracks of several cameras, or 3D points."""
    sentences: list[str]
    notes: list[str] = field(default_factory=list)
    """Warnings, a sentence each."""
    lost: int = 0
    """Rows that do not meet in front of the cameras; their coordinates are empty."""
    threshold_px: float = 0.0
    """With which two cameras were matched; 0 of more, where the noise of the points decides."""
    names: Names = NO_NAMES
    """Those by which points were matched."""
