"""Every command and every script of the documentation runs, page by page, in order.

A page starts in an empty folder; the JSON files that it shows are there.
"""

import argparse
import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from stereocal.cli import COMMANDS, _parser, main
from tests.docs.pages import CANNOT_TELL, PAGES, code_of, name_of
from tests.docs.prepared import thin, videos
from tests.further import OF_A_WHOLE_SOAK
from tests.terminal import ROOT

OURS = re.compile(r"(?:\S*python -m )?stereocal (.*)")
NOT_RUN = {
    "make": "targets of the Makefile; that they are there is tested below",
    "pip": "tests/test_wheel.py installs the wheel",
    "python -m venv": "makes an environment",
    "stereocal-env/bin/pip": "tests/test_wheel.py installs the wheel",
    "stereocal serve": "serves until it is stopped; tests/browser/test_kills.py runs it",
    "python -m tools.photographs": "a minute; tests/tools renders some",
    "python -m tools.photographs.ball_sample": "half a minute; tests/tools renders a frame of it",
    "python -m tools.photographs.tank_sample": "half a minute; tests/tools renders a frame of it",
    "python -m tools.photographs.flight_sample": "tests/browser/test_clicks.py uses its videos",
    "docker": "needs Docker",
}
"""Beginnings of commands that are not run here, and why."""
TUTORIAL = "docs/tutorial.md"
QUOTED = {
    TUTORIAL: {
        "A length of 1 m will be right to 4.4 mm": "A length of 1 m is right to 4.4 mm",
        "3.9 mm relative to the bar": "Relative to the bar it is right to 3.9 mm",
        "± 0.4 mm until you say": "± 0.40 mm",
        "22 of the 409 frames": "calibrated with 387 frames",
        "0.61 % of wrong pairs": "0.61 % (0.26 to 1.4) of wrong pairs",
        "95 % of lengths in metres would be within 0.44 %": "in metres within 0.44 %",
        "relative to the bar 0.39 %": "lengths are within 0.39 %",
        "0.91 px": "match below 0.91 px",
        "407 of 409 points": "407 pairs in 409 frames",
        "1.8 px": "threshold of 1.84 px",
        CANNOT_TELL: CANNOT_TELL,
    }
}
"""Sentences of a page with figures, and those with the same figures that its commands print."""
ON_PAGES = {
    TUTORIAL: "stereocal match recording/points_primary.csv recording/points_secondary.csv "
    "--parameters results/parameters_refined.json --out refined.csv"
}
"""What the dashboard does on its pages where the commands of a page of the documentation differ."""
FIGURE = re.compile(r"\d[\d.]* (?:px|%|mm|degrees)")
NOT_COMPUTED = {"95 %"}
FEWER = {
    "calibrate": ["--runs", "6"],
    "evaluate": ["--runs", "6"],
    "intrinsics": ["--repeats", "4"],
    "plan": ["--rigs", "16"],
}
"""Options that make a command quick, on pages that quote no figures: the files are the same.

Samples are thinned there too.
"""
OF_RIGS = {"docs/howto/water.md"}
"""Pages whose `calibrate` makes no random splits: they run as they are."""
OTHERS = {"--env"}
"""Options of other programs."""
STUDY = re.compile(r"python -m (?:benchmarks|tools|tests)\.")


def commands_of(page: Path) -> Iterator[str]:
    """The lines of its blocks of `sh`."""
    for code in code_of(page):
        if code.language == "sh":
            yield from commands_in(code.text)


