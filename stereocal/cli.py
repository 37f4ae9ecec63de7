"""`python -m stereocal`: what the dashboard does, from the command line."""

import argparse
import importlib
import sys
from collections.abc import Sequence

from stereocal.commands.console import Parser, say, take
from stereocal.errors import PointsOutsideError, StereocalError
from stereocal.rig.compiled import compilations
from stereocal.version import __version__

COMMANDS = {
    "calibrate": ("calibrate", "the parameter files of a data set"),
    "evaluate": ("evaluate", "FCP and 3D error over random splits"),
    "import": ("import_archive", "a data set from the files of other programs"),
    "detect": ("detect", "the targets in photographs, as a table of points"),
    "intrinsics": ("intrinsics", "the lens, from photographs or a video of a board"),
    "match": ("match", "which points of the two cameras belong together"),
    "reconstruct": ("reconstruct", "3D points of matched pairs"),
    "convert": ("convert", "parameters to and from the formats of other programs"),
    "rig": ("rig", "one rig of three cameras and more"),
    "sync": ("sync", "bring cameras that were started by hand into step"),
    "check": ("check", "has a camera moved? repaired parameters if so"),
    "world": (
        "world",
        "a world frame with a known vertical: from surveyed points, lines, or a throw",
    ),
    "simulate": ("simulate", "the synthetic sample data"),
    "plan": ("plan", "what a planned field day will measure"),
    "print": ("print_files", "targets, boards and a field sheet to print"),
    "sample": ("sample", "data to try the commands with"),
    "serve": ("serve", "the dashboard, in a browser"),
    "compile": ("warming", "compile everything now, so that later commands start at once"),
}
"""Their files in `commands`, of which only that in use is imported; and their help."""
EXTRA = ("plotly", "reportlab", "streamlit")
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
        if isinstance(error, PointsOutsideError):
            from stereocal.fit.readings.outside import with_cause

            error = with_cause(error)
        say(f"stereocal: {error}{f' Use {error.option}.' if error.option else ''}")
        return 2


def _announce(compiled: int) -> None:
    if not compiled:
        say("Compiling once, which takes up to a minute.")


def _parser(asked: str | None = None) -> argparse.ArgumentParser:
    """The parser, with the options of one command."""
    needs = f"Reports, printed sheets and serve need more: {INSTALL}"
    parser = Parser(prog="stereocal", description=__doc__, epilog=needs)
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (file, help_text) in COMMANDS.items():
        command = commands.add_parser(name, help=help_text)
        if name == asked:
            module = importlib.import_module(f"stereocal.commands.{file}")
            known = vars(module)
            take(command, known.get("OPTIONS", {}))
            command.set_defaults(run=module.run, **known.get("DEFAULTS", {}))
            if "add" in known:
                module.add(command)
    return parser
