"""Paper, fonts and files of the figures for print.

Importing Matplotlib takes 0.4 s, so these modules are imported where a kit is made.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

COLUMN_MM, PAGE_MM = 88.0, 180.0
"""Widths of one column and of both, in most journals."""
MM_PER_INCH = 25.4
SMALL, TEXT = 6.0, 7.0
"""Sizes of letters in points: journals ask for 5 to 8."""
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.labelsize": TEXT,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.minor.width": 0.3,
    "ytick.minor.width": 0.3,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.5,
    "lines.linewidth": 0.8,
    "axes.unicode_minus": True,
    # Fonts as TrueType inside the PDF, which editors of journals can change; texts stay texts.
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "stereocal",
}
"""DejaVu Sans comes with Matplotlib: figures are the same on every computer."""
SVG = {"Date": None, "Creator": None}
PDF = {"CreationDate": None, "ModDate": None, "Creator": None, "Producer": None}
"""Neither dates nor versions in the files."""
_DRAWING = threading.Lock()
"""Matplotlib's style belongs to the whole process."""
Format = Literal["svg", "pdf"]
Draw = Callable[[float], Figure]
"""A figure of a width in millimetres."""


def rendered(draw: Draw, width_mm: float) -> dict[Format, bytes]:
    """A figure as SVG and PDF; equal data give equal bytes."""
    # Also where the user's own style says otherwise.
    style: dict[Any, Any] = dict(mpl.rcParamsDefault)
    del style["backend"]
    style.update(STYLE)
    with _DRAWING, mpl.rc_context(style):
        figure = draw(width_mm)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # arranged once for both formats
        svg, pdf = io.BytesIO(), io.BytesIO()
        # `savefig` would draw each twice.
        FigureCanvasSVG(figure).print_svg(svg, metadata=SVG)  # type: ignore[no-untyped-call]
        FigureCanvasPdf(figure).print_pdf(pdf, metadata=PDF)  # type: ignore[no-untyped-call]
    return {"svg": svg.getvalue(), "pdf": pdf.getvalue()}


def sheet(width_mm: float, height_mm: float) -> Figure:
    """An empty figure of this size, whose parts are arranged without overlap."""
    size = (width_mm / MM_PER_INCH, height_mm / MM_PER_INCH)
    return Figure(figsize=size, layout="constrained")


def write_left(axes: Axes, text: str, **style: Any) -> None:
    """A title above the left end of a panel."""
    axes.set_title(text, loc="left", pad=3, **style)
