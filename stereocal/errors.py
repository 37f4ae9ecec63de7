"""The errors that people see: what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

LONGEST = 500
"""Characters of a sentence; what it quotes of a file may be longer."""
KEPT_END = 160


DAMAGED = (
    ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RecursionError,
    TypeError, ValueError,
)  # fmt: skip
"""What Python raises where a damaged file is taken for a sound one."""


class StereocalError(ValueError):
    """Input that cannot be used. Its text is one sentence for the person who gave the input.

    What it quotes of a file is a stranger's: signs that cannot be shown become spaces, and of a
    text that is too long the middle is left out, since the end says what to do.
    """

    def __init__(self, text: str = "") -> None:
        text = "".join(sign if sign.isprintable() else " " for sign in text)
        if len(text) > LONGEST:
            text = f"{text[: LONGEST - KEPT_END - 5]} ... {text[-KEPT_END:]}"
        super().__init__(text)


@dataclass(frozen=True)
class RowProblem:
    """One refused row of a table: where it stands and why."""

    line: int
    reason: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.reason}"


class RefusedRowsError(StereocalError):
    """Rows of a table that cannot be used. The text names the first three, `problems` all."""

    def __init__(self, source: str, problems: Sequence[RowProblem], what: str) -> None:
        shown = "; ".join(str(p) if p.line else p.reason for p in problems[:3])
        more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
        rows = "1 row" if len(problems) == 1 else f"{len(problems)} rows"
        super().__init__(f"{source}{rows} {what}: {shown}{more}.")
        self.problems = tuple(problems)


def can_be_shown(text: object) -> bool:
    """Whether it is a text that a page can show: JSON can hold halves of signs, which none can."""
    return isinstance(text, str) and text == text.encode("utf-8", "replace").decode()
