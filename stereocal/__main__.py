"""`python -m stereocal`, and `stereocal` where it is installed: the commands at a terminal.

Ctrl-C, a closed pipe, and a terminal that shows ASCII only are met here for all commands.
"""

from __future__ import annotations

import codecs
import os
import sys
import threading
from io import TextIOWrapper
from typing import TextIO

from stereocal.commands.progress import say

INTERRUPTED = 130
CLOSED_PIPE = 141
"""What a shell reports of a program that SIGINT or SIGPIPE has ended."""
IN_ASCII = {"±": "+-", "×": "x", "–": "-", "−": "-", "→": "->", "…": "...", "Δ": "Delta"}


def main() -> int:
    """Run the command of the command line; its exit status."""
    _show_anywhere()
    try:
        status = _run()
    except BrokenPipeError:
        status = CLOSED_PIPE
    except KeyboardInterrupt:
        say("stereocal: interrupted.")
        if _threads_at_work():  # in compiled code: Python would wait for them
            os._exit(INTERRUPTED)
        status = INTERRUPTED
    return status if _is_read(sys.stderr) & _is_read(sys.stdout) else CLOSED_PIPE


def _run() -> int:
    # Here, since it takes a second, in which Ctrl-C may come.
    from stereocal.cli import main as run_command

    try:
        return run_command()
    except SystemExit as ended:  # by argparse, which has said why
        return int(ended.code or 0)


def _threads_at_work() -> bool:
    main_thread = threading.main_thread()
    return any(one is not main_thread and not one.daemon for one in threading.enumerate())


def _is_read(stream: TextIO) -> bool:
    """Write what is left; False, and it is dropped, if nobody reads it: `| head -1`."""
    try:
        stream.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return False
    return True


def _show_anywhere() -> None:
    codecs.register_error("stereocal", _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="stereocal")


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """What is written for signs that the terminal does not know."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    return "".join(IN_ASCII.get(sign, "?") for sign in signs), error.end


if __name__ == "__main__":
    sys.exit(main())
