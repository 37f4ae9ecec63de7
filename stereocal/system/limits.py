"""How much is read of what strangers give; each limit holds before anything is decoded.

Limits.from_environment().check_size(path.stat().st_size, path.name)
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from stereocal.errors import StereocalError
from stereocal.system.environment import number_given

MB = 1e6
FREE_SWELLING = 10_000_000
"""Bytes that may swell any much: a black photograph, a table of equal numbers."""


@dataclass(frozen=True)
class Limits:
    """The limits of this computer. Each field is set by a variable, `VARIABLES`; inf is none."""

    files: float = 20_000
    """Files of one upload, or in one zip: 10,000 pairs of photographs."""
    file_mb: float = 1_000
    """One file, packed or not."""
    unpacked_mb: float = 20_000
    """All files of one zip or upload together: 2000 pairs of photographs of 5 MB."""
    ratio: float = 200
    """A table of numbers packs to a fifth; a zip that swells two hundredfold is a trap."""
    megapixels: float = 200
    """One photograph."""
    pairs: float = 1_000_000
    """Rows of a table to calibrate with, which is held in memory: 0.6 kB a row."""
    rows: float = 20_000_000
    """Rows of a table of points to match or to measure, of which blocks are held."""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> Limits:
        """The limits that are set; what is not given keeps its default.

        Raises:
            StereocalError: a value that is no number, or below 1.
        """
        given = os.environ if environment is None else environment
        return cls(**{
            name: number_given(given, variable, getattr(cls, name), least=1.0)
            for name, variable in VARIABLES.items()
        })  # fmt: skip

    def check_count(self, count: int, source: str) -> None:
        """Refuse too many files at once."""
        if count > self.files:
            raise self._refusal("files", f"{source}: {count} files at once are too many", "")

    def check_size(self, size: int, source: str) -> None:
        """Refuse a file of so many bytes."""
        if size > self.file_mb * MB:
            raise self._refusal("file_mb", f"{source}: the file has {_mb(size)}", " MB")

    def check_together(self, size: int, source: str) -> None:
        """Refuse files of so many bytes together."""
        if size > self.unpacked_mb * MB:
            raise self._refusal("unpacked_mb", f"{source}: {_mb(size)} together", " MB")

    def check_swelling(self, packed: int, unpacked: int, source: str) -> None:
        """Refuse a zip that would become so much larger."""
        if unpacked > self.ratio * packed + FREE_SWELLING:
            said = (
                f"{source}: {packed} bytes would swell to {unpacked}, "
                f"{unpacked / max(packed, 1):.0f} times as much; it is not unpacked"
            )
            raise self._refusal("ratio", said, " times")

    def check_pixels(self, width: int, height: int, source: str) -> None:
        """Refuse a photograph that says it is so large."""
        if width * height > self.megapixels * MB:
            said = (
                f"{source}: it says that it is {width}x{height} px large, "
                f"{width * height / MB:.4g} megapixels"
            )
            raise self._refusal("megapixels", said, " megapixels")

    def check_pairs(self, rows: int, source: str) -> None:
        """Refuse a table to calibrate with of so many rows."""
        if rows > self.pairs:
            raise self._refusal("pairs", f"{source}: the table has more rows", "")

    def check_rows(self, rows: int, source: str) -> None:
        """Refuse a table of points of so many rows."""
        if rows > self.rows:
            raise self._refusal("rows", f"{source}: the table has {rows} rows or more", "")

    def _refusal(self, field: str, said: str, unit: str) -> StereocalError:
        most = getattr(self, field)
        return StereocalError(
            f"{said}; at most {most:.10g}{unit} are read (setting {VARIABLES[field]})."
        )


VARIABLES: Mapping[str, str] = {
    "files": "STEREOCAL_MOST_FILES",
    "file_mb": "STEREOCAL_MOST_FILE_MB",
    "unpacked_mb": "STEREOCAL_MOST_UNPACKED_MB",
    "ratio": "STEREOCAL_MOST_RATIO",
    "megapixels": "STEREOCAL_MOST_MEGAPIXELS",
    "pairs": "STEREOCAL_MOST_PAIRS",
    "rows": "STEREOCAL_MOST_ROWS",
}


def _mb(size: int) -> str:
    return f"{size / MB:.1f} MB"
