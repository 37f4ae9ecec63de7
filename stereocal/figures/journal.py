"""Figures for print, drawn by Matplotlib from the data of the Plotly figures: SVG and PDF.

Importing Matplotlib takes 0.4 s, so this module is imported where a kit is made.
"""

import io
import threading
from collections.abc import Callable, Mapping
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullFormatter

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.evaluation.summary import MethodSummary
from stereocal.figures import validation
from stereocal.figures.frame_errors import KINDS, FrameKind, frame_panels
from stereocal.figures.rig import scene_of
from stereocal.figures.space import frusta
from stereocal.figures.style import CORRECT_COLOUR, METHOD_COLOURS, NEUTRAL, WRONG_COLOUR
from stereocal.figures.validation import COLUMNS, Panel, PanelColumn
from stereocal.refined.results import Calibration
from stereocal.system.array_types import FloatArray

COLUMN_MM, PAGE_MM = 88.0, 180.0
"""Widths of one column and of both, in most journals."""
MM_PER_INCH = 25.4
SMALL, TEXT = 6.0, 7.0
"""Sizes of letters in points: journals ask for 5 to 8."""
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    **dict.fromkeys(["axes.titlesize", "axes.labelsize"], TEXT),
    **dict.fromkeys(["xtick.labelsize", "ytick.labelsize", "legend.fontsize"], SMALL),
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    **dict.fromkeys(["axes.linewidth", "xtick.major.width", "ytick.major.width"], 0.5),
    **dict.fromkeys(["xtick.minor.width", "ytick.minor.width"], 0.3),
    **dict.fromkeys(["xtick.major.size", "ytick.major.size"], 2.5),
    **dict.fromkeys(["xtick.minor.size", "ytick.minor.size"], 1.5),
    **dict.fromkeys(["axes.spines.top", "axes.spines.right"], False),
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
PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
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


ROW_MM, LEGEND_MM = 36.0, 18.0
FILL = 0.45
HATCH = "/////"
LINE: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 0.7}


def draw_validation(summaries: Mapping[Method, MethodSummary], width_mm: float) -> Figure:
    """All three quantities over the width of a page; in a column, which has no room for more, the
    errors that choose the sets: reprojection and 3D error."""
    wide = width_mm >= PAGE_MM
    columns = validation.columns_of(summaries, COLUMNS if wide else COLUMNS[1:])
    rows = len(columns[0].panels)
    figure = sheet(width_mm, rows * ROW_MM + LEGEND_MM)
    grid = figure.subplots(rows, len(columns), squeeze=False)
    for column, of_column in zip(columns, grid.T, strict=True):
        for panel, axes in zip(column.panels, of_column, strict=True):
            _draw_pdfs(axes, panel, column.most)
            _set_axes(axes, column, panel)
            # The quantity above the first row, and the figure with its interval and standing.
            lines = [validation.HEADINGS[panel.quantity]] if panel.row == 0 else []
            name, value, among = panel.figure or ("no bar could be measured", "", "")
            mark = f", {panel.standing}" if panel.standing else ""
            lines += [f"{name} {value} {among}{mark}"] if wide else [f"{name} {value}{mark}", among]
            axes.set_title("\n".join(lines).strip(), loc="left", pad=3, fontsize=SMALL)
        foot = "\n".join(column.foot).replace("<sup>R</sup>", "ᴿ")
        of_column[-1].set_xlabel(foot, fontsize=TEXT if wide else SMALL)
    hatched = Patch(facecolor="none", edgecolor=WRONG_COLOUR, hatch=HATCH, linewidth=0)
    frame: dict[str, Any] = {"marker": "s", "markersize": 5, "markeredgewidth": 1.5}
    frame |= {"markerfacecolor": "none", "linestyle": "none"}
    keys = {
        "Correct pairs": Patch(facecolor=CORRECT_COLOUR, alpha=FILL),
        "Wrong pairs": hatched,
        "Threshold, or 1 %": Line2D([], [], **LINE),
        "Framed: best; level: intervals overlap": Line2D([], [], color=NEUTRAL, **frame),
    }
    figure.legend(keys.values(), keys.keys(), loc="outside upper left", ncols=4 if wide else 2)
    return figure


