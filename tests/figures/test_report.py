"""The report of a validation and the story of the Start page have every number."""

import math
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from stereocal import __version__
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.evaluation.summary import summarise
from stereocal.figures.comparison import describe_comparison
from stereocal.figures.report import report_html
from stereocal.figures.story import ROWS, Story, plot_story_lengths, plot_story_lines, read_story
from stereocal.figures.two_sets import describe_two_sets, frame_views, telling_frame
from stereocal.figures.validation import describe_validation
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.rig.dataset import Dataset
from stereocal.system.settings import descriptions
from stereocal.verdict.recommendation import recommend
from stereocal.verdict.validation_in_words import validation_answer
from tests.figures.test_validation_figure import SAMPLE, SETTINGS, Summaries, runs_twice
from tools.story import STORY, tell_story

EVIL = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return read_dataset(SAMPLE)


@pytest.fixture(scope="module")
def summaries() -> Summaries:
    return summarise(runs_twice())


@pytest.fixture(scope="module")
def by_dataset() -> dict[str, Summaries]:
    return {EVIL: summarise(runs_twice()[:1]), "second": summarise(runs_twice()[1:])}


@pytest.fixture(scope="module")
def report(summaries: Summaries, by_dataset: dict[str, Summaries], dataset: Dataset) -> str:
    """Without Plotly's own code."""
    named = [replace(dataset, name=EVIL, notes="<img src=x>"), replace(dataset, name="second")]
    text = report_html(summaries, by_dataset, named, SETTINGS)
    assert text.count(get_plotlyjs()) == 1
    return text.replace(get_plotlyjs(), "")


def test_nothing_is_fetched_from_elsewhere_and_names_and_notes_are_escaped(report: str) -> None:
    assert not re.search(r"https?://", report)
    assert not re.search(r"<script[^>]*\ssrc|<link|<img|@import|url\(", report)
    assert EVIL not in report
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in report
    assert "&lt;img src=x&gt;" in report


def test_the_words_of_the_figures_are_in_it(
    report: str, summaries: Summaries, by_dataset: dict[str, Summaries]
) -> None:
    text = unescape(report)
    assert validation_answer(summaries) in text
    assert describe_validation(summaries) in text
    assert describe_comparison(by_dataset) in text


def test_data_settings_angles_and_versions_are_in_it(
    report: str, summaries: Summaries, dataset: Dataset
) -> None:
    assert dataset.sha256 in report
    assert "<td>25</td><td>50</td><td>25</td><td>4.5 m</td><td>0.9 m</td>" in report
    about = descriptions(EvaluationSettings)
    for name, value in SETTINGS.to_json().items():
        shown = {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
        shown = "none" if value is None or value == [] else shown
        assert f'<th scope="row">{about[name].title}</th><td>{shown}</td>' in report
    found = summaries["3d"]
    for mean, spread in zip(found.angle_means.flat, found.angle_spreads.flat, strict=True):
        assert f"{math.degrees(mean):.4f} ± {math.degrees(spread):.4f}" in report
    assert f'<th scope="row">stereocal</th><td>{__version__}</td>' in report


def test_the_recommendation_comes_first_with_the_frame_that_shows_why(dataset: Dataset) -> None:
    calibration, summaries = calibrate(dataset), summarise(runs_twice()[:1])
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
