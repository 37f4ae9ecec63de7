"""The figure of the validation shows the numbers of its summaries."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from stereocal.calibration.methods import METHODS, CalibrationSettings, Method
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts, evaluate
from stereocal.evaluation.summary import Estimate, MethodSummary, Pdf, summarise
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES
from stereocal.figures.tables import validation_table
from stereocal.figures.validation import describe_validation, plot_validation
from stereocal.formats.dataset_files import read_dataset
from stereocal.verdict.in_words import percent
from stereocal.verdict.validation_in_words import validation_answer

SAMPLE = Path(__file__).parents[2] / "sample_data" / "field"
SETTINGS = EvaluationSettings(CalibrationSettings(essential="linear"), runs=6)
NAN = float("nan")
Summaries = dict[Method, MethodSummary]


@cache
def runs_twice() -> list[list[RunCounts]]:
    """The runs of the sample, and again as a second data set."""
    dataset = read_dataset(SAMPLE)
    with ThreadPoolExecutor(2) as executor:
        return evaluate([dataset, dataset], SETTINGS, executor)


@pytest.fixture(scope="module")
def summaries() -> Summaries:
    return summarise(runs_twice()[:1])


def without_bars(summary: MethodSummary) -> MethodSummary:
    """As if no bar could be reconstructed."""
    lengths = summary.reconstruction
    pdf = Pdf(lengths.pdf.edges, np.zeros_like(lengths.pdf.density), 0, 0, lengths.pdf.n)
    names = ("p95", "mean", "fraction_above_1_percent", "wand_score", "mean_length_error")
    unknown: dict[str, Any] = dict.fromkeys(names, NAN)
    empty = replace(lengths, pdf=pdf, median=Estimate(NAN, NAN, NAN), **unknown)
    return replace(summary, reconstruction=empty)


def with_fcp(summary: MethodSummary, value: float, low: float, high: float) -> MethodSummary:
    matching = replace(summary.reprojection, fcp=Estimate(value, low, high))
    return replace(summary, reprojection=matching)


def trace(figure: go.Figure, name: str, axis: str) -> Any:
    (found,) = (t for t in figure.data if t.name == name and (t.xaxis or "x") == axis)
    return found


def axis_of(method: Method, column: int) -> str:
    number = 3 * METHODS.index(method) + column
    return "x" if number == 1 else f"x{number}"


def texts(figure: go.Figure) -> list[str]:
    return [annotation.text for annotation in figure.layout.annotations]


def assert_shows(drawn: Any, pdf: Pdf, scale: float = 1.0) -> None:
    """The trace has every filled bin of the PDF, in its middle on a logarithmic axis."""
    middles = scale * 10 ** ((pdf.edges[:-1] + pdf.edges[1:]) / 2)
    at = np.searchsorted(middles, np.array(drawn.x) * (1 - 1e-9))
    np.testing.assert_allclose(middles[at], drawn.x)
    np.testing.assert_array_equal(pdf.density[at], drawn.y)
    assert np.sum(drawn.y) == pytest.approx(pdf.density.sum())
    assert drawn.line.shape == "hvh"


def test_every_panel_shows_its_pdfs_and_says_fcp_interval_and_counts(summaries: Summaries) -> None:
    figure = plot_validation(summaries)
    said = texts(figure)
    for method, summary in summaries.items():
        name = METHOD_NAMES[method]
        for column, found in ((1, summary.residual), (2, summary.reprojection)):
            axis = axis_of(method, column)
            assert_shows(trace(figure, f"{name}, correct pairs", axis), found.correct)
            assert_shows(trace(figure, f"{name}, wrong pairs", axis), found.wrong)
        errors = trace(figure, f"{name}, 3D error", axis_of(method, 3))
        assert_shows(errors, summary.reconstruction.pdf, 100.0)  # in %
        assert errors.line.color == METHOD_COLOURS[method]
        fcp, n = summary.reprojection.fcp, summary.reprojection
        interval = f"({percent(fcp.low)} to {percent(fcp.high)})"
        wanted = f"overlap, FCP <b>{percent(fcp.value)} %</b> {interval}"
        counts = f"n = {n.correct.n} correct, {n.wrong.n} wrong"
        assert any(wanted in text and counts in text for text in said)
        median = f"median <b>{percent(summary.reconstruction.median.value)} %</b>"
        assert any(median in text for text in said)
    assert not any("without value" in text or "of zero" in text for text in said)


def apart(summaries: Summaries, best: Method) -> Summaries:
    """As if one method matched better than the others beyond the intervals."""
    others = {method: with_fcp(own, 0.1, 0.08, 0.12) for method, own in summaries.items()}
    return {**others, best: with_fcp(summaries[best], 0.01, 0.005, 0.02)}


def marks(figure: go.Figure, column: int) -> dict[Method, str]:
    """What the titles of a column say of each panel: best, level, or nothing."""
    found: dict[Method, str] = {}
    for method in METHODS:
        axis = f"{axis_of(method, column)} domain"
        (title,) = (a.text for a in figure.layout.annotations if a.xref == axis)
        found[method] = next((m for m in ("best", "level") if f"· <b>{m}</b>" in title), "")
    return found


def test_the_panel_apart_from_the_others_is_framed_and_named(summaries: Summaries) -> None:
    figure = plot_validation(apart(summaries, "2d"))
    (frame,) = (shape for shape in figure.layout.shapes if shape.name == "best reprojection")
    assert frame.xref == f"{axis_of('2d', 2)} domain"
    assert (frame.x0, frame.x1, frame.y0, frame.y1) == (0, 1, 0, 1)
    assert marks(figure, 2) == {"essential": "", "2d": "best", "3d": ""}
    assert "(best)" in describe_validation(apart(summaries, "2d"))


def test_panels_that_cannot_be_told_apart_are_level_and_not_framed(summaries: Summaries) -> None:
    tied = {**apart(summaries, "2d"), "3d": with_fcp(summaries["3d"], 0.018, 0.015, 0.03)}
    figure = plot_validation(tied)
    assert not [shape for shape in figure.layout.shapes if shape.name == "best reprojection"]
    assert marks(figure, 2) == {"essential": "", "2d": "level", "3d": "level"}


def test_bars_that_cannot_be_reconstructed_are_said(summaries: Summaries) -> None:
    lost = {method: without_bars(summary) for method, summary in summaries.items()}
    figure = plot_validation(lost)
    assert sum("no bar could be measured" in text for text in texts(figure)) == 3
    assert not [shape for shape in figure.layout.shapes if shape.name == "best reconstruction"]
    assert marks(figure, 3) == dict.fromkeys(METHODS, "")
    assert len(figure.to_json()) > 1000
    assert "none" in describe_validation(lost)
    assert "no bar could be measured" in validation_answer(lost)
    table = validation_table(lost)["3D set"].to_dict()
    assert table["3D error of the bars, median (%)"] == "none"
    assert table["Bars counted"] == table["Bars without value"] != "0"
    compared = plot_comparison({"a": summaries, "b": lost})
    assert len(compared.to_json()) > 1000
    assert "none" in describe_comparison({"b": lost})


def test_comparison_shows_values_with_intervals(summaries: Summaries) -> None:
    by_dataset = {"first": summaries, "second <b>": dict(summaries)}
    figure = plot_comparison(by_dataset)
    drawn = trace(figure, "3D set", "x2")
    median = summaries["3d"].reconstruction.median
    np.testing.assert_allclose(drawn.y, [100 * median.value] * 2)
    np.testing.assert_allclose(drawn.y + drawn.error_y.array, [100 * median.high] * 2)
    np.testing.assert_allclose(drawn.y - drawn.error_y.arrayminus, [100 * median.low] * 2)
    assert list(figure.layout.xaxis.ticktext) == ["first", "second &lt;b&gt;"]
    assert "Over 2 data sets" in describe_comparison(by_dataset)


def test_a_comparison_draws_the_upper_limit_where_nothing_was_counted(summaries: Summaries) -> None:
    some = {**summaries, "2d": with_fcp(summaries["2d"], 0.01, 0.005, 0.02)}
    none = {**summaries, "2d": with_fcp(summaries["2d"], 0.0, 0.0, 0.004)}
    figure = plot_comparison({"some": some, "none": none})
    drawn = trace(figure, "2D set", "x")
    assert list(drawn.marker.symbol) == ["circle", "arrow-bar-down"]
    assert drawn.y[1] == pytest.approx(0.4)
    assert drawn.error_y.array[1] == drawn.error_y.arrayminus[1] == 0
    assert "below 0.40 %" in drawn.text[1]
    assert "upper limit, none counted (n = 1)" in figure.layout.yaxis.title.text
