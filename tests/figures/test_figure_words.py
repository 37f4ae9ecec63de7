"""Each figure has a text that says the same, made of the same inputs, and stands on every page."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from tests.figures.every_figure import PLOTS, every_figure


def numbers(words: str) -> list[float]:
    """All numbers of a text, as written."""
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", words)]


def says(words: str, value: float) -> bool:
    """Whether a text has this number, rounded to two digits or more."""
    return any(
        abs(said - value) <= 0.006 * abs(value) + 1e-12 or said == float(f"{value:.2g}")
        for said in numbers(words)
    )


def named(figure: go.Figure, *names: str) -> list[Any]:
    found = [t for t in figure.data if any(str(t.name).startswith(name) for name in names)]
    assert found, [t.name for t in figure.data]
    return found


def flat(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    found = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    return found[np.isfinite(found)]


def accuracy(figure: go.Figure) -> list[float]:
    maps = [trace for trace in figure.data if trace.type == "heatmap"]
    z = np.concatenate([np.array(trace.z, dtype=np.float64).ravel() for trace in maps])
    z = z[np.isfinite(z)]
    return [
        10 ** float(value) for value in np.percentile(z, [5, 50, 95])
    ]  # the scale is of decades


def plan_map(figure: go.Figure) -> list[float]:
    return accuracy(figure)


def plan_depths(figure: go.Figure) -> list[float]:
    return [value for trace in figure.data for value in flat(trace.y)[[0, -1]]]


def plan_baselines(figure: go.Figure) -> list[float]:
    others, planned = (flat(trace.y) for trace in figure.data)
    return [float(planned[0]), float(others.min())]


def check(figure: go.Figure) -> list[float]:
    return [of(flat(t.y)) for t in figure.data for of in (np.median, np.max)]


def comparison(figure: go.Figure) -> list[float]:
    found = []
    for trace in figure.data:
        # Of a value of 0 its upper limit is drawn, as an arrow.
        zero = [symbol == "arrow-bar-down" for symbol in trace.marker.symbol]
        values = np.where(zero, 0.0, flat(trace.y))
        found += [float(values.min()), float(values.max())]
    return found


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
    assert set(SHOWN) == set(PLOTS) == set(every_figure())


@pytest.mark.parametrize("name", PLOTS)
def test_text_has_the_numbers_that_the_figure_shows(name: str) -> None:
    drawn = every_figure()[name]
    shown = SHOWN[name](drawn.figure)
    assert shown
    missing = [value for value in shown if not says(drawn.words, value)]
    assert not missing, drawn.words


def test_a_number_that_is_not_said_is_noticed() -> None:
    assert says("goes from 9.02 to 8.96 px", 9.018) and not says("goes from 9.02 to 8.96 px", 9.2)


@pytest.mark.parametrize("name", PLOTS)
def test_background_and_text_are_left_to_the_page(name: str) -> None:
    layout = every_figure()[name].figure.layout
    assert layout.paper_bgcolor == layout.plot_bgcolor == "rgba(0,0,0,0)"
    assert layout.font.color is None
