"""Limits on untrusted files, checked before anything is decoded.

Limits.from_environment().check_size(path.stat().st_size, path.name)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stereocal.errors import StereocalError
from stereocal.system.environment import from_environment
from stereocal.system.numbers import rounded

MB = 1e6
FREE_EXPANSION = 10_000_000
"""Unpacked bytes that are allowed at any ratio, for example for a black photograph."""


@dataclass(frozen=True)
class Limits:
    """The limits, each set by an environment variable (`VARIABLES`); inf means unlimited."""

    files: float = 20_000
    """Files of one upload, or in one zip: 10,000 pairs of photographs."""
    file_mb: float = 1_000
    """One file, packed or not."""
    unpacked_mb: float = 20_000
    """All files of one zip or upload together: 2000 pairs of photographs of 5 MB."""
    ratio: float = 200
    """Unpacked to packed size; a table of numbers has about 5, a zip bomb far more."""
    megapixels: float = 200
    """One photograph."""
    pairs: float = 1_000_000
    """Rows of a calibration table, which is read into memory: 0.6 kB a row."""
    rows: float = 20_000_000
    """Rows of a table of points to match or measure, which is read in blocks."""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> Limits:
        """The limits from the environment, with defaults."""
        return from_environment(cls, VARIABLES, environment, least=1.0)

    def check_count(self, count: int, source: str) -> None:
        """Raise a `StereocalError` for too many files at once."""
        self._check("files", count, source, f"{count} files at once are too many")

    def check_size(self, size: int, source: str) -> None:
        """Raise a `StereocalError` for too large a file, in bytes."""
        self._check("file_mb", size / MB, source, f"the file has {size / MB:.1f} MB")

    def check_together(self, size: int, source: str) -> None:
        """Raise a `StereocalError` for too large a sum of files, in bytes."""
        self._check("unpacked_mb", size / MB, source, f"{size / MB:.1f} MB together")

    def check_expansion(self, packed: int, unpacked: int, source: str) -> None:
        """Raise a `StereocalError` for a zip bomb; sizes in bytes."""
        times = f"{packed} bytes would expand to {unpacked}, {unpacked / max(packed, 1):.0f} times"
        beyond = (unpacked - FREE_EXPANSION) / max(packed, 1)
        self._check("ratio", beyond, source, f"{times} as much; it was not unpacked")

    def check_pixels(self, width: int, height: int, source: str) -> None:
        """Raise a `StereocalError` for too large a photograph, by its header."""
        megapixels = width * height / MB
        shown = f"the image has {width}x{height} px, {rounded(megapixels, 4)} megapixels"
        self._check("megapixels", megapixels, source, shown)

    def check_pairs(self, rows: int, source: str) -> None:
        """Raise a `StereocalError` for too many rows of a calibration table."""
        self._check("pairs", rows, source, "the table has more rows")

    def check_rows(self, rows: int, source: str) -> None:
        """Raise a `StereocalError` for too many rows of a table of points."""
        self._check("rows", rows, source, f"the table has {rows} rows or more")

    def _check(self, field: str, value: float, source: str, message: str) -> None:
        if value > (limit := getattr(self, field)):
            most = f"at most {limit:.10g}{UNITS.get(field, '')} are read"
            raise StereocalError(f"{message}; {most} (setting {VARIABLES[field]}).", source)


UNITS = {"file_mb": " MB", "unpacked_mb": " MB", "ratio": " times", "megapixels": " megapixels"}
VARIABLES: Mapping[str, str] = {
    "files": "STEREOCAL_MOST_FILES",
    "file_mb": "STEREOCAL_MOST_FILE_MB",
    "unpacked_mb": "STEREOCAL_MOST_UNPACKED_MB",
    "ratio": "STEREOCAL_MOST_RATIO",
    "megapixels": "STEREOCAL_MOST_MEGAPIXELS",
    "pairs": "STEREOCAL_MOST_PAIRS",
    "rows": "STEREOCAL_MOST_ROWS",
}
