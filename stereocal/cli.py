"""`python -m stereocal`: what the dashboard does, from the command line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from stereocal import __version__
from stereocal.commands import (
    calibrate,
    check,
    compiling,
    convert,
    detect,
    evaluate,
    intrinsics,
    match,
    plan,
    print_files,
    reconstruct,
    serve,
    simulate,
    world,
)
from stereocal.commands.progress import say
from stereocal.errors import StereocalError
from stereocal.rig.compilations import compilations

COMMANDS = (
    calibrate, evaluate, detect, intrinsics, match, reconstruct, convert, check, world, simulate,
    plan, print_files, serve, compiling,
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return 0, or 2 after a message on stderr for invalid input."""
    parsed = _parser().parse_args(arguments)
    try:
        with compilations(_announce):
            parsed.run(parsed)
    except StereocalError as error:
        say(f"stereocal: {error}")
        return 2
    return 0


def _announce(compiled: int) -> None:
    if not compiled:
        say("Compiling once, which takes up to a minute.")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="stereocal", description=__doc__)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
