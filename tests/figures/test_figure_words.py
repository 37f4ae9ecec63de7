"""Each figure has a text that says the same, and leaves its colours to the page."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from stereocal.rig.compiled import FloatArray
from tests.figures.every_figure import PLOTS, every_figure

NONE = np.empty(0)
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
        return NONE
    return found[np.isfinite(found)]


def read_off(figure: go.Figure) -> FloatArray:
    """Counts, ends, extremes and medians of what is drawn, and the numbers of its labels."""
    found = [float(s.x0) for s in figure.layout.shapes if isinstance(s.x0, int | float)]
    for each in (*figure.layout.annotations, *figure.data):
        for key in ("text", "name", "hovertemplate"):
            found += numbers(str(each[key])) if key in each else []
    for axis in (*figure.select_xaxes(), *figure.select_yaxes()):
        found += numbers(str(axis.title.text))
    for trace in figure.data:
        for axis in "xyz":
            values = drawn(trace[axis]) if axis in trace and trace[axis] is not None else NONE
            if len(values):
                found += [len(values), *np.percentile(values, [0, 5, 50, 95, 100]), values[0]]
                found += [values[-1], *10 ** np.percentile(np.clip(values, -9, 9), [5, 50, 95])]
    return np.array(found)


def stands(value: float, shown: FloatArray) -> bool:
    """Whether one of the numbers is this one, rounded to two digits or more."""
    near = np.abs(shown - value) <= 0.006 * np.abs(shown) + 1e-12
    return bool(near.any()) or any(float(f"{each:.2g}") == value for each in shown)


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
