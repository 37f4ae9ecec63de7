"""`python -m stereocal`, and `stereocal` if installed: runs a command at a terminal.

Handles Ctrl-C, closed pipes and ASCII-only terminals for all commands.
"""

import codecs
import os
import sys
import threading
from io import TextIOWrapper
from typing import TextIO

from stereocal.commands.console import say

INTERRUPTED = 130
CLOSED_PIPE = 141
"""Exit statuses that a shell reports after SIGINT and SIGPIPE."""
NO_OUTPUT = 2
"""Exit status if the output cannot be written, as on a full disk."""
IN_ASCII = {"±": "+-", "×": "x", "–": "-", "−": "-", "→": "->", "…": "...", "Δ": "Delta"}


def main() -> int:
    """Run the command; return its exit status."""
    _show_anywhere()
    try:
        status = _run()
    except BrokenPipeError:
        status = CLOSED_PIPE
    except OSError as error:  # of files, commands tell what is wrong themselves
        say(f"stereocal: the output cannot be written ({error.strerror or error}).")
        status = NO_OUTPUT
    except KeyboardInterrupt:
        say("stereocal: interrupted.")
        if _threads_at_work():  # in compiled code: Python would wait for them
            os._exit(INTERRUPTED)
        status = INTERRUPTED
    ended = [_flushed(stream) for stream in (sys.stdout, sys.stderr)]  # both, whatever the first
    return next(filter(None, ended), status)


def _run() -> int:
    # Imported here: it takes a second, in which Ctrl-C may come.
    from stereocal.cli import main as run_command

    try:
        return run_command()
    except SystemExit as ended:  # by argparse, after its message
        return int(ended.code or 0)


def _threads_at_work() -> bool:
    main_thread = threading.main_thread()
    return any(thread is not main_thread and not thread.daemon for thread in threading.enumerate())


def _flushed(stream: TextIO | None) -> int:
    """Flush the stream; the exit status if its reader has closed it, as in `| head -1`, or if its
    disk is full; else 0. A stream that was closed from the start is None."""
    if stream is None:
        return 0
    try:
        stream.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        if isinstance(error, BrokenPipeError):
            return CLOSED_PIPE
        say(f"stereocal: the output cannot be written ({error.strerror or error}).")
        return NO_OUTPUT
    return 0


def _show_anywhere() -> None:
    codecs.register_error("stereocal", _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="stereocal")


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """The replacement of characters that the terminal cannot show."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    return "".join(IN_ASCII.get(sign, "?") for sign in signs), error.end


if __name__ == "__main__":
    sys.exit(main())
