"""`stereocal compile`: compile all numba functions into the cache."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from stereocal.commands.progress import ProgressBar
from stereocal.commands.warming import compile_all


def add(_: argparse.ArgumentParser) -> None:
    """The options of the command: none."""


def run(_: argparse.Namespace) -> None:
    """Compile, with a progress bar."""
    with ProgressBar("functions compiled") as bar:
        compiled = compile_all(bar.show)
    if not compiled:
        print("Everything is compiled already.")


def compile_apart() -> None:
    """Compile what is not in the cache, in a process of its own.

    A process that has compiled functions rounds otherwise than those that load them, because the
    same function was optimised in several places: after 29 steps a refined pose differs by 1e-8.
    """
    command = [sys.executable, "-m", "stereocal", "compile"]
    package = Path(__file__).parents[2]
    subprocess.run(command, cwd=package, stdout=subprocess.DEVNULL, check=False)
