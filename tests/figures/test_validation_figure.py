"""The figure and the report of a validation have the numbers of its summaries, and the story of the
Start page those of its sets."""

import math
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from html import unescape
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs

from stereocal import __version__
from stereocal.calibration.methods import METHODS, CalibrationSettings, Method
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts, evaluate
from stereocal.evaluation.summary import FEWEST_RUNS, Estimate, MethodSummary, Pdf, summarise
from stereocal.figures.comparison import describe_comparison, plot_comparison
from stereocal.figures.report import report_html
from stereocal.figures.story import ROWS, Story, plot_story_lengths, plot_story_lines, read_story
from stereocal.figures.style import METHOD_COLOURS, METHOD_NAMES
from stereocal.figures.tables import validation_table
from stereocal.figures.two_sets import describe_two_sets, frame_views, telling_frame
from stereocal.figures.validation import describe_validation, plot_validation
from stereocal.formats.dataset_files import read_dataset
from stereocal.rig.pair import Pair
from stereocal.system.settings import descriptions
from stereocal.verdict.in_words import percent
from stereocal.verdict.recommendation import recommend
from stereocal.verdict.validation_in_words import validation_answer
from tests.sample_field import FIELD, calibrated_field
from tools.story import STORY, tell_story

SETTINGS = EvaluationSettings(CalibrationSettings(essential="linear"), runs=FEWEST_RUNS)
NAN = float("nan")
TIED = "no clear winner"
Summaries = dict[Method, MethodSummary]


@cache
def runs_twice() -> list[list[RunCounts]]:
    """The runs of the sample, and again as a second data set."""
    dataset = read_dataset(FIELD)
    with ThreadPoolExecutor(2) as executor:
        return 2 * evaluate([dataset], SETTINGS, executor)


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
    np.testing.assert_allclose(drawn.y, 100 * pdf.shares[at])
    assert np.sum(drawn.y) == pytest.approx(100 * pdf.shares.sum())
    assert 95 < np.sum(drawn.y) < 100.001  # % of all values
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
        wanted = f"FCP <b>{percent(fcp.value)} %</b> {interval}"
        counts = f"n = {n.correct.n:,} correct, {n.wrong.n:,} wrong"
        assert any(wanted in text and counts in text for text in said)
        median = f"median <b>{percent(summary.reconstruction.median.value)} %</b>"
        assert any(median in text for text in said)
    assert not any("without value" in text or "of zero" in text for text in said)


def apart(summaries: Summaries, best: Method) -> Summaries:
    """As if one method matched better than the others beyond the intervals."""
    others = {method: with_fcp(own, 0.1, 0.08, 0.12) for method, own in summaries.items()}
    return {**others, best: with_fcp(summaries[best], 0.01, 0.005, 0.02)}


def marks(figure: go.Figure, column: int) -> dict[Method, str]:
    """What the titles of a column say of each panel: best, no clear winner, or nothing."""
    found: dict[Method, str] = {}
    for method in METHODS:
        axis = f"{axis_of(method, column)} domain"
        (title,) = (a.text for a in figure.layout.annotations if a.xref == axis)
        found[method] = next((m for m in ("best", TIED) if f"<b>{m}</b>" in title), "")
    return found


def test_the_panel_apart_from_the_others_is_framed_and_named(summaries: Summaries) -> None:
    figure = plot_validation(apart(summaries, "2d"))
    (frame,) = (shape for shape in figure.layout.shapes if shape.name == "best reprojection")
    assert frame.xref == f"{axis_of('2d', 2)} domain"
    assert (frame.x0, frame.x1, frame.y0, frame.y1) == (0, 1, 0, 1)
    assert marks(figure, 2) == {"essential": "", "2d": "best", "3d": ""}
    assert "(best)" in describe_validation(apart(summaries, "2d"))


def test_panels_that_cannot_be_told_apart_are_not_framed(summaries: Summaries) -> None:
    tied = {**apart(summaries, "2d"), "3d": with_fcp(summaries["3d"], 0.018, 0.015, 0.03)}
    figure = plot_validation(tied)
    assert not [shape for shape in figure.layout.shapes if shape.name == "best reprojection"]
    assert marks(figure, 2) == {"essential": "", "2d": TIED, "3d": TIED}


def test_of_few_runs_there_are_no_intervals_and_no_marks(summaries: Summaries) -> None:
    """In the figure, its words, the table, the comparison and the report; nor is a set said to be
    better than that made for the job."""
    few = {method: replace(own, runs=FEWEST_RUNS - 1) for method, own in summaries.items()}
    few = apart(few, "essential")
    figure = plot_validation(few)
    compared = {"one": few, "two": few}
    shown = [*texts(figure), describe_validation(few), validation_table(few).to_string()]
    shown += [text for trace in plot_comparison(compared).data for text in trace.text]
    assert not [
        text for text in shown if re.search(r"\d to \d|<b>best|\(best\)|best, |winner", text)
    ]
    assert not figure.layout.shapes
    assert not [trace for trace in figure.data if "best" in str(trace.name)]
    assert f"Fewer than {FEWEST_RUNS} runs" in describe_validation(few)
    assert "with the 2D set below" in validation_answer(few)
    settings = replace(SETTINGS, runs=FEWEST_RUNS - 1)
    report = report_html(few, {}, [read_dataset(FIELD)], settings)
    assert "95 % bootstrap" not in report and "there are no intervals" in report
    assert few["2d"].to_json() == apart(summaries, "essential")["2d"].to_json()
    again = apart(summaries, "essential")
    assert "with the essential matrix below" in validation_answer(again)


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


