"""The options of commands as tables, the parser that takes them, and what commands print."""

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

from stereocal.system.numbers import POSSIBLE_M, POSSIBLE_PX

T = TypeVar("T")
Show = Callable[[int, int], None]
"""How much is done, of how much."""
Options = Mapping[str, Any]
"""Options as the help spells them, with their help, or with all that argparse is told.

`--frames N` takes a value, `--kit` is a switch, `--no-drag` one that makes `drag` false, and `plan`
a file; `FILE...` stands for one or more. Under `ONE_OF` are options of which one must be given,
under a name with a colon a group.
"""
ONE_OF = "one of"
LONGEST = 40
"""Characters of what was typed, in a message."""


@dataclass(frozen=True)
class Number:
    """A number within bounds, as the type of an option; or a word instead."""

    kind: Callable[[str], float]
    """int or float."""
    low: float
    high: float
    word: str = ""

    def __call__(self, text: str) -> float | str:
        """Raise an `ArgumentTypeError` for anything else."""
        if self.word and text == self.word:
            return text
        with suppress(ValueError):  # no number, or one of too many digits
            if self.low <= (value := self.kind(text)) <= self.high:
                return value
        whole = "a whole number" if self.kind is int else "a number"
        other = f", or {self.word}" if self.word else ""
        between = f"{_exact(self.low)} to {_exact(self.high)}"
        raise argparse.ArgumentTypeError(f"{text[:LONGEST]!r} is not {whole} from {between}{other}")


def _exact(bound: float) -> str:
    return f"{bound:,}" if isinstance(bound, int) else f"{bound:.12g}"


KINDS: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("K", "N"), Number(int, 1, 10**9)),
    **dict.fromkeys(("B", "D", "M", "S"), Number(float, *POSSIBLE_M)),
    **dict.fromkeys(("NEAR", "FAR"), Number(float, 0.0, math.inf)),
    "DEG": Number(float, -360.0, 360.0),
    "FPS": Number(float, 1e-3, 1e6),
    "FRACTION": Number(float, 1e-9, 1 - 1e-9),
    "P": Number(float, 0.0, 1e6),
    "PX": Number(float, *POSSIBLE_PX),
    **dict.fromkeys(("ADDRESS", "CAMERA", "COLUMN", "DICT", "FRAME", "KIND", "NAME", "ROLES"), str),
    **dict.fromkeys(("LEFT-RIGHT", "P,S", "WxH", "18x12"), str),
}
"""What a value is, by its name in the help; else a file."""


def take(to: argparse._ActionsContainer, options: Options) -> None:
    """Add options, as `Options` spells them, to a parser or a group; `--out` is required."""
    for spelled, described in options.items():
        if spelled == ONE_OF:
            take(to.add_mutually_exclusive_group(required=True), described)
            continue
        if spelled.endswith(":"):
            take(to.add_argument_group(spelled[:-1]), described)
            continue
        name, *placeholders = spelled.removesuffix("...").split()
        arguments: dict[str, Any] = {"required": True} if name == "--out" else {}
        if name.startswith("--no-"):
            arguments |= {"dest": name.removeprefix("--no-"), "action": "store_false"}
        if spelled.endswith("..."):
            arguments["nargs"] = "+"
        arguments |= {"help": described} if isinstance(described, str) else described
        if len(placeholders) > 1:
            arguments |= {"nargs": len(placeholders), "metavar": tuple(placeholders)}
        elif placeholders:
            arguments["metavar"] = placeholders[0]
        takes_value = bool(placeholders) or not name.startswith("-")
        if takes_value:
            kind = KINDS.get(placeholders[0], Path) if placeholders else Path
            arguments.setdefault("type", kind)
        elif not arguments.keys() & {"action", "choices", "type"}:
            arguments["action"] = "store_true"
        to.add_argument(name, **arguments)


class Parser(argparse.ArgumentParser):
    """A parser that takes options between files, and no empty path: `Path("")` is the current
    folder."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.register("type", Path, _path)
        self._intermixed = False

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """The arguments, as of argparse, which calls this for each command."""
        if self._intermixed or self._subparsers is not None:
            return super().parse_known_args(args, namespace)
        self._intermixed = True  # it calls this function
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._intermixed = False


def _path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("a path is missing: the text is empty")
    return Path(text)


def say(line: str) -> None:
    """Write a line to stderr, below an open progress bar."""
    ProgressBar.end_line()
    _write(f"{line}\n")


def _write(text: str) -> None:
    with suppress(OSError):  # a closed pipe must not end the work
        print(text, end="", file=sys.stderr, flush=True)


def report(
    *lines: str, notes: Iterable[str | None] = (), written: Iterable[Path | None] = ()
) -> None:
    """Print what a command has found, its notes but empty ones, and its files, a line each."""
    remarks = (f"Note: {note}" for note in notes if note)
    for line in (*lines, *remarks, *(f"wrote {path}" for path in written if path)):
        print(line)


def with_bar(what: str, work: Callable[[Show], T]) -> T:
    """The result of long work, with a progress bar."""
    return in_stages(lambda _, show: work(show), what)


def in_stages(work: Callable[[Callable[[str], None], Show], T], first: str = "") -> T:
    """The same with a bar for each stage of the work, which names them."""
    with ProgressBar(first) as bar:
        return work(bar.begin, bar.show)


class ProgressBar:
    """A progress bar on stderr with the time left; as a context it ends its line.

    Where stderr is no terminal, such as the log of a batch system, a stage has one line, begun when
    it starts and ended with the time that it took.
    """

    on_line = False
    """Whether the current line of stderr shows a bar, or a stage that goes on."""

    def __init__(self, what: str) -> None:
        self.begin(what)

    def begin(self, what: str) -> None:
        """Start at nothing done."""
        self.end_line()
        self.what, self.started, self.drawn = what, time.monotonic(), 0.0

    @staticmethod
    def end_line() -> None:
        """Leave the line of a bar, if there is one."""
        if ProgressBar.on_line:
            ProgressBar.on_line = False
            _write("\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end_line()

    def show(self, done: int, total: int) -> None:
        """Draw the bar, at most ten times a second; the last call ends the line."""
        if not sys.stderr.isatty():
            self._log(done, total)
            return
        if done < total and time.monotonic() - self.drawn < 0.1:
            return
        self.drawn = time.monotonic()
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        time_left = f", {left:.0f} s left" if done else ""
        filled = 30 * done // total
        line = f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}{time_left}"
        ProgressBar.on_line = True
        _write(f"\r{line:<70}")
        if done >= total:
            self.end_line()

    def _log(self, done: int, total: int) -> None:
        """Write the line of the stage as far as it is known; a message in between ends it."""
        if not self.drawn:
            self.drawn = time.monotonic()
            ProgressBar.on_line = True
            _write(f"{total} {self.what}: ")
        if done >= total and ProgressBar.on_line:
            _write(f"done in {time.monotonic() - self.started:.0f} s")
            self.end_line()
