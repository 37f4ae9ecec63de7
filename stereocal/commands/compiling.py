"""`stereocal compile`: compile all numba functions into the cache."""

from __future__ import annotations

import argparse

from stereocal.commands.progress import ProgressBar
from stereocal.commands.warming import compile_all


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The options of the command: none."""
    command = commands.add_parser(
        "compile", help="compile everything now, so that later commands start at once"
    )
    command.set_defaults(run=run)


def run(_: argparse.Namespace) -> None:
    """Compile, with a progress bar."""
    with ProgressBar("functions compiled") as bar:
        compiled = compile_all(bar.show)
    if not compiled:
        print("Everything is compiled already.")
