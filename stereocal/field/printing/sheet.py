"""The field sheet: a plan on one page, to take along and to write on."""

import itertools
from collections.abc import Sequence
from io import BytesIO
from typing import Any, Literal
from xml.sax.saxutils import escape

import cv2
import numpy as np
from reportlab.graphics.shapes import Drawing, Group, Line, Polygon, String
from reportlab.lib.colors import Color, black, grey, lightgrey, white
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Flowable, KeepInFrame, Paragraph, Table, TableStyle

from stereocal.field.planning import bars
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.paper import FONT, FONT_BOLD, MARGIN_MM, PAPERS, Paper
from stereocal.field.printing.sheet_words import RECORDS, camera_notes, measurements
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

TEXT = ParagraphStyle("text", fontName=FONT, fontSize=8.5, leading=10.4)
LISTED = ParagraphStyle("listed", parent=TEXT, leftIndent=7, bulletIndent=0, spaceAfter=1.5)
ABOVE = ParagraphStyle("above", parent=TEXT, spaceAfter=4)
HEADING = ParagraphStyle(
    "heading", parent=TEXT, fontName=FONT_BOLD, fontSize=10, leading=12, spaceBefore=5, spaceAfter=2
)
TITLE = ParagraphStyle("title", parent=HEADING, fontSize=14, leading=17)
BORDER_MM, LABEL_MM = 6.0, 2.6
CAMERA_MM = 4.0
"""Length of the symbol of a camera."""
NARROW_MM = 9.0
"""The least distance of the cameras' symbols with a label between them."""
COMMON_COLOUR = Color(0.91, 0.91, 0.91)
BAR_COLOUR = Color(0.0, 0.45, 0.70)
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
            [[_draw_from_above(plan, places, *DRAWING_MM), beside]],
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
        _table(measurements(plan), [38.0, width - 78.0, 40.0]),
        Paragraph("Write down", HEADING),
        _table(RECORDS, [41.0, 0.5 * width - 41.0] * 2, height_mm=RECORD_MM),
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
    rows = [["", *(f"<b>{word}</b>" for word in bars.ACROSS)]]
    # Positions are to about a thousandth of the farthest.
    digits = int(np.clip(np.ceil(2.0 - np.log10(plan.far_m)), 0, 4))
    lens = bars.ground_from_primary(plan).T[1]
    for distance in bars.DISTANCES:
        here = [place for place in places if place.distance == distance]
        if not here:
            continue
        lines = [f"<b>{distance}</b>"]
        for height in reversed(bars.HEIGHTS):
            up = [lens - place.position_m[1] for place in here if place.height == height]
            if up:
                lines.append(f"{height}: {round(float(np.mean(up)), digits) + 0.0:+.{digits}f} m")
        cells = [[place for place in here if place.across == word] for word in bars.ACROSS]
        rows.append(["<br/>".join(lines), *(_boxes(cell, digits) for cell in cells)])
    return _table(rows, [head, *[(width_mm - head) / 3.0] * 3])


def _boxes(places: Sequence[bars.BarPlace], digits: int) -> str:
    """Where a place is, and its frames."""
    if not places:
        return "-"
    right, _, ahead = np.mean([place.position_m for place in places], axis=0)
    side = "right" if right > 0 else "left"
    lines = [f"{abs(right):.{digits}f} m {side}, {ahead:.{digits}f} m ahead"]
    for height, group in itertools.groupby(reversed(places), key=lambda place: place.height):
        directions = [place.direction for place in group]
        boxes = BOX * len(directions) if len(directions) <= MOST_BOXES else f"{len(directions)} x "
        ways = list(dict.fromkeys(directions))
        named = ", ".join(ways) if len(ways) <= 2 else "different directions"
        lines.append(f"{boxes} {height}: {named}")
    return "<br/>".join(lines)


def _table(
    rows: Sequence[Sequence[Any]],
    widths_mm: Sequence[float],
    lines: bool = True,
    height_mm: float | None = None,
) -> Table:
    cells = [
        [Paragraph(cell, TEXT) if isinstance(cell, str) else cell for cell in row] for row in rows
    ]
    style = TableStyle([("VALIGN", (0, 0), (-1, -1), "TOP")])
    for side, padding in {"TOP": 1.5, "BOTTOM": 1.5, "LEFT": 3.0, "RIGHT": 3.0}.items():
        style.add(f"{side}PADDING", (0, 0), (-1, -1), padding if lines else 0.0)
    if lines:
        style.add("GRID", (0, 0), (-1, -1), 0.3, grey)
    heights = None if height_mm is None else [height_mm * mm] * len(rows)
    widths = [width * mm for width in widths_mm]
    return Table(cells, widths, heights, style=style, hAlign="LEFT")


