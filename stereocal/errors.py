"""The errors that people see: what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class StereocalError(ValueError):
    """Input that cannot be used. Its text is one sentence for the person who gave the input."""


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
