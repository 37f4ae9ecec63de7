"""What is printed at true scale: one sheet of paper, drawn in millimetres, as PDF or as SVG.

Each sheet carries a ruler of 100 mm: printers that "fit to page" scale by some per cent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

from reportlab.graphics import renderPDF, renderSVG
from reportlab.graphics.shapes import Drawing, Group, Line, Rect, String
from reportlab.lib.colors import black
from reportlab.lib.units import mm
from reportlab.lib.utils import simpleSplit
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfgen.canvas import Canvas

from stereocal.errors import StereocalError

FONT, FONT_BOLD = "Helvetica", "Helvetica-Bold"
SVG_FONTS = {
    FONT: {"family": "Helvetica, Arial, sans-serif"},
    FONT_BOLD: {"family": "Helvetica, Arial, sans-serif", "weight": "bold"},
}
"""In an SVG the weight is no part of a font's name."""
MARGIN_MM = 7.0
"""White edge: most printers leave 3 to 6 mm blank."""
RULER_MM = 100.0
TEXT_MM, LINE_MM = 3.2, 4.0
"""Height of the letters, and of a line."""
RULER_HEIGHT_MM = 7.0
BESIDE_MM = RULER_MM + 18.0
"""Where the text begins on wide paper: to the right of the ruler, not above it."""
WIDE_MM = 280.0
ACTUAL_SIZE = (
    'Print at 100 % ("actual size", not "fit to page"), and check with a steel ruler: the scale '
    "printed here is 100.0 mm long"
)


@dataclass(frozen=True)
class Paper:
    """A paper format, lying on its long side or standing."""

    name: str
    width_mm: float
    height_mm: float

    @property
    def both_ways(self) -> "tuple[Paper, Paper]":
        """Standing and lying."""
        return self, Paper(self.name, self.height_mm, self.width_mm)


PAPERS = {
    name: Paper(name, *sides)
    for name, sides in {
        "A4": (210.0, 297.0),
        "A3": (297.0, 420.0),
        "A2": (420.0, 594.0),
        "A1": (594.0, 841.0),
        "A0": (841.0, 1189.0),
        "Letter": (215.9, 279.4),
        "Tabloid": (279.4, 431.8),
    }.items()
}
"""All but A4, A3, Letter and Tabloid are for the plotter of a copy shop."""


def paper_named(name: str) -> Paper:
    """The paper format of a name."""
    for known, paper in PAPERS.items():
        if known.lower() == name.strip().lower():
            return paper
    raise StereocalError(f'The paper "{name}" is not known: use one of {", ".join(PAPERS)}.')


@dataclass(frozen=True, eq=False)
class Sheet:
    """One sheet of paper with its drawing, in mm from the lower left corner."""

    title: str
    paper: Paper
    shapes: Group

    def pdf(self) -> bytes:
        """The sheet as a PDF of one page; the same sheet gives the same bytes."""
        file = BytesIO()
        canvas = Canvas(file, (self.paper.width_mm * mm, self.paper.height_mm * mm), invariant=1)
        canvas.setTitle(self.title)
        renderPDF.draw(self._drawing(), canvas, 0, 0)
        canvas.showPage()
        canvas.save()
        return file.getvalue()

    def svg(self) -> str:
        """The sheet as SVG whose width and height are given in mm."""
        width, height = self.paper.width_mm, self.paper.height_mm
        # ReportLab rounds the box of the view to whole points, which is 0.05 % of A4.
        size = {
            "width": f"{width:g}mm",
            "height": f"{height:g}mm",
            "viewBox": f"0 0 {width * mm:.6f} {height * mm:.6f}",
        }
        return str(renderSVG.drawToString(self._drawing(), svgAttrs=size, fontHacks=SVG_FONTS))

    def _drawing(self) -> Drawing:
        drawing = Drawing(self.paper.width_mm * mm, self.paper.height_mm * mm)
        drawing.add(Group(self.shapes, transform=(mm, 0, 0, mm, 0, 0)))
        return drawing


def block(left: float, bottom: float, width: float, height: float) -> Rect:
    """A black rectangle without an outline, which would make it larger."""
    rectangle = Rect(left, bottom, width, height)
    rectangle.fillColor, rectangle.strokeColor = black, None
    return rectangle


def stroke(x1: float, y1: float, x2: float, y2: float) -> Line:
    """A line of exact length (butt caps)."""
    return Line(x1, y1, x2, y2, strokeColor=black, strokeWidth=0.2, strokeLineCap=0)


def footer_height(texts: Sequence[str], width_mm: float) -> float:
    """Height of `footer` above the lower edge of the paper."""
    lines = LINE_MM * len(_lines(texts, width_mm))
    if width_mm >= WIDE_MM:
        return MARGIN_MM + max(RULER_HEIGHT_MM, lines)
    return MARGIN_MM + RULER_HEIGHT_MM + 1.0 + lines


def footer(texts: Sequence[str], width_mm: float) -> Group:
    """The ruler, and above it or, on paper that is wide, beside it the texts, the first in bold."""
    # 100 mm with a tick each 10 mm: the outer ticks' centre lines are exactly 100 mm apart.
    up = MARGIN_MM + RULER_HEIGHT_MM - 1.5
    shapes = Group(stroke(MARGIN_MM, up, MARGIN_MM + RULER_MM, up))
    for x in range(0, int(RULER_MM) + 1, 10):
        length = 4.0 if x % 50 == 0 else 2.0
        shapes.add(stroke(MARGIN_MM + x, up - length, MARGIN_MM + x, up))
    for x, label in ((0, "0"), (50, "50"), (100, "100 mm")):
        shapes.add(text(MARGIN_MM + x + 1.0, MARGIN_MM, label, size=2.6))
    left = MARGIN_MM + (BESIDE_MM if width_mm >= WIDE_MM else 0.0)
    top = footer_height(texts, width_mm)
    for row, (line, font) in enumerate(_lines(texts, width_mm)):
        shapes.add(text(left, top - (row + 0.8) * LINE_MM, line, font))
    return shapes


def text(left: float, base: float, line: str, font: str = FONT, size: float = TEXT_MM) -> String:
    """One line of text, as wide in an SVG as in a PDF, whatever font the viewer has."""
    shape = String(left, base, line, fontName=font, fontSize=size, fillColor=black)
    width = f"{stringWidth(line, font, size):.4f}"
    shape._svgAttrs = {"textLength": width, "lengthAdjust": "spacingAndGlyphs"}  # type: ignore[attr-defined]
    return shape


def _lines(texts: Sequence[str], width_mm: float) -> list[tuple[str, str]]:
    """Lines that fit between the margins, with the font of each."""
    room = width_mm - 2.0 * MARGIN_MM - (BESIDE_MM if width_mm >= WIDE_MM else 0.0)
    return [
        (line, FONT if row else FONT_BOLD)
        for row, content in enumerate(texts)
        for line in simpleSplit(content, FONT if row else FONT_BOLD, TEXT_MM, room)
    ]
