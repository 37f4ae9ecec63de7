"""Results that say their answer where they are looked at: at a prompt, or in a notebook."""

import textwrap
from collections.abc import Sequence
from dataclasses import fields
from html import escape
from typing import Any, TypeVar

import pandas as pd

Kind = TypeVar("Kind")
MOST_LINES, WIDTH = 12, 100
"""Most lines of the text at a prompt, and its characters in a line."""
MOST_ROWS = 8
"""Most rows of the table in a notebook."""


def answering(kind: type[Kind], answer: Any) -> Kind:
    """A result as one of a kind that says its answer, and has no fields of its own."""
    return kind(*(getattr(answer, field.name) for field in fields(answer)))


class Answer:
    """A result whose `repr` is its answer with units, at most `MOST_LINES` long."""

    @property
    def answer(self) -> Sequence[str]:
        """What was found, a paragraph each."""
        raise NotImplementedError

    def __repr__(self) -> str:
        lines = [part for text in self.answer for part in textwrap.wrap(text, WIDTH)]
        return "\n".join(lines if len(lines) <= MOST_LINES else [*lines[: MOST_LINES - 1], "..."])

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return "".join(f"<p>{escape(text)}</p>" for text in self.answer)


class TableAnswer(Answer):
    """One that is a table too."""

    def to_dataframe(self) -> pd.DataFrame:
        """The table."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        table = self.to_dataframe()
        cut = f"<p>{len(table):,} rows</p>" if len(table) > MOST_ROWS else ""
        return f"{super()._repr_html_()}{table.head(MOST_ROWS).to_html()}{cut}"
