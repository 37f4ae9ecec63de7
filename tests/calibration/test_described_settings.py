"""A setting is described once: its option, its bounds, its JSON and its widget agree."""

import argparse

import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.commands.console import take
from stereocal.commands.options import SEARCH, settings_from
from stereocal.system.records import of_plain, plain
from stereocal.system.settings import asked
from tests.refused import refused

OPTIONS = {
    "delta": "--delta",
    "delta_min": "--delta-min",
    "acceptance": "--acceptance",
    "shrink": "--shrink",
    "minimum_moves": "--minimum-moves",
    "seed": "--seed",
    "essential": "--essential",
    "all_frames": "--all-frames",
    "frames_put_back": "--put-back",
    "frames_left_out": "--leave-out",
    "time_offset": "--time-offset",
    "time_drift": "--time-drift",
}
"""What scripts write on the command line."""


def parsed(*words: str) -> CalibrationSettings:
    parser = argparse.ArgumentParser()
    take(parser, SEARCH)
    parser.set_defaults(known_points=False)
    return settings_from(parser.parse_args(words), None)


def test_the_options_are_those_that_scripts_write() -> None:
    parser = argparse.ArgumentParser()
    take(parser, SEARCH)
    found = {each.dest: each.option_strings for each in parser._actions if each.dest != "help"}
    assert found == {name: [option] for name, option in OPTIONS.items()}


def test_without_options_the_defaults() -> None:
    assert parsed() == CalibrationSettings()


def test_each_option_sets_its_setting() -> None:
    search = SearchSettings(0.01, 1e-5, 0.3, 0.5, 7, seed=9)
    words = "--delta 0.01 --delta-min 1e-5 --acceptance 0.3 --shrink 0.5 --minimum-moves 7 --seed 9"
    assert parsed(*words.split()) == CalibrationSettings(search)
    wanted = CalibrationSettings(
        essential="linear",
        all_frames=True,
        frames_put_back=(2, 3),
        frames_left_out=(4,),
        time_offset=True,
        time_drift=True,
    )
    words = "--essential linear --all-frames --put-back 3 2 --leave-out 4 --time-drift"
    assert parsed(*words.split()) == wanted
    assert CalibrationSettings.from_json(wanted.to_json()) == wanted


@pytest.mark.parametrize("name", asked(SearchSettings))
def test_the_bounds_hold_where_they_are_described(name: str) -> None:
    about = asked(SearchSettings)[name]
    kind = type(about.default)
    for outside in (about.low - (about.low or 1), about.high * 2 + 1):
        with refused(f"{name} ", kind(outside), f"{about.high:g}"):
            SearchSettings(**{name: kind(outside)})


def test_settings_that_were_not_stated_are_written_with_their_defaults() -> None:
    """msgspec alone leaves them out: files then did not state `maximum_moves`."""
    read = of_plain({"search": {"seed": 3}}, CalibrationSettings)
    assert plain(read)["search"]["maximum_moves"] == CalibrationSettings().search.maximum_moves
    assert plain(read).keys() == plain(CalibrationSettings()).keys()
