"""The colours of two balls, as proposed from the first photographs."""

import pytest

from stereocal.detection.balls import proposed_colours
from stereocal.system.photograph import read_colours
from tests.ball_bars import COLOURS, ball_bars
from tests.bar_photographs import bar_set


def test_moving_balls_before_clutter() -> None:
    """Of 7 renderings before clutter of all hues, 7 were proposed right."""
    files, _ = ball_bars(6, 7)
    found = proposed_colours(
        [
            [read_colours(files[name], name) for name in sorted(files) if which in name][::2]
            for which in ("primary", "secondary")
        ]
    )
    assert found is not None
    for own, true in zip(found.colours, COLOURS.partition(":")[2].split(","), strict=True):
        # The lit side differs in brightness, not in hue.
        channels = [[int(text[at : at + 2], 16) for at in (1, 3, 5)] for text in (own, true)]
        a, b = ([value / max(each) for value in each] for each in channels)
        assert a == pytest.approx(b, abs=0.08)


def test_no_balls_are_proposed_for_other_bars() -> None:
    files = bar_set(7).files()
    names = sorted(files)
    images = [
        [read_colours(files[name], name) for name in names if which in name][:3]
        for which in ("left", "right")
    ]
    assert proposed_colours(images) is None
