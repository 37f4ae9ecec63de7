"""The paper kit: a zip with methods, references, figures, table, and an archive to rerun."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from stereocal.calibration.methods import METHODS
from stereocal.figures import journal
from stereocal.matching.application import Outcome
from stereocal.paper_kit.methods_text import captions_md, methods_md
from stereocal.paper_kit.references import references_bib
from stereocal.paper_kit.reproduction import ARCHIVE, archive_files
from stereocal.paper_kit.table import table_csv
from stereocal.system.zip_files import pack_zip
from stereocal.workflow import Answer

WIDTHS = (journal.COLUMN_MM, journal.PAGE_MM)


def paper_kit(answer: Answer, applied: Outcome | None = None) -> bytes:
    """The kit of a result as a zip.

    Args:
        applied: how points of the project were matched and measured, if they were.
    """
    drawn = {
        f"figures/{name}_{width:.0f}mm.{form}": content
        for name, draw in _figures(answer)
        for width in WIDTHS
        for form, content in journal.rendered(draw, width).items()
    }
    return pack_zip(
        {
            "methods.md": f"{methods_md(answer, applied)}\n{captions_md(answer)}".encode(),
            "references.bib": references_bib(),
            **drawn,
            "table.csv": table_csv(answer),
            ARCHIVE: pack_zip(archive_files(answer, answer.sets)),
        }
    )


def _figures(answer: Answer) -> Iterator[tuple[str, journal.Draw]]:
    calibration, evaluation = answer.calibration, answer.evaluation
    if evaluation is not None:
        summaries = evaluation.summaries
        papers = {method: summaries[method] for method in METHODS}
        yield "validation", partial(journal.draw_validation, papers)
        if len(summaries) > len(papers):
            yield "validation_with_refined", partial(journal.draw_validation, summaries)
    yield "errors_by_frame", partial(journal.draw_frame_errors, calibration)
    yield "rig", partial(journal.draw_rig, calibration, answer.recommendation.measure.method)