def _draw_pdfs(axes: Axes, panel: Panel, most: float) -> None:
    for kind, pdf, colour in panel.curves:
        drawn = validation.drawn_bins(pdf)
        edges = panel.scale * 10.0 ** pdf.edges[drawn.start : drawn.stop + 1]
        density, wrong = pdf.density[drawn], kind == "wrong"
        if not len(density):
            continue
        fill: dict[str, Any] = {"facecolor": colour, "alpha": FILL}
        if wrong:
            fill = {"facecolor": "none", "hatch": HATCH}
        axes.stairs(density, edges, fill=True, linewidth=0, edgecolor=colour, **fill)
        axes.stairs(density, edges, color=colour, linestyle=":" if wrong else "-")
    top = 1.04 * most
    axes.plot([panel.line] * 2, [0, top], **LINE)
    above: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": SMALL}
    at = (panel.line, top)
    axes.annotate(panel.line_text, at, (0, 1), textcoords="offset points", **above)
    axes.set_ylim(0, 1.25 * most)


def _set_axes(axes: Axes, column: PanelColumn, panel: Panel) -> None:
    axes.set_xscale("log")
    axes.set_xlim(*(10**end for end in column.span))
    axes.xaxis.set_major_locator(LogLocator(10.0 if column.labels_all else 100.0, numticks=20))
    axes.xaxis.set_minor_locator(LogLocator(10.0, subs=(2.0, 5.0), numticks=200))
    axes.xaxis.set_minor_formatter(NullFormatter())
    power = panel.quantity == "residual"
    axes.xaxis.set_major_formatter(LogFormatterMathtext() if power else PLAIN)
    axes.tick_params(labelbottom=panel is column.panels[-1])
    if panel.standing == "best":
        for spine in axes.spines.values():
            spine.set(visible=True, linewidth=1.5, color=METHOD_COLOURS[panel.method])
    if panel.column == 0:
        axes.set_ylabel(f"{METHOD_NAMES[panel.method]}\nDensity per decade")


MARKERS: dict[Method, str] = {"essential": "s", "2d": "o", "3d": "^", "refined": "D"}
LARGER: dict[Method, float] = {"essential": 1.4, "2d": 1.0, "3d": 1.1, "refined": 0.9}
"""Sizes of the symbols: the essential matrix and the 2D set often have the same errors."""
MANY = 100
"""Frames above which symbols are smaller."""


def draw_frame_errors(calibration: Calibration, width_mm: float) -> Figure:
    """Filled: calibrated with; open: held out; dotted: left out."""
    figure = sheet(width_mm, 90.0)
    grid, panels = figure.subplots(2, 1, sharex=True), frame_panels(calibration)
    for axes, panel in zip(grid, panels, strict=True):
        size = 1.6 if len(panel.frames) > MANY else 3.0
        for method, values in panel.values.items():
            for kind, of in panel.kinds.items():
                for style in _symbols(kind, MARKERS[method], size * LARGER[method]):
                    axes.plot(panel.frames[of], values[of], color=METHOD_COLOURS[method], **style)
        axes.set_ylabel(f"{panel.title} ({panel.unit})")
        axes.set_yscale("log" if panel.is_log else "linear")
        axes.set_ylim(*panel.ends)
        if panel.is_log:
            axes.yaxis.set_major_formatter(PLAIN)
    grid[1].set_xlabel(f"Frame (n = {len(panels[0].frames):,})")
    keys = {
        METHOD_NAMES[method]: (METHOD_COLOURS[method], _symbols(KINDS[0], MARKERS[method], 3))
        for method in panels[0].values
    }
    for kind, n in zip(KINDS, panels[0].counts, strict=True):
        if kind.key and n:
            keys[kind.key] = (NEUTRAL, _symbols(kind, "o", 3))
    symbols: list[Any] = [
        tuple(Line2D([], [], color=colour, **style) for style in styles)
        for colour, styles in keys.values()
    ]
    own: dict[str, Any] = {"ncols": 6 if width_mm >= PAGE_MM else 3, "loc": "outside upper left"}
    figure.legend(symbols, list(keys), handler_map={tuple: HandlerTuple(ndivide=1)}, **own)
    return figure


