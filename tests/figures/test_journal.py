"""Figures for print: SVG and PDF that are valid, complete, undated, and inside their page."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from functools import partial

import pypdfium2
import pytest
from matplotlib.figure import Figure

from stereocal.calibration.methods import Method
from stereocal.figures import journal
from stereocal.workflow import Run
from tests.further import further
from tests.paper_kit.answers import of_field, of_recording

POINTS_PER_MM = 72 / 25.4
Drawn = tuple[Callable[[float], Figure], str]


def validation() -> Drawn:
    found = of_field().evaluation
    assert found is not None
    return partial(journal.draw_validation, found.summaries), "Refined set"


def errors(answer: Callable[[], Run], word: str) -> Drawn:
    return partial(journal.draw_frame_errors, answer().calibration), word


def rig(answer: Callable[[], Run], method: Method, word: str) -> Drawn:
    return partial(journal.draw_rig, answer().calibration, method), word


DRAWN: dict[str, Callable[[], Drawn]] = {
    "validation": validation,
    "errors": partial(errors, of_field, "Length error (%)"),
    "left out": partial(errors, of_recording, "Dotted: left out"),
    "rig": partial(rig, of_recording, "3d", "secondary"),
    "flat rig": partial(rig, of_field, "refined", "From the side"),
}


@pytest.mark.parametrize(
    ("name", "width_mm"),
    [
        ("validation", journal.COLUMN_MM),
        ("rig", journal.COLUMN_MM),
        *further(
            *((name, width) for name in DRAWN for width in (journal.COLUMN_MM, journal.PAGE_MM))
        ),
    ],
)
def test_svg_and_pdf_hold_the_figure_on_their_page(name: str, width_mm: float) -> None:
    draw, word = DRAWN[name]()
    found = journal.rendered(draw, width_mm)
    root = ElementTree.fromstring(found["svg"])
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(width_mm * POINTS_PER_MM)
    assert word in "".join(root.itertext())
    assert b"date" not in found["svg"]
    page = pypdfium2.PdfDocument(found["pdf"])[0]
    assert page.get_width() == pytest.approx(width_mm * POINTS_PER_MM)
    assert word in page.get_textpage().get_text_range()
    assert b"/FontFile2" in found["pdf"]
    assert b"CreationDate" not in found["pdf"]
    width, height = page.get_size()
    text = page.get_textpage()
    for at in range(text.count_chars()):
        left, bottom, right, top = text.get_charbox(at)
        if right > left:
            shown = text.get_text_range(at, 1)
            assert left > -0.5 and bottom > -0.5, shown
            assert right < width + 0.5 and top < height + 0.5, shown


def test_the_figure_says_what_the_page_says() -> None:
    """The figures of the Plotly panels: FCP, interval and threshold of the 2D set."""
    found = of_field()
    assert found.evaluation is not None
    svg = journal.rendered(validation()[0], journal.PAGE_MM)["svg"]
    panels = "".join(ElementTree.fromstring(svg).itertext())
    matching = found.evaluation.summaries["2d"].reprojection
    assert f"FCP {100 * matching.fcp.value:.2g} %" in panels
    assert "Correct pairs" in panels
    assert "Framed: best; level: intervals overlap" in panels
