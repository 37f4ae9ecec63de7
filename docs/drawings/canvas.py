"""A page of SVG to draw on: lines, texts, cameras, bars and targets."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from math import cos, radians, sin

from stereocal.figures.style import CORRECT_COLOUR, METHOD_COLOURS, WRONG_COLOUR

INK, GREY, FAINT = "#22303C", "#6B7680", "#D5DADE"
BLUE, ORANGE = METHOD_COLOURS["2d"], METHOD_COLOURS["3d"]
GREEN, BAD = CORRECT_COLOUR, WRONG_COLOUR
FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif"
LINE_HEIGHT = 1.25

Point = tuple[float, float]


@dataclass
class Canvas:
    """A white page, in pixels from its upper left corner."""

    width: int
    height: int
    parts: list[str] = field(default_factory=list)

    def svg(self, words: str) -> str:
        """The page as a file; `words` say what is to be seen."""
        size = f'width="{self.width}" height="{self.height}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
        head += f'viewBox="0 0 {self.width} {self.height}" role="img" font-family="{FONT}">'
        title = f"<title>{escape(' '.join(words.split()))}</title>"
        ground = f'<rect {size} rx="8" fill="white"/>'
        return "\n".join([head, title, ground, *self.parts, "</svg>\n"])

    def line(
        self, start: Point, end: Point, colour: str = INK, width: float = 2, dash: str = ""
    ) -> None:
        """A straight line; `dash` as in SVG."""
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(
            f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" '
            f'stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round"{dashed}/>'
        )

    def polygon(
        self, corners: Sequence[Point], fill: str = "none", edge: str = INK, width: float = 2
    ) -> None:
        """A closed polygon."""
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(
            f'<polygon points="{points}" fill="{fill}" stroke="{edge}" stroke-width="{width:g}" '
            'stroke-linejoin="round"/>'
        )

    def rectangle(
        self, corner: Point, size: Point, fill: str = "none", edge: str = INK, width: float = 2
    ) -> None:
        """A rectangle by its upper left corner and its size."""
        (x, y), (w, h) = corner, size
        self.polygon([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], fill, edge, width)

    def dot(self, at: Point, radius: float = 4, fill: str = INK, edge: str = "none") -> None:
        """A filled circle."""
        self.parts.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}" fill="{fill}" '
            f'stroke="{edge}" stroke-width="2"/>'
        )

    def text(
        self,
        at: Point,
        text: str,
        colour: str = INK,
        size: float = 17,
        anchor: str = "middle",
        bold: bool = False,
    ) -> None:
        """One or more lines; `at` is the anchor on the first line's base."""
        weight = ' font-weight="bold"' if bold else ""
        for row, words in enumerate(text.split("\n")):
            y = at[1] + row * LINE_HEIGHT * size
            self.parts.append(
                f'<text x="{at[0]:.1f}" y="{y:.1f}" fill="{colour}" font-size="{size:g}" '
                f'text-anchor="{anchor}"{weight}>{escape(" ".join(words.split()))}</text>'
            )

    def arrow(
        self, start: Point, end: Point, colour: str = INK, both: bool = False, width: float = 2
    ) -> None:
        """A line with a head at its end, or at both."""
        self.line(start, end, colour, width)
        for tip, other in ((end, start), (start, end))[: 1 + both]:
            dx, dy = other[0] - tip[0], other[1] - tip[1]
            length = (dx * dx + dy * dy) ** 0.5
            ux, uy = dx / length, dy / length
            wings = [
                (tip[0] + 10 * ux - s * 4 * uy, tip[1] + 10 * uy + s * 4 * ux) for s in (1, -1)
            ]
            self.polygon([tip, *wings], colour, colour, 1)

    def camera(self, at: Point, towards_deg: float, name: str = "", below: float = 36) -> None:
        """A camera from above, its entrance pupil at `at`; 90 degrees is up the page."""

        def place(ahead: float, left: float) -> Point:
            a = radians(towards_deg)
            return (at[0] + ahead * cos(a) - left * sin(a), at[1] - ahead * sin(a) - left * cos(a))

        self.polygon([place(-34, 13), place(-8, 13), place(-8, -13), place(-34, -13)], GREY, GREY)
        self.polygon([place(-8, 7), place(8, 10), place(8, -10), place(-8, -7)], FAINT, GREY)
        if name:
            self.text((at[0], at[1] + below + 16), name, GREY)

    def target(self, at: Point, side: float, turn_deg: float = 0, squeeze: float = 1) -> None:
        """A 2x2 checkerboard; `squeeze` below 1 shows it tilted."""

        def place(x: float, y: float) -> Point:
            a, half = radians(turn_deg), side / 2
            u, v = x * half * squeeze, y * half
            return (at[0] + u * cos(a) - v * sin(a), at[1] + u * sin(a) + v * cos(a))

        square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        self.polygon([place(x, y) for x, y in square], "white", INK, 1)
        for sx, sy in ((-1, -1), (1, 1)):
            self.polygon(
                [place(x, y) for x, y in ((0, 0), (sx, 0), (sx, sy), (0, sy))], INK, INK, 1
            )

    def bar(self, start: Point, end: Point, side: float = 0, colour: str = ORANGE) -> None:
        """A bar between two targets; without a side, as two dots."""
        self.line(start, end, colour, 4 if side else 2.5)
        for at in (start, end):
            if side:
                self.target(at, side)
            else:
                self.dot(at, 4, colour)

    def mark(self, at: Point, good: bool) -> None:
        """A tick for what is right, a cross for what is not."""
        x, y = at
        if good:
            self.line((x - 8, y), (x - 2, y + 7), GREEN, 4)
            self.line((x - 2, y + 7), (x + 10, y - 8), GREEN, 4)
        else:
            self.line((x - 8, y - 8), (x + 8, y + 8), BAD, 4)
            self.line((x - 8, y + 8), (x + 8, y - 8), BAD, 4)
