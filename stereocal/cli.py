"""`python -m stereocal`: what the dashboard does, from the command line."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stereocal.commands.progress import say
from stereocal.errors import StereocalError
from stereocal.rig.compilations import compilations
from stereocal.version import __version__

COMMANDS = {
    "calibrate": "calibrate",
    "evaluate": "evaluate",
    "import": "import_archive",
    "detect": "detect",
    "intrinsics": "intrinsics",
    "match": "match",
    "reconstruct": "reconstruct",
    "convert": "convert",
    "rig": "rig",
    "check": "check",
    "world": "world",
    "simulate": "simulate",
    "plan": "plan",
    "print": "print_files",
    "reproduce": "reproduce",
    "sample": "sample",
    "serve": "serve",
    "compile": "compiling",
}
"""Their files in `commands`; only that of the command in use is imported."""
EXTRA = ("matplotlib", "plotly", "reportlab", "streamlit")
"""What the extra `dashboard` brings and some commands need."""
INSTALL = "pip install 'stereocal[dashboard]'"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status, 2 after a message on stderr for invalid input."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        asked = words[0] if words and words[0] in COMMANDS else None
        parsed = _parser(asked).parse_args(words)
        with compilations(_announce):
            return int(parsed.run(parsed) or 0)
    except ModuleNotFoundError as error:
        if error.name not in EXTRA:
            raise
        say(f"stereocal: this needs {error.name}, which is not installed: {INSTALL}")
        return 2
    except StereocalError as error:
        say(f"stereocal: {error}")
        return 2


def _announce(compiled: int) -> None:
    if not compiled:
        say("Compiling once, which takes up to a minute.")


class _Parser(argparse.ArgumentParser):
    """A parser that takes no empty path: `Path("")` is the current folder."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.register("type", Path, _path)


def _path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("a path is missing: the text is empty")
    return Path(text)


def _parser(asked: str | None = None) -> argparse.ArgumentParser:
    """The parser of one command, or of all."""
    parser = _Parser(prog="stereocal", description=__doc__)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in [asked] if asked else COMMANDS:
        try:
            importlib.import_module(f"stereocal.commands.{COMMANDS[name]}").add(commands)
        except ModuleNotFoundError as error:
            if asked or error.name not in EXTRA:
                raise
            commands.add_parser(name, help=f"needs {error.name}: {INSTALL}")
    return parser
