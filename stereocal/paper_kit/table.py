"""The table of a paper: one row per method, as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

from stereocal.calibration.methods import ALL_METHODS
from stereocal.paper_kit.digests import is_number
from stereocal.workflow import Answer

ENDS = ("value", "low", "high")
INTERVAL = "_interval"


def table_csv(answer: Answer) -> bytes:
    """One row per method, one column per figure of `summary.json`; errors are fractions.

    A figure with a 95 % interval has `_low` and `_high` beside it; forecast figures begin with
    `predicted_`. What is unknown is empty. Angles are in the parameter files.
    """
    rows = []
    for method in ALL_METHODS:
        forecast = answer.forecasts.get(method)
        rows.append(
            {
                **_flat(answer.validation.get(method, {})),
                **_flat(forecast.figures if forecast else {}, "predicted_"),
            }
        )
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", *columns])
    for method, row in zip(ALL_METHODS, rows, strict=True):
        if row:
            writer.writerow([method, *(row.get(name) for name in columns)])
    return text.getvalue().encode()


def _flat(figures: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    """Single numbers, and the three of each interval."""
    found: dict[str, float] = {}
    for name, value in figures.items():
        if is_number(value):
            found.setdefault(prefix + name, value)
        elif isinstance(value, Mapping):
            stem = prefix + name.removesuffix(INTERVAL)
            for end in ENDS:
                if is_number(value.get(end)):
                    found[stem if end == "value" else f"{stem}_{end}"] = value[end]
    return found