def _symbols(kind: FrameKind, marker: str, size: float) -> list[dict[str, Any]]:
    """The symbol of a kind of frames, and the dot in it."""
    outer = {"linestyle": "none", "marker": marker, "markersize": size, "markeredgewidth": 0.4}
    outer["markerfacecolor"] = "none" if "open" in kind.suffix else None
    dot = {"linestyle": "none", "marker": ".", "markersize": 0.4 * size}
    return [outer, *([dot] if "dot" in kind.suffix else [])]


VIEWS = (("From above", 0, -1.0, "Left, −x (m)"), ("From the side", 1, -1.0, "Up, −y (m)"))
"""Title, coordinate of the vertical axis, its sign, and its label. Depth runs to the right."""
AXIS_MM, NAME_MM, BORDER_MM, REST_MM, MOST_MM = 13.0, 13.0, 4.0, 23.0, 200.0
LABEL_POINTS = 6.0


def draw_rig(calibration: Calibration, method: Method, width_mm: float) -> Figure:
    """Cameras, baseline and reconstructed bars; equal axes, metres."""
    scene = scene_of(calibration, method)
    outlines = {name: path for name, _, path in frusta(scene.rig, scene.depth)}
    bars = scene.bars[scene.drawn]
    everything = np.concatenate([*outlines.values(), bars.reshape(-1, 3)])
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    wide = width_mm >= PAGE_MM
    columns = 2 if wide else 1
    per_metre = (width_mm / columns - AXIS_MM - NAME_MM - 1) / max(float(high[2] - low[2]), 1e-9)
    heights = [per_metre * float(high[at] - low[at]) + REST_MM for _, at, _, _ in VIEWS]
    figure = sheet(width_mm, min(max(heights) if wide else sum(heights), MOST_MM))
    shape = {"width_ratios": [1, 1]} if wide else {"height_ratios": heights}
    grid = figure.subplots(3 - columns, columns, squeeze=False, gridspec_kw=shape).ravel()
    for axes, (title, at, sign, label) in zip(grid, VIEWS, strict=True):
        _draw_rig(axes, outlines, at, sign)
        style: dict[str, Any] = {"colors": METHOD_COLOURS[method], "linewidths": 0.5, "alpha": 0.7}
        axes.add_collection(LineCollection(_flat(bars, at, sign).tolist(), **style))
        axes.set_aspect("equal", adjustable="box", anchor="NW")
        ends = sorted((sign * low[at], sign * high[at]))
        axes.set(
            xlabel="Depth z (m)",
            ylabel=label,
            xlim=(low[2] - NAME_MM / per_metre, high[2] + 1 / per_metre),
            ylim=(ends[0] - BORDER_MM / per_metre, ends[1] + BORDER_MM / per_metre),
        )
        title += f"; baseline {scene.rig.pose.baseline:.3f} m" if at == 0 else ""
        axes.set_title(title, loc="left", pad=3)
    return figure


def _draw_rig(axes: Axes, outlines: Mapping[str, FloatArray], at: int, sign: float) -> None:
    """Both cameras, with their names in the view from above, and the baseline."""
    ends = _flat(np.array([outline[0] for outline in outlines.values()]), at, sign)
    axes.plot(*ends.T, color=NEUTRAL, linestyle="--", linewidth=0.6)
    for name, outline in outlines.items():
        flat = _flat(outline, at, sign)
        axes.plot(*flat.T, color="black", linewidth=0.6)
        if at:
            continue
        # Behind the camera.
        away = flat[0] - np.nanmean(flat, axis=0)
        offset = LABEL_POINTS * away / max(float(np.linalg.norm(away)), 1e-9)
        side = "center" if abs(away[0]) < abs(away[1]) else "right" if away[0] < 0 else "left"
        own: dict[str, Any] = {"fontsize": SMALL, "ha": side, "va": "center"}
        axes.annotate(name, tuple(flat[0]), tuple(offset), textcoords="offset points", **own)


def _flat(points: FloatArray, at: int, sign: float) -> FloatArray:
    """(..., 2): depth and one other coordinate of points (..., 3)."""
    return np.stack([points[..., 2], sign * points[..., at]], axis=-1)
