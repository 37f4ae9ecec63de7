"""Each figure has a text that says the same, leaves its colours to the page, and tells things apart
for colour-blind people too, by colour or otherwise.

Simulation: Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB. Distance: CIEDE2000.
"""

import itertools
import re
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from skimage.color import deltaE_ciede2000, xyz2lab
from skimage.color.colorconv import xyz_from_rgb

from stereocal.figures import style
from stereocal.system.array_types import FloatArray
from tests.figures.every_figure import PLOTS, every_figure

PAGES = {"light": "#FFFFFF", "dark": "#12181E"}
SIGHTS = {
    name: np.array(numbers.split(), dtype=np.float64).reshape(3, 3)
    for name, numbers in {
        "normal": "1 0 0  0 1 0  0 0 1",
        "protanopia": "0.152286 1.052583 -0.204868  0.114503 0.786281 0.099216 "
        "-0.003882 -0.048116 1.051998",
        "deuteranopia": "0.367322 0.860646 -0.227968  0.280085 0.672501 0.047413 "
        "-0.011820 0.042940 0.968881",
        "tritanopia": "1.255528 -0.076749 -0.178779  -0.078411 0.930809 0.147602 "
        "0.004733 0.691367 0.303900",
    }.items()
}
APART = 11.0
"""CIEDE2000 of two lines or marks that are taken for different at a glance; 2.3 is just noticeable
side by side, and thin lines need several times that."""
LINE_CONTRAST = 3.0
"""Of parts of a figure against the page (WCAG 2.1, 1.4.11)."""


def linear(colour: str) -> FloatArray:
    """Linear RGB, 0 to 1, of #rrggbb."""
    value = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def difference(first: FloatArray, second: FloatArray) -> float:
    """CIEDE2000 of two colours in linear RGB."""
    one, other = (xyz2lab(linear_to_xyz(rgb)) for rgb in (first, second))
    return float(deltaE_ciede2000(one, other))  # type: ignore[no-untyped-call]


def linear_to_xyz(rgb: FloatArray) -> FloatArray:
    """Of sRGB primaries, D65."""
    return xyz_from_rgb @ np.clip(rgb, 0, 1)


def nearest(first: str, second: str) -> float:
    """How far apart two colours are for those who see them least apart."""
    return min(
        difference(sight @ linear(first), sight @ linear(second)) for sight in SIGHTS.values()
    )


def contrast(first: str, second: str) -> float:
    """Contrast ratio (WCAG 2.1)."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    dark, light = sorted(float(weights @ linear(colour)) for colour in (first, second))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("page", PAGES)
def test_lines_stand_out_from_the_page(page: str) -> None:
    named = {str(method): colour for method, colour in style.METHOD_COLOURS.items()}
    named |= {f"target {letter}": colour for letter, colour in style.TARGET_COLOURS.items()}
    named |= {
        "correct": style.CORRECT_COLOUR,
        "wrong": style.WRONG_COLOUR,
        "neutral": style.NEUTRAL,
    }
    named["grid of a 3D scene"] = style.GRID_3D
    found = {name: contrast(colour, PAGES[page]) for name, colour in named.items()}
    faint = {name: round(value, 2) for name, value in found.items() if value < LINE_CONTRAST}
    assert not faint


def marks(trace: Any) -> tuple[Any, ...]:
    """What of a trace is not its colour."""
    line, marker = trace.line if "line" in trace else None, getattr(trace, "marker", None)
    pattern = getattr(getattr(trace, "fillpattern", None), "shape", None)
    bars = getattr(getattr(marker, "pattern", None), "shape", None)
    return (
        trace.type,
        getattr(trace, "mode", None),
        getattr(line, "dash", None) or "solid",
        getattr(marker, "symbol", None),
        pattern,
        bars,
        bool(getattr(trace, "fill", None)),
    )


def colour_of(trace: Any) -> str | None:
    """The colour that a trace has as a whole."""
    mode = str(getattr(trace, "mode", ""))
    part = trace.line if mode == "lines" else trace.marker
    colour = getattr(part, "color", None)
    return colour if isinstance(colour, str) and colour.startswith("#") else None


def where(trace: Any) -> Any:
    """The panel of a trace."""
    return getattr(trace, "xaxis", None) or "x"


def too_near(figure: go.Figure) -> list[str]:
    """Pairs of a panel's traces that neither colour nor any other mark tells apart."""
    found = []
    traces = [t for t in figure.data if t.type != "heatmap" and t.name and colour_of(t)]
    for one, other in itertools.combinations(traces, 2):
        first, second = colour_of(one), colour_of(other)
        assert first and second
        if where(one) != where(other) or first == second or marks(one) != marks(other):
            continue
        if nearest(first, second) < APART:
            found.append(f"{one.name} and {other.name}: {nearest(first, second):.1f}")
    return found


@pytest.mark.parametrize("name", PLOTS)
def test_what_a_figure_tells_apart_by_colour_is_seen_by_all(name: str) -> None:
    assert too_near(every_figure()[name].figure) == []


def test_check_sees_a_figure_that_colour_alone_tells_apart() -> None:
    figure = go.Figure()
    for name, colour in (("red", "#D04040"), ("green", "#708020")):
        figure.add_scatter(x=[0, 1], y=[0, 1], name=name, mode="lines", line={"color": colour})
    assert too_near(figure)
    figure.data[1].line.dash = "dot"
    assert not too_near(figure)


def test_methods_and_targets_have_signs_of_their_own() -> None:
    for colours, symbols in (
        (style.METHOD_COLOURS, style.METHOD_SYMBOLS),
        (style.TARGET_COLOURS, style.TARGET_SYMBOLS),
    ):
        assert len(set(symbols.values())) == len(symbols) == len(colours)
        for first, second in itertools.combinations(colours.values(), 2):
            assert nearest(first, second) > APART  # measured: 12.3 for methods, 15.9 for targets
    # Wrong pairs are hatched and dotted too.
    assert nearest(style.CORRECT_COLOUR, style.WRONG_COLOUR) > APART


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
