"""The field sheet: a plan on one page, to take along and to write on."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from io import BytesIO
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from reportlab.lib.colors import grey
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Flowable, KeepInFrame, Paragraph, Table, TableStyle

from stereocal.field.planning import bars
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.paper import FONT, FONT_BOLD, MARGIN_MM, PAPERS, Paper
from stereocal.field.printing.sheet_drawing import draw_from_above
from stereocal.field.printing.sheet_words import RECORDS, camera_notes, measurements
from stereocal.system.numbers import rounded

TEXT = ParagraphStyle("text", fontName=FONT, fontSize=8.5, leading=10.4)
LISTED = ParagraphStyle("listed", parent=TEXT, leftIndent=7, bulletIndent=0, spaceAfter=1.5)
ABOVE = ParagraphStyle("above", parent=TEXT, spaceAfter=4)
HEADING = ParagraphStyle(
    "heading", parent=TEXT, fontName=FONT_BOLD, fontSize=10, leading=12, spaceBefore=5, spaceAfter=2
)
TITLE = ParagraphStyle("title", parent=HEADING, fontSize=14, leading=17)
DRAWING_MM = (84.0, 88.0)
LONGEST_NAME = 60
RECORD_MM = 8.0
"""Height of a row to write in."""
BOX = '<font name="ZapfDingbats">\u274f</font>'
MOST_BOXES = 4


def field_sheet(plan: Plan, paper: Paper = PAPERS["A4"]) -> bytes:
    """The sheet as a PDF of one page; the same plan gives the same bytes."""
    places = bars.bar_places(plan)
    width, height = (side - 2.0 * MARGIN_MM for side in (paper.width_mm, paper.height_mm))
    written = plan.name.encode("cp1252", "replace").decode("cp1252")  # what Helvetica has
    name = written if len(written) <= LONGEST_NAME else f"{written[:LONGEST_NAME]}..."
    title = f"Field sheet: {name}"
    notes = [Paragraph(note, LISTED, bulletText="\u2022") for note in camera_notes(plan)]
    beside = [Paragraph("Cameras, from above (grey: both see it; blue: bars)", HEADING), *notes]
    content: list[Flowable] = [
        Paragraph(escape(title), TITLE),
        _table(
            [[draw_from_above(plan, places, *DRAWING_MM), beside]],
            [DRAWING_MM[0], width - DRAWING_MM[0]],
            lines=False,
        ),
        Paragraph(f"Bar: {plan.frames} frames of a bar of {rounded(plan.bar_m, 4)} m", HEADING),
        Paragraph(
            "Tick a box for each frame. Distances are from the point midway between the cameras, "
            "heights from the lens of the primary. Leave out places below the ground or out of "
            "reach, and take others near them. Both targets face the cameras and are in view.",
            ABOVE,
        ),
        _checklist(plan, places, width),
        Paragraph("Measure", HEADING),
        _table(
            [[_text(cell) for cell in row] for row in measurements(plan)],
            [38.0, width - 78.0, 40.0],
        ),
        Paragraph("Write down", HEADING),
        _table(
            [[_text(cell) for cell in row] for row in RECORDS],
            [41.0, 0.5 * width - 41.0] * 2,
            height_mm=RECORD_MM,
        ),
    ]
    file = BytesIO()
    canvas = Canvas(file, (paper.width_mm * mm, paper.height_mm * mm), invariant=1)
    canvas.setTitle(title)
    page = KeepInFrame(width * mm, height * mm, content, mode="shrink")
    _, used = page.wrapOn(canvas, width * mm, height * mm)
    page.drawOn(canvas, MARGIN_MM * mm, (paper.height_mm - MARGIN_MM) * mm - used)
    canvas.showPage()
    canvas.save()
    return file.getvalue()


def _checklist(plan: Plan, places: Sequence[bars.BarPlace], width_mm: float) -> Table:
    """Rows from near to far, columns from left to right, and a box for each frame."""
    head = 30.0
    rows: list[list[Paragraph]] = [[_text(""), *(_text(f"<b>{word}</b>") for word in bars.ACROSS)]]
    # Positions are to about a thousandth of the farthest.
    digits = int(np.clip(np.ceil(2.0 - np.log10(plan.far_m)), 0, 4))
    lens = bars.ground_from_primary(plan).T[1]
    for distance in bars.DISTANCES:
        here = [place for place in places if place.distance == distance]
        if not here:
            continue
        lines = [f"<b>{distance}</b>"]
        for height in reversed(bars.HEIGHTS):
            up = [lens - one.position_m[1] for one in here if one.height == height]
            if up:
                lines.append(f"{height}: {round(float(np.mean(up)), digits) + 0.0:+.{digits}f} m")
        cells = [[one for one in here if one.across == word] for word in bars.ACROSS]
        texts = ["<br/>".join(lines), *(_boxes(cell, digits) for cell in cells)]
        rows.append([_text(words) for words in texts])
    return _table(rows, [head, *[(width_mm - head) / 3.0] * 3])


def _boxes(places: Sequence[bars.BarPlace], digits: int) -> str:
    """Where a place is, and its frames."""
    if not places:
        return "-"
    right, _, ahead = np.mean([one.position_m for one in places], axis=0)
    side = "right" if right > 0 else "left"
    lines = [f"{abs(right):.{digits}f} m {side}, {ahead:.{digits}f} m ahead"]
    for height, group in itertools.groupby(reversed(places), key=lambda one: one.height):
        directions = [one.direction for one in group]
        boxes = BOX * len(directions) if len(directions) <= MOST_BOXES else f"{len(directions)} x "
        ways = list(dict.fromkeys(directions))
        named = ", ".join(ways) if len(ways) <= 2 else "different directions"
        lines.append(f"{boxes} {height}: {named}")
    return "<br/>".join(lines)


def _text(words: str) -> Paragraph:
    return Paragraph(words, TEXT)


def _table(
    rows: Sequence[list[Any]],
    widths_mm: Sequence[float],
    lines: bool = True,
    height_mm: float | None = None,
) -> Table:
    style = TableStyle([("VALIGN", (0, 0), (-1, -1), "TOP")])
    for side, padding in {"TOP": 1.5, "BOTTOM": 1.5, "LEFT": 3.0, "RIGHT": 3.0}.items():
        style.add(f"{side}PADDING", (0, 0), (-1, -1), padding if lines else 0.0)
    if lines:
        style.add("GRID", (0, 0), (-1, -1), 0.3, grey)
    heights = None if height_mm is None else [height_mm * mm] * len(rows)
    widths = [width * mm for width in widths_mm]
    return Table(rows, widths, heights, style=style, hAlign="LEFT")