def commands_in(text: str) -> Iterator[str]:
    """The commands of a block, without comments."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.join(shlex.split(line, comments=True))
        ours = OURS.fullmatch(words)
        if words:
            yield words if ours is None else f"stereocal {ours[1]}"


def is_run(command: str) -> bool:
    """Whether a test of this file runs it."""
    return not any(command == start or command.startswith(f"{start} ") for start in NOT_RUN)


def as_command(arguments: str) -> list[str]:
    """The arguments of `main`."""
    return shlex.split(arguments.removeprefix("stereocal "), comments=True)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


WITH_COMMANDS = [page for page in PAGES if any(map(is_run, commands_of(page)))]
SLOW = {
    "docs/howto/started_by_hand.md": "tests/commands/test_sync.py, frames/test_by_motion.py",
    "docs/howto/photographs.md": "tests/commands/test_from_photographs.py takes its steps",
    "docs/howto/board.md": "tests/intrinsics/test_stereo_boards.py takes its steps",
    "docs/howto/rig.md": "tests/commands/test_rig.py takes its steps",
    "docs/tutorial.md": "tests/commands/test_cli.py and test_evaluate_command.py take its steps",
    "docs/photographs.md": "tests/commands/test_from_photographs.py takes its steps",
    "docs/paper_kit.md": "tests/paper_kit opens a kit",
}
"""Pages whose commands take seconds, which the soak runs, a short one those with figures; and what
does the same without a page."""


def marks_of(page: Path) -> list[pytest.MarkDecorator]:
    """The marks of a page's test."""
    if name_of(page) not in SLOW:
        return []
    return [pytest.mark.soak] if name_of(page) in QUOTED else OF_A_WHOLE_SOAK


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=marks_of(page)) for page in WITH_COMMANDS], ids=name_of
)
def test_its_commands_run(page: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for code in code_of(page):
        if code.language == "json" and code.file:
            (folder / code.file).write_text(code.text, encoding="utf-8")
    if name_of(page) == "docs/photographs.md":
        videos(folder)
    commands = [*filter(is_run, commands_of(page)), *filter(None, [ON_PAGES.get(name_of(page))])]
    for command in commands:
        assert command.startswith("stereocal "), f"run it here, or say why not: {command}"
        words, quoted = as_command(command), name_of(page) in QUOTED.keys() | OF_RIGS
        if not quoted and not {"--runs", "--repeats", "--rigs"} & {*words}:
            words += FEWER.get(words[0], [])
        assert main(words) == 0, command
        if words[0] == "sample" and not quoted:
            thin(folder / words[-1])
    printed = capsys.readouterr().out
    for says, prints in QUOTED.get(name_of(page), {}).items():
        assert prints in printed, (says, prints)


@pytest.mark.parametrize("name", QUOTED)
def test_each_figure_of_a_page_is_one_that_its_commands_print(name: str) -> None:
    text = " ".join((ROOT / name).read_text(encoding="utf-8").split())
    assert not [says for says in QUOTED[name] if says not in text]
    quoted = {figure for says in QUOTED[name] for figure in FIGURE.findall(says)}
    assert {*FIGURE.findall(text)} - NOT_COMPUTED <= quoted


@pytest.mark.parametrize(
    "page",
    [
        page
        for page in PAGES
        if page.name != "library.md"  # tests/test_library.py runs it, and looks at its results
        and any(code.language == "python" for code in code_of(page))
    ],
    ids=name_of,
)
@pytest.mark.usefixtures("folder")
def test_its_scripts_run(page: Path) -> None:
    assert main(["sample", "field", "--out", "field"]) == 0
    names: dict[str, object] = {}
    for code in code_of(page):
        if code.language == "python":
            exec(compile(code.text, page.name, "exec"), names)


def test_commands_are_of_the_program() -> None:
    """Also those with names in capitals for the files, which are not in a block of `sh`."""
    for page in WITH_COMMANDS:
        for command in filter(is_run, commands_of(page)):
            words = as_command(command)
            _parser(words[0]).parse_args(words)
    for page in PAGES:
        for code in code_of(page):
            if code.language == "":
                for line in map(str.strip, code.text.replace("\\\n", " ").splitlines()):
                    if OURS.match(line):
                        (command,) = commands_in(line)
                        words = as_command(command)
                        _parser(words[0]).parse_args(words)


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    """All options of a command and of those below it."""
    found: set[str] = set()
    for action in parser._actions:
        found.update(action.option_strings)
        if isinstance(action, argparse._SubParsersAction):
            found.update(*map(options_of, action.choices.values()))
    return found


def test_options_that_are_named_are_there() -> None:
    ours = set().union(*(options_of(_parser(name)) for name in COMMANDS))
    studies = "".join(path.read_text() for path in (ROOT / "benchmarks").glob("*.py"))
    of_studies = set(re.findall(r'"(--[a-z-]+)"', studies))
    for page in PAGES:
        inline = re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8"))
        others = [code for code in inline if not STUDY.match(code)]
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", " ".join(others)))
        known = ours | OTHERS | (of_studies if page.name == "trust.md" else set())
        assert named <= known or page.parent.name == "benchmarks", (name_of(page), named - known)


def test_targets_and_benchmarks_are_there() -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M))
    text = "\n".join(code.text for page in PAGES for code in code_of(page))
    made = set(re.findall(r"^ *make ([a-z]+)", text, re.M))
    assert {"run", "test", "docs"} <= made <= targets
    pages = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    measured = set(re.findall(r"python -m ((?:benchmarks|tools|tests)\.[\w.]+\w)", pages))
    assert len(measured) > 10
    assert not [name for name in measured if importlib.util.find_spec(name) is None]
