"""`python -m stereocal`: what the dashboard does, from the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stereocal.commands import (
    calibrate,
    check,
    compiling,
    convert,
    detect,
    evaluate,
    import_archive,
    intrinsics,
    match,
    plan,
    print_files,
    reconstruct,
    reproduce,
    sample,
    serve,
    simulate,
    world,
)
from stereocal.commands.progress import say
from stereocal.errors import StereocalError
from stereocal.rig.compilations import compilations
from stereocal.version import __version__

COMMANDS = (
    calibrate,
    evaluate,
    import_archive,
    detect,
    intrinsics,
    match,
    reconstruct,
    convert,
    check,
    world,
    simulate,
    plan,
    print_files,
    reproduce,
    sample,
    serve,
    compiling,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status, 2 after a message on stderr for invalid input."""
    parsed = _parser().parse_args(arguments)
    try:
        with compilations(_announce):
            return int(parsed.run(parsed) or 0)
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


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="stereocal", description=__doc__)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