EVIL = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def dataset() -> Pair:
    return read_dataset(FIELD)


@pytest.fixture(scope="module")
def pooled() -> Summaries:
    return summarise(runs_twice())


@pytest.fixture(scope="module")
def by_dataset() -> dict[str, Summaries]:
    return {EVIL: summarise(runs_twice()[:1]), "second": summarise(runs_twice()[1:])}


@pytest.fixture(scope="module")
def report(pooled: Summaries, by_dataset: dict[str, Summaries], dataset: Pair) -> str:
    """Without Plotly's own code."""
    named = [dataset.changed(name=EVIL, notes="<img src=x>"), dataset.changed(name="second")]
    text = report_html(pooled, by_dataset, named, SETTINGS)
    assert text.count(get_plotlyjs()) == 1
    return text.replace(get_plotlyjs(), "")


def test_nothing_is_fetched_from_elsewhere_and_names_and_notes_are_escaped(report: str) -> None:
    assert not re.search(r"https?://", report)
    assert not re.search(r"<script[^>]*\ssrc|<link|<img|@import|url\(", report)
    assert EVIL not in report
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in report
    assert "&lt;img src=x&gt;" in report


def test_the_words_of_the_figures_are_in_it(
    report: str, pooled: Summaries, by_dataset: dict[str, Summaries]
) -> None:
    text = unescape(report)
    assert validation_answer(pooled) in text
    assert describe_validation(pooled) in text
    assert describe_comparison(by_dataset) in text


def test_data_settings_angles_and_versions_are_in_it(
    report: str, pooled: Summaries, dataset: Pair
) -> None:
    assert dataset.sha256 in report
    assert "<td>25</td><td>50</td><td>25</td><td>4.5 m</td><td>0.9 m</td>" in report
    about = descriptions(EvaluationSettings)
    for name, value in SETTINGS.to_json().items():
        shown = {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
        shown = "none" if value is None or value == [] else shown
        assert f'<th scope="row">{about[name].title}</th><td>{shown}</td>' in report
    found = pooled["3d"]
    for mean, spread in zip(found.angle_means.flat, found.angle_spreads.flat, strict=True):
        assert f"{math.degrees(mean):.4f} ± {math.degrees(spread):.4f}" in report
    assert f'<th scope="row">stereocal</th><td>{__version__}</td>' in report


def test_the_recommendation_comes_first_with_the_frame_that_shows_why(dataset: Pair) -> None:
    calibration, summaries = calibrated_field(), summarise(runs_twice()[:1])
    recommendation = recommend(calibration, None)
    found = calibration, recommendation
    text = unescape(report_html(summaries, {}, [dataset], SETTINGS, recommended=found))
    assert recommendation.text in text.split("<h2>")[0]
    frame = telling_frame(calibration)
    assert f"Frame {frame}. {describe_two_sets(frame_views(calibration, frame))}" in text


@pytest.fixture(scope="module")
def story() -> Story:
    return read_story(STORY)


def test_the_numbers_are_what_the_command_computes(story: Story) -> None:
    """Other processors round otherwise; the 3D search then ends elsewhere along the directions that
    lengths leave almost free, where lengths are the same and epipolar lines are not."""
    again = tell_story()
    assert (again.fitted, again.sets.keys()) == (story.fitted, story.sets.keys())
    for method, found in story.sets.items():
        other = again.sets[method]
        assert other.length_error == pytest.approx(found.length_error, rel=0.02)
        assert len(other.length_errors) == len(found.length_errors) == 204
        if method != "3d" and again.frame == story.frame:
            assert other.reprojection_px == pytest.approx(found.reprojection_px, rel=0.02)
            assert other.line_distance_px == pytest.approx(found.line_distance_px, rel=0.1)
            assert other.gap_m == pytest.approx(found.gap_m, rel=0.1)


def test_three_steps(story: Story) -> None:
    """Measured: 1.19, 0.231 and 0.137 %; 0.159, 4.6 and 0.137 px."""
    book, two, refined = (story.sets[name].length_error for name in ("essential", "3d", "refined"))
    assert 0.010 < book < 0.013
    assert 0.0020 < two < 0.0025
    assert 0.0012 < refined < 0.0015
    matching = {name: found.reprojection_px for name, found in story.sets.items()}
    assert matching["refined"] < matching["2d"] < 0.2
    assert matching["3d"] > 10 * matching["2d"]
    assert story.sets["3d"].gap_m > 10 * story.sets["2d"].gap_m


def test_each_bar_is_a_dot_and_each_set_a_line(story: Story) -> None:
    dots = [trace for trace in plot_story_lengths(story).data if trace.mode == "markers"]
    for trace, method in zip(dots, ROWS, strict=True):
        np.testing.assert_allclose(trace.x, 100 * np.array(story.sets[method].length_errors))
    lines = [trace for trace in plot_story_lines(story).data if trace.mode == "lines"]
    assert len(lines) == len(story.sets)
