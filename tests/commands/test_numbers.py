"""Every numeric option of every command, with numbers that nothing can be computed with."""

import argparse
import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import chdir
from pathlib import Path

import pytest

from stereocal.cli import COMMANDS, _parser, main
from stereocal.commands.console import Number
from tests.sample_field import calibrated_field
from tests.terminal import FIELD, ROOT, sentences, tables

SAMPLES = ROOT / "sample_data"
DIGITS = "9" * 400
VALUES = ("0", "-1", "1e-320", "1e308", "inf", "nan", DIGITS)
LONG = ("calibrate", "evaluate", "intrinsics", "plan", "detect", "rig", "simulate", "serve")
"""Commands that are not run at the ends of what an option takes."""
MANY = ("--workers",)
"""Options whose upper end would start as many processes."""
NEW = f"parameters_refined.json {FIELD} --out out"
WORLD = SAMPLES / "world"
SURVEY = f"{WORLD}/survey.csv --parameters {WORLD}/parameters_3d.json --out out.json"
WORDS = {
    "calibrate": f"{FIELD} --no-refined --runs 0 --out out",
    "evaluate": f"{FIELD} --no-refined --runs 2 --out out",
    "import": f"{SAMPLES}/archives/wand.csv {SAMPLES}/archives/camchain.yaml --distance 0.87 "
    "--out out",
    "detect": f"{FIELD} --out out.csv",
    "intrinsics": "none --board 9x6 --square 0.03 --out out.json",
    "match": "primary.csv secondary.csv --parameters parameters_2d.json --out out.csv",
    "reconstruct": "pairs.csv --parameters parameters_2d.json --out out.csv",
    "convert": "parameters_2d.json --to dlt --out out",
    "rig": "none --out out",
    "check": "parameters_refined.json pairs.csv --out out",
    "world": f"{WORLD}/throw.csv --parameters {WORLD}/parameters_3d.json "
    "--frame-rate 50 --out out.json",
    "simulate": "--datasets 1 --frames 1 --out out",
    "plan": "none.json --out out",
    "print target": "--focal 1000 --far 1 --out out.svg",
    "print board": "--board 9x6 --square 0.02 --charuco DICT_4X4_50 --marker 0.01 --out out.svg",
    "print tags": "--target tags:4X4_50:3,7 --side 0.1 --out out.svg",
    "print sheet": "none.json --out out.pdf",
    "serve": "",
}
"""Of each command with numeric options, on little data."""
BY_HAND = f"{WORDS['match']} --layout columns --columns frame u v"
PICKED = {
    "print target --side": "--out out.svg",
    **dict.fromkeys((f"check --{name}-sigma" for name in ("baseline", "distance")), NEW),
    "world --survey-sigma": SURVEY,
    **{f"match --{name}": BY_HAND for name in ("first-pixel", "px-per-unit", "least-likelihood")},
}
"""Of options that do not go with the others."""


def of_command(name: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The parsers of a command, or of its kinds."""
    (commands,) = _parser(name)._subparsers._group_actions  # type: ignore[union-attr]
    parser = commands.choices[name]  # type: ignore[index]
    kinds = [own for own in parser._actions if isinstance(own, argparse._SubParsersAction)]
    yield from (
        ((f"{name} {kind}", own) for each in kinds for kind, own in each.choices.items())
        if kinds
        else [(name, parser)]
    )


PARSERS = {words: parser for name in COMMANDS for words, parser in of_command(name)}
NUMERIC = [
    (words, action)
    for words, parser in PARSERS.items()
    for action in parser._actions
    if isinstance(action.type, Number)
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with parameters and tables of points."""
    made = tmp_path_factory.mktemp("numbers")
    tables(made)
    calibrated_field().parameters("refined").save(made / "parameters_refined.json")
    return made


def test_every_number_has_bounds() -> None:
    """A number without them would be read by `int` or `float`."""
    of_type = {
        f"{words} {action.option_strings}"
        for words, parser in PARSERS.items()
        for action in parser._actions
        if action.type in (int, float)
    }
    assert of_type == set()
    assert {words for words, _ in NUMERIC} == {*WORDS}
    assert len(NUMERIC) == 80


def ended(words: Sequence[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """The exit status of a command: 0, or 2 with one sentence beside usage and progress."""
    with chdir(folder):
        try:
            status = main(words)
        except SystemExit as of_argparse:
            status = int(of_argparse.code or 0)
    shutil.rmtree(folder / "out", ignore_errors=True)
    lines = sentences(capsys.readouterr().err)
    said = [line for line in lines if line.startswith("stereocal")]
    assert (status, len(said)) in ((0, 0), (2, 1)), (words, status, said)
    return status


@pytest.mark.parametrize(
    ("command", "action"),
    NUMERIC,
    ids=[f"{words} {action.option_strings[-1]}" for words, action in NUMERIC],
)
def test_its_numbers(
    command: str, action: argparse.Action, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    option, number = action.option_strings[-1], action.type
    assert isinstance(number, Number)
    base = PICKED.get(f"{command} {option}", WORDS[command]).split()
    ends = () if command in LONG or option in MANY else (repr(number.low), repr(number.high))
    for value in (*VALUES, *ends):
        several = action.nargs if isinstance(action.nargs, int) else 1
        for at in range(several):  # beside a usual one
            values = ["1"] * several
            values[at] = value
            words = [*command.split(), *base, option, *values]
            status = ended(words, folder, capsys)
            if value == DIGITS and number.high < math.inf:
                assert status == 2


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize(
    "words",
    [
        f"import {WORDS['import']} --image-size 1280x{{}}",
        f"match {BY_HAND} --cameras {{}},2",
        "print board --board {}x6 --square 0.02 --out out.svg",
        "print tags --target tags:4X4_50:{},7 --side 0.1 --out out.svg",
        f"detect {FIELD} --target board:9x6:{{}} --out out.csv",
        "intrinsics none --board 9x{} --square 0.03 --out out.json",
    ],
)
def test_numbers_within_a_text(
    words: str, value: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ended(words.format(value).split(), folder, capsys)
