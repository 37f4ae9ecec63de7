"""The paper's Fig. 4 for the user's rig: PDFs of the errors of each method."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import METHOD_NAMES, Method
from stereocal.evaluation.summary import MethodSummary, Pdf
from stereocal.figures import style
from stereocal.figures import validation_panels as data
from stereocal.figures.style import CORRECT_COLOUR, WRONG_COLOUR, scatter
from stereocal.figures.validation_panels import Panel, PanelColumn

PANEL_HEIGHT, SPACING = 190, 0.065
LEFT_WIDTH = 75
LEGEND_LINE, LINE_HEIGHT, FOOT_HEIGHT = 24, 17, 80
QUICK = {"automargin": False, "ticklabeloverflow": "allow"}
HATCH = {"shape": "/", "fillmode": "replace", "size": 6, "solidity": 0.3, "fgcolor": WRONG_COLOUR}


def plot_validation(
    summaries: Mapping[Method, MethodSummary], columns: Sequence[str] = data.COLUMNS
) -> go.Figure:
    """PDFs of residual, reprojection error and 3D error; one row per method.

    In each column the best panel is framed if it is apart from the others beyond the 95 %
    intervals; otherwise those whose intervals overlap its own are marked as level.

    Args:
        columns: the quantities to draw, of `COLUMNS`; on a narrow screen one at a time.
    """
    drawn = data.columns_of(summaries, columns)
    panels = [panel for column in drawn for panel in column.panels]
    rows = len(drawn[0].panels)
    above = LINE_HEIGHT * max(len(panel.title) for panel in panels) + 20
    # On a narrow screen, each entry of the legend is on a separate line.
    top = LEGEND_LINE * (4 if len(columns) == 1 else 2) + LINE_HEIGHT + above
    inside = rows * PANEL_HEIGHT + (rows - 1) * above
    of_container = {"xref": "container", "yref": "container", "y": 1.0, "yanchor": "top"}
    layout: dict[str, Any] = {
        **style.LAYOUT,
        "height": top + inside + FOOT_HEIGHT,
        "hovermode": "x",
        "dragmode": False,
        "margin": {**style.LAYOUT["margin"], "l": LEFT_WIDTH, "t": top, "b": FOOT_HEIGHT},
        "legend": {**style.LAYOUT["legend"], **of_container},
        "annotations": [_title(panel) for panel in panels],
        "shapes": [_frame(panel) for panel in panels if panel.standing == "best"],
    }
    traces: list[dict[str, Any]] = _key(columns)
    spacing = SPACING if len(columns) > 1 else 0.0
    width = (1 - spacing * (len(columns) - 1)) / len(columns)
    for column in drawn:
        for panel in column.panels:
            left, end = (
                panel.column * (width + spacing),
                1 - panel.row * (PANEL_HEIGHT + above) / inside,
            )
            across, up = [left, left + width], [max(end - PANEL_HEIGHT / inside, 0.0), end]
            layout |= _axes(column, panel, across, up)
            traces += _traces(column, panel)
    # In one step: axis by axis, and trace by trace, Plotly takes 0.2 s.
    return go.Figure(data=traces, layout=layout)


def _axes(
    column: PanelColumn, panel: Panel, across: list[float], up: list[float]
) -> dict[str, dict[str, Any]]:
    """Both axes of a panel and their part of the figure; of the residual labelled as powers."""
    lowest, first = panel is column.panels[-1], panel.column == 0
    x = style.axis_of(
        "<br>".join(column.foot) if lowest else None,
        domain=across,
        anchor=f"y{panel.axis}",
        type="log",
        range=list(column.span),
        showticklabels=lowest,
        tickangle=0,
        **QUICK,
        dtick=1 if column.labels_all else 2,
        exponentformat="power" if panel.quantity == "residual" else "none",
        minor={"ticks": "outside", "ticklen": 2, "dtick": "D1"},
    )
    title = f"<b>{METHOD_NAMES[panel.method]}</b><br>Density per decade" if first else None
    own = {
        "domain": up,
        "anchor": f"x{panel.axis}",
        "range": [0, 1.22 * column.most],
        "nticks": 5,
        **QUICK,
    }
    return {f"xaxis{panel.axis}": x, f"yaxis{panel.axis}": style.axis_of(title, **own)}


def _title(panel: Panel) -> dict[str, Any]:
    heading = [f"<b>{data.HEADINGS[panel.quantity]}</b>"] if panel.row == 0 else []
    above = {"x": 0, "xanchor": "left", "y": 1, "yanchor": "bottom", "yshift": 3, "align": "left"}
    return style.note("<br>".join([*heading, *panel.title]), panel.axis, {"size": 12}) | above


def _frame(panel: Panel) -> dict[str, Any]:
    refs = {"xref": f"x{panel.axis} domain", "yref": f"y{panel.axis} domain"}
    box = {"type": "rect", "x0": 0, "x1": 1, "y0": 0, "y1": 1, **refs}
    line = {"color": style.METHOD_COLOURS[panel.method], "width": 4}
    return {**box, "name": f"best {panel.quantity}", "line": line}


def _traces(column: PanelColumn, panel: Panel) -> list[dict[str, Any]]:
    """The PDFs of a panel; and the threshold, or the line at 1 %, with its value above them."""
    span = column.span
    relative = (np.log10(panel.line) - span[0]) / (span[1] - span[0])
    side = "center" if 0.15 < relative < 0.85 else "right" if relative < 0.5 else "left"
    name = "Recommended threshold" if panel.matching else "3D error of 1 %"
    line = scatter(
        np.array([[panel.line, 0], [panel.line, 1.06 * column.most]]),
        f"{name.lower()}: {panel.line_text}",
        text=["", panel.line_text],
        textposition=f"top {side}",
        textfont={"size": 12},
        cliponaxis=False,
        line=style.DASHED,
        name=name,
    )
    axes = {"xaxis": f"x{panel.axis}", "yaxis": f"y{panel.axis}", "showlegend": False}
    pdfs = [_pdf(panel, *curve) for curve in panel.curves]
    return [{**trace, **axes} for trace in (*pdfs, line)]


def _pdf(panel: Panel, kind: str, pdf: Pdf, colour: str) -> dict[str, Any]:
    """A PDF as a filled step line; wrong pairs are hatched and dotted."""
    drawn = data.drawn_bins(pdf)
    ends = panel.scale * 10 ** np.column_stack([pdf.edges[:-1], pdf.edges[1:]])[drawn]
    unit, what = data.UNITS[panel.quantity], f"{kind} pairs" if panel.matching else "3D error"
    return scatter(
        np.column_stack([np.sqrt(ends.prod(axis=1)), pdf.density[drawn]]),
        f"{what}: %{{customdata[0]:.3~r}} to %{{customdata[1]:.3~r}}{unit}<br>"
        "%{y:.3~r} per decade",
        hoveron="points",
        customdata=ends,
        name=f"{METHOD_NAMES[panel.method]}, {what}",
        **_area(kind, colour, shape="hvh", width=2),
    )


def _area(kind: str, colour: str, **line: Any) -> dict[str, Any]:
    """How the area of a PDF is drawn."""
    if kind == "wrong":
        fill = {"fillcolor": WRONG_COLOUR, "fillpattern": HATCH}
        return {"fill": "tozeroy", "line": {"color": colour, "dash": "dot", **line}, **fill}
    own = {"color": colour, "dash": "solid", **line}
    return {"fill": "tozeroy", "line": own, "fillcolor": style.FILLS[kind]}


def _key(columns: Sequence[str]) -> list[dict[str, Any]]:
    """The legend, made of traces without points, so that clicks do not hide single panels."""
    keys: dict[str, dict[str, Any]] = {}
    if {*columns} - {"reconstruction"}:
        keys["Correct pairs"] = _area("correct", CORRECT_COLOUR)
        keys["Wrong pairs"] = _area("wrong", WRONG_COLOUR)
    lines = "Dashed: threshold"
    if "reconstruction" in columns:
        lines = "Dashed: 1 %" if len(columns) == 1 else "Dashed: threshold, or 1 %"
    keys[lines] = {"line": style.DASHED}
    frame = {"symbol": "square-open", "size": 12, "color": style.NEUTRAL, "line": {"width": 3}}
    keys["Framed: best; level: intervals overlap"] = {"marker": frame}
    return [scatter(style.NOWHERE, name=name, **key) for name, key in keys.items()]
