"""Errors with messages for the user: what is wrong, where, and what to do."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

LONGEST = 900
"""Maximum length of a message, in characters: four sentences of suspects with a remedy."""
LONGEST_WORD = 40
KEPT_TAIL = 160
"""Characters kept at the end of a message that is shortened."""

DAMAGED = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
)
"""Exceptions that Python raises while a damaged file is parsed."""


class StereocalError(ValueError):
    """Invalid input. The message tells the user what is wrong and what to do.

    Every function that meets input may raise it: inside the package, docstrings name only other
    exceptions, and what is special about this one.

    Messages may quote untrusted files: characters that are not printable are replaced by spaces,
    and a message over `LONGEST` characters loses its middle, because its end says what to do.

    Args:
        text: what is wrong, kept as `reason`.
        source: the file or part of it that the message begins with.
        option: what a command can be told instead, as `--unit mm`; only commands show it.
    """

    lasts = True
    """Whether the same input is refused again: not where a disk or a project is the cause."""

    def __init__(self, text: str = "", source: str = "", *, option: str = "") -> None:
        self.reason, self.option = text, option
        text = f"{source}: {text}" if source else text
        text = "".join(character if character.isprintable() else " " for character in text)
        if len(text) > LONGEST:
            start, end = text[: LONGEST - KEPT_TAIL - 5], text[-KEPT_TAIL:]
            # Between words, unless a quoted file has too long ones.
            start = start[: max(start.rfind(" "), len(start) - LONGEST_WORD)]
            begin = end.find(" ") + 1
            text = f"{start} ... {end[begin if begin <= LONGEST_WORD else 0 :]}"
        super().__init__(text)


def refuse(*cases: tuple[Any, str]) -> None:
    """Raise an error with the message of the first case that is true."""
    for case, message in cases:
        if case:
            raise StereocalError(message)


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Errors from within begin with `source`, the file or part of it that caused them."""
    try:
        yield
    except StereocalError as error:
        raise StereocalError(str(error), source, option=error.option) from error


@contextmanager
def disk_errors(failed: str) -> Iterator[None]:
    """Errors of the disk from within begin with `failed`: what cannot be done."""
    try:
        yield
    except StereocalError:
        raise
    except OSError as error:
        raise StereocalError(f"{failed}: {error.strerror or error}.") from error


@contextmanager
def damaged(
    message: str, kind: type[StereocalError] = StereocalError, source: str = "", keep: bool = False
) -> Iterator[None]:
    """What Python raises within while it parses a damaged file is an error with this message.

    Args:
        keep: an error that says itself what is wrong stays as it is.
    """
    try:
        yield
    except DAMAGED as error:
        if keep and isinstance(error, StereocalError):
            raise
        raise kind(message, source) from error


@dataclass(frozen=True)
class RowProblem:
    """A rejected row of a table: its line number (0 if unknown) and the reason."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.reason}"


class RefusedRowsError(StereocalError):
    """Invalid rows of a table. The message lists the first three, `problems` all of them."""

    def __init__(self, source: str, problems: Sequence[RowProblem], what: str) -> None:
        shown = "; ".join(str(p) if p.line else p.reason for p in problems[:3])
        more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
        rows = "1 row" if len(problems) == 1 else f"{len(problems)} rows"
        super().__init__(f"{source}{rows} {what}: {shown}{more}.")
        self.source, self.problems, self.what = source, tuple(problems), what


class PointsOutsideError(RefusedRowsError):
    """Points outside their image.

    Args:
        recording: the `Recording` with all points, in which a cause is looked for.
    """

    def __init__(
        self, source: str, problems: Sequence[RowProblem], what: str, recording: object
    ) -> None:
        super().__init__(source, problems, what)
        self.recording = recording