def _draw_from_above(
    plan: Plan, places: Sequence[bars.BarPlace], width_mm: float, height_mm: float
) -> Drawing:
    """Cameras below, far end above, all at one scale; each bar as it lies, seen from above."""
    ground = bars.ground_from_primary(plan)
    cameras = ground.apply(np.vstack([np.zeros(3), plan.pose.inverse().T]))[:, [0, 2]]
    axes = np.vstack([ground.R[:, 2], ground.R @ plan.pose.R[2]])[:, [0, 2]]
    common = ground.apply(plan.common_points)[:, [0, 2]]
    lowest, highest = (end(np.vstack([cameras, common]), axis=0) for end in (np.min, np.max))
    room = np.array([width_mm - 3 * BORDER_MM, height_mm - 2 * BORDER_MM])
    scale = float(np.min(room / np.maximum(highest - lowest, 1e-9)))
    centre = 0.5 * np.array([width_mm - BORDER_MM, height_mm + 0.5 * BORDER_MM])

    def to_mm(points_m: FloatArray) -> FloatArray:
        """Millimetres on the paper of metres (right, ahead), with one scale for both axes."""
        return np.asarray(centre + scale * (points_m - 0.5 * (lowest + highest)))

    hull = cv2.convexHull(common.astype(np.float32))[:, 0].astype(np.float64)
    shapes = Group(_outline(to_mm(hull), COMMON_COLOUR))
    for camera, axis in zip(cameras, axes, strict=True):
        far = max(float(((common - camera) @ axis).max()), 0.0)  # end of the common view
        ahead = camera + far * axis
        line = _line(to_mm(camera), to_mm(ahead), grey, 0.15)
        line.strokeDashArray = [2.0, 1.0]
        shapes.add(line)
    for place in places:
        ends = to_mm(ground.apply(place.ends_m)[:, [0, 2]])
        if np.linalg.norm(ends[1] - ends[0]) < 1.0:  # upright, or small at this scale
            ends = ends.mean(axis=0) + np.array([[-0.5, 0.0], [0.5, 0.0]])
        shapes.add(_line(ends[0], ends[1], BAR_COLOUR, 0.7))
    _draw_cameras(shapes, to_mm(cameras), axes, f"{rounded(plan.baseline_m, 4)} m")
    depths = plan.common_points[:, 2]
    for depth in (depths.min(), depths.max()):
        points = common[depths == depth]
        place_mm = np.add(to_mm(points[points[:, 0].argmax()]), (1.5, -0.8))
        shapes.add(_note_at(place_mm, f"{rounded(depth, 3)} m", "start"))
    drawing = Drawing(width_mm * mm, height_mm * mm)
    drawing.add(Group(shapes, transform=(mm, 0, 0, mm, 0, 0)))
    return drawing


def _draw_cameras(shapes: Group, places: FloatArray, axes: FloatArray, baseline: str) -> None:
    """Both cameras, the line between them, and its length; beside them if they are too close.

    A camera is a triangle that opens in the direction in which it looks.
    """
    first, second = places
    shapes.add(_line(first, second, black, 0.2))
    for place, axis in zip(places, axes, strict=True):
        length = float(np.linalg.norm(axis))
        ahead = axis / length if length > 1e-6 else np.array([0.0, 1.0])
        half, across = 0.5 * CAMERA_MM * ahead, 1.6 * np.array([ahead[1], -ahead[0]])
        corners = np.array([place - half, place + half + across, place + half - across])
        shapes.add(_outline(corners, white, black))
    middle = 0.5 * (first + second)
    if np.linalg.norm(second - first) < NARROW_MM:
        shapes.add(_note_at(np.add(middle, (CAMERA_MM, 0.0)), f"P and S, {baseline}", "start"))
        return
    shapes.add(_note_at(np.add(middle, (0.0, 0.8)), baseline, "middle"))
    for name, place in zip("PS", places, strict=True):
        shapes.add(_note_at(np.subtract(place, (0.0, CAMERA_MM + 0.5)), name, "middle"))


def _outline(points: FloatArray, fill: Color, colour: Color = lightgrey) -> Polygon:
    return Polygon(points.ravel().tolist(), fillColor=fill, strokeColor=colour, strokeWidth=0.2)


def _line(start: FloatArray, end: FloatArray, colour: Color, width: float) -> Line:
    return Line(*start.tolist(), *end.tolist(), strokeColor=colour, strokeWidth=width)


def _note_at(place: FloatArray, words: str, anchor: Literal["start", "middle"]) -> String:
    x, y = place.tolist()
    return String(x, y, words, fontName=FONT, fontSize=LABEL_MM, textAnchor=anchor, fillColor=black)
