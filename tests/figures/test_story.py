"""The story of the Start page: its numbers are the recording's, and its figures show them."""

from __future__ import annotations

import numpy as np
import pytest

from stereocal.figures.story import ROWS, Story, plot_story_lengths, plot_story_lines, read_story
from tools.story import STORY, tell_story


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
