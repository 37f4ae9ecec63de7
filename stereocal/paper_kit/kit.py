"""The paper kit: a zip with methods, references, figures, table, and an archive to rerun."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from stereocal.calibration.methods import ALL_METHODS, METHODS
from stereocal.figures import journal
from stereocal.matching.application import Outcome
from stereocal.paper_kit.digests import is_number
from stereocal.paper_kit.methods_text import captions_md, methods_md, references_bib
from stereocal.paper_kit.reproduction import ARCHIVE, archive_files
from stereocal.system.zip_files import pack_zip
from stereocal.workflow import Run

ENDS = ("value", "low", "high")
INTERVAL = "_interval"
WIDTHS = (journal.COLUMN_MM, journal.PAGE_MM)


def paper_kit(run: Run, applied: Outcome | None = None) -> bytes:
    """The kit of a result as a zip.

    Args:
        applied: how points of the project were matched and measured, if they were.
    """
    drawn = {
        f"figures/{name}_{width:.0f}mm.{form}": content
        for name, draw in _figures(run)
        for width in WIDTHS
        for form, content in journal.rendered(draw, width).items()
    }
    return pack_zip(
        {
            "methods.md": f"{methods_md(run, applied)}\n{captions_md(run)}".encode(),
            "references.bib": references_bib(),
            **drawn,
            "table.csv": table_csv(run),
            ARCHIVE: pack_zip(archive_files(run)),
        }
    )


def _figures(run: Run) -> Iterator[tuple[str, journal.Draw]]:
    calibration, evaluation = run.calibration, run.evaluation
    if evaluation is not None:
        summaries = evaluation.summaries
        papers = {method: summaries[method] for method in METHODS}
        yield "validation", partial(journal.draw_validation, papers)
        if len(summaries) > len(papers):
            yield "validation_with_refined", partial(journal.draw_validation, summaries)
    yield "errors_by_frame", partial(journal.draw_frame_errors, calibration)
    yield "rig", partial(journal.draw_rig, calibration, run.recommendation.measure.method)


def table_csv(run: Run) -> bytes:
    """One row per method, one column per figure of `summary.json`; errors are fractions.

    A figure with a 95 % interval has `_low` and `_high` beside it; forecast figures begin with
    `predicted_`. What is unknown is empty. Angles are in the parameter files.
    """
    rows = []
    for method in ALL_METHODS:
        forecast = run.forecast_entries.get(method)
        held_out = _flat(run.validation.get(method, {}))
        if row := {**held_out, **_flat(forecast.figures if forecast else {}, "predicted_")}:
            rows.append({"method": method, **row})
    columns = list(dict.fromkeys(name for row in rows for name in row)) or ["method"]
    # As objects: a column of whole numbers stays one where some are unknown.
    table = pd.DataFrame(rows, columns=columns, dtype=object)
    return table.to_csv(index=False, lineterminator="\n").encode()


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
