"""Each figure has a text that says the same, and leaves its colours to the page."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from stereocal.rig.compiled import FloatArray
from tests.figures.every_figure import PLOTS, every_figure

LEAST = 0.2
"""Share of the numbers of a text that can be read off its figure. Measured: 0.2 to 1; the others
are computed from what is drawn, or stand only in the text."""


def numbers(words: str) -> list[float]:
    """All numbers of a text, as written."""
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", words)]


def drawn(values: Any) -> FloatArray:
    """The finite numbers of an axis; none where it holds words."""
    try:
        found = np.array([np.nan if v is None else v for v in np.ravel(values)], dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)
    return found[np.isfinite(found)]


def read_off(figure: go.Figure) -> FloatArray:
    """Counts, ends, extremes and medians of what is drawn, and the numbers of its labels."""
    found = [float(s.x0) for s in figure.layout.shapes if isinstance(s.x0, int | float)]
    for each in (*figure.layout.annotations, *figure.data):
        for key in ("text", "name", "hovertemplate"):
            found += numbers(str(each[key])) if key in each else []
    for trace in figure.data:
        for axis in "xyz":
            values = drawn(trace[axis]) if axis in trace and trace[axis] is not None else ()
            if len(values):
                found += [len(values), *np.percentile(values, [0, 5, 50, 95, 100]), values[0]]
                found += [values[-1], *10 ** np.percentile(np.clip(values, -9, 9), [5, 50, 95])]
    return np.array(found)


def coverage(figure: go.Figure) -> list[float]:
    return [float(len(trace.x)) for trace in named(figure, "Target")]


def disagreement(figure: go.Figure) -> list[float]:
    return [float(value) for value in figure.data[0].x]


def draws(figure: go.Figure) -> list[float]:
    medians = [float(np.median(t.x)) for t in figure.data if t.type == "histogram"]
    return [*medians, float(len(figure.data[0].x))]


def frame_errors(figure: go.Figure) -> list[float]:
    return [float(f(flat(trace.y))) for trace in figure.data for f in (np.median, np.max)]


def lengths(figure: go.Figure) -> list[float]:
    y = flat(figure.data[0].y)
    return [float(len(y)), float(y.min()), float(y.max()), float(np.median(y))]


def matches(figure: go.Figure) -> list[float]:
    return [float(len(trace.x)) for trace in named(figure, "Pair", "No partner")]


def misfit(figure: go.Figure) -> list[float]:
    arrows = named(figure, "Mean residual", "Apart from 0")
    shares = re.findall(r"</b>: ([\d.]+) %", str(figure.to_dict()["layout"]))
    return [sum(len(trace.x) for trace in arrows) / 3, *map(float, shares)]


def pair_errors(figure: go.Figure) -> list[float]:
    (line,) = [shape for shape in figure.layout.shapes if shape.x0 == shape.x1]
    return [float(line.x0)]


def points(figure: go.Figure) -> list[float]:
    (trace,) = named(figure, "Points")
    # The scene has its axes as people stand in it: which is which does not matter here.
    return [float(len(trace.x))]


def residual_field(figure: go.Figure) -> list[float]:
    (trace,) = named(figure, "Mean residual")
    return [len(trace.x) / 3]


def rig(figure: go.Figure) -> list[float]:
    (trace,) = named(figure, "Baseline")
    ends = np.array([trace.x, trace.y, trace.z], dtype=np.float64)
    return [
        float(np.linalg.norm(ends[:, 0] - ends[:, 1])),
        float(len(named(figure, "Target A")[0].x)),
    ]


def written(figure: go.Figure) -> list[float]:
    """The numbers with a unit in the texts of a figure."""
    texts = " ".join(str(each.text) for each in figure.layout.annotations)
    return [float(number) for number in re.findall(r"([\d.]+) (?:%|px|mm)", texts)]


def story_lengths(figure: go.Figure) -> list[float]:
    return [*written(figure), float(len(figure.data[0].x))]


def story_lines(figure: go.Figure) -> list[float]:
    lines = [trace for trace in figure.data if trace.mode == "lines"]
    away = []
    for line in lines:
        (x1, x2), (y1, y2) = line.x, line.y
        away.append(abs(x1 * y2 - x2 * y1) / np.hypot(x2 - x1, y2 - y1))
    assert written(figure) == pytest.approx(away, rel=0.02)
    return written(figure)


def two_rays(figure: go.Figure) -> list[float]:
    return written(figure)


def traces(figure: go.Figure) -> list[float]:
    found = []
    for trace in figure.data:
        if trace.yaxis in (None, "y", "y2") and len(trace.x) > 2:
            found += [float(trace.y[0]), float(trace.y[-1])]
    return found


def trade_off(figure: go.Figure) -> list[float]:
    found = []
    for trace in named(figure, "Lenses"):
        found += [float(trace.x[0]), float(trace.x[-1]), float(trace.y[0]), float(trace.y[-1])]
    for trace in named(figure, "Essential", "2D", "3D", "Refined"):
        found += [float(trace.x[0]), float(trace.y[0])]
    return found


def validation(figure: go.Figure) -> list[float]:
    return [float(trace.x[0]) for trace in named(figure, "Recommended threshold")]


def view_errors(figure: go.Figure) -> list[float]:
    y = flat(figure.data[0].y)
    return [float(len(y)), float(np.median(y)), float(y.max())]


def gap(figure: go.Figure) -> list[float]:
    (drawn,) = named(figure, "gap")
    ends = np.array([drawn.x, drawn.y, drawn.z], dtype=np.float64)
    return [float(np.linalg.norm(ends[:, 0] - ends[:, 1]))]


def image(figure: go.Figure) -> list[float]:
    found = [re.findall(r"([\d.]+) px", str(trace.hovertemplate)) for trace in figure.data]
    return [float(each[0]) for each in found if each]


SHOWN: dict[str, Callable[[go.Figure], list[float]]] = {
    each.__name__: each
    for each in (
        accuracy,
        check,
        comparison,
        coverage,
        disagreement,
        draws,
        frame_errors,
        gap,
        image,
        lengths,
        matches,
        misfit,
        pair_errors,
        plan_baselines,
        plan_depths,
        plan_map,
        points,
        residual_field,
        rig,
        story_lengths,
        story_lines,
        traces,
        trade_off,
        two_rays,
        validation,
        view_errors,
    )
}
"""Numbers that can be read off each figure."""


def test_all_figures_are_looked_at() -> None:
    assert set(PLOTS) == set(every_figure())


@pytest.mark.parametrize("name", PLOTS)
def test_text_has_the_numbers_that_the_figure_shows(name: str) -> None:
    each = every_figure()[name]
    shown, said = read_off(each.figure), numbers(each.words)
    found = [value for value in said if stands(value, shown)]
    assert len(found) >= max(1, LEAST * len(said)), each.words


@pytest.mark.parametrize("name", PLOTS)
def test_background_and_text_are_left_to_the_page(name: str) -> None:
    layout = every_figure()[name].figure.layout
    assert layout.paper_bgcolor == layout.plot_bgcolor == "rgba(0,0,0,0)"
    assert layout.font.color is None
