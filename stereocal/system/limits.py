"""Limits on untrusted files, checked before anything is decoded.

Limits.from_environment().check_size(path.stat().st_size, path.name)
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar, cast

from stereocal.errors import StereocalError
from stereocal.system.numbers import rounded

T = TypeVar("T")
MB = 1e6
PREFIX = "STEREOCAL_MOST_"
UNITS = {"file_mb": " MB", "unpacked_mb": " MB", "ratio": " times", "megapixels": " megapixels"}
FREE_EXPANSION = 10_000_000
"""Unpacked bytes that are allowed at any ratio, for example for a black photograph."""


def from_environment(
    kind: type[T], prefix: str, environment: Mapping[str, str] | None, least: float = 0.0
) -> T:
    """A dataclass of numbers, each from its variable; where that is not set, its default.

    Args:
        prefix: of the variables, which end with the names of the fields.
        environment: None: that of the process.
    """
    given = os.environ if environment is None else environment
    stated = {}
    for name in (limit.name for limit in fields(cast(Any, kind))):
        variable = prefix + name.upper()
        if not (text := given.get(variable, "").strip()):
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not value >= least:
            raise StereocalError(
                f'{variable} is "{text[:40]}": it must be a number, {least:g} or above.'
            )
        stated[name] = value
    return kind(**stated)


@dataclass(frozen=True)
class Limits:
    """The limits, each set by an environment variable (docs/deploy.md lists them); inf means
    unlimited. Each `check_*` raises a `StereocalError`; sizes are in bytes."""

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
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> "Limits":
        """The limits from the environment, with defaults."""
        return from_environment(cls, PREFIX, environment, least=1.0)

    def check_count(self, count: int, source: str) -> None:
        self._check("files", count, source, f"{count} files at once are too many")

    def check_size(self, size: int, source: str) -> None:
        self._check("file_mb", size / MB, source, f"the file has {size / MB:.1f} MB")

    def check_together(self, size: int, source: str) -> None:
        self._check("unpacked_mb", size / MB, source, f"{size / MB:.1f} MB together")

    def check_expansion(self, packed: int, unpacked: int, source: str) -> None:
        times = f"{packed} bytes would expand to {unpacked}, {unpacked / max(packed, 1):.0f} times"
        beyond = (unpacked - FREE_EXPANSION) / max(packed, 1)
        self._check("ratio", beyond, source, f"{times} as much; it was not unpacked")

    def check_pixels(self, width: int, height: int, source: str) -> None:
        megapixels = width * height / MB
        size = f"the image has {width}x{height} px, {rounded(megapixels, 4)} megapixels"
        self._check("megapixels", megapixels, source, size)

    def check_pairs(self, rows: int, source: str) -> None:
        self._check("pairs", rows, source, "the table has more rows")

    def check_rows(self, rows: int, source: str) -> None:
        self._check("rows", rows, source, f"the table has {rows} rows or more")

    def _check(self, field: str, value: float, source: str, message: str) -> None:
        if value > (limit := getattr(self, field)):
            most = f"at most {limit:.10g}{UNITS.get(field, '')} are read"
            raise StereocalError(f"{message}; {most} (setting {PREFIX}{field.upper()}).", source)
