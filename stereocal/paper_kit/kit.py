"""The paper kit: a zip with methods, references, table, data set and parameter files."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from stereocal.calibration.methods import ALL_METHODS
from stereocal.formats.dataset_files import pack_dataset
from stereocal.matching.application import Outcome
from stereocal.paper_kit.methods_text import methods_md, references_bib
from stereocal.system.zip_files import pack_zip
from stereocal.workflow.answer import PairAnswer

ENDS = ("value", "low", "high")
"""The numbers of an interval in `summary.json`."""
INTERVAL = "_interval"
"""Ends the name of an interval beside a figure that is a number alone."""


def paper_kit(answer: PairAnswer, applied: Outcome | None = None) -> bytes:
    """The kit of a result as a zip.

    Args:
        applied: how points of the project were matched and measured, if they were.
    """
    return pack_zip(
        {
            "methods.md": methods_md(answer, applied).encode(),
            "references.bib": references_bib(),
            "table.csv": table_csv(answer),
            **pack_dataset(answer.run.calibration.dataset),
            **answer.parameter_files,
        }
    )


def table_csv(answer: PairAnswer) -> bytes:
    """One row per method, one column per figure of `summary.json`; errors are fractions.

    A figure with a 95 % interval has `_low` and `_high` beside it; forecast figures begin with
    `predicted_`. What is unknown is empty. Angles are in the parameter files.
    """
    rows = []
    for method in ALL_METHODS:
        forecast = answer.forecast_entries.get(method)
        held_out = _flat(answer.validation.get(method, {}))
        if row := {**held_out, **_flat(forecast.figures if forecast else {}, "predicted_")}:
            rows.append({"method": method, **row})
    columns = list(dict.fromkeys(name for row in rows for name in row)) or ["method"]
    # As objects: a column of whole numbers stays one where some are unknown.
    table = pd.DataFrame(rows, columns=columns, dtype=object)
    return table.to_csv(index=False, lineterminator="\n").encode()


def _flat(figures: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    """The figures of a method as columns: a number `x` as `x`, an interval `x` or `x_interval` as
    `x`, `x_low` and `x_high`; what is unknown is left out.

    Where `x` and `x_interval` are both there, `x` is the interval's value.
    """
    numbers: dict[str, float] = {}
    for name, value in figures.items():
        if _is_number(value):
            numbers.setdefault(prefix + name, value)
        elif isinstance(value, Mapping):
            stem = prefix + name.removesuffix(INTERVAL)
            for end in ENDS:
                if _is_number(value.get(end)):
                    numbers[stem if end == "value" else f"{stem}_{end}"] = value[end]
    return numbers


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
