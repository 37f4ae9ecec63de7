"""Text of files on the pages: as it is, and never markup or a link."""

from __future__ import annotations

import pandas as pd
import pytest

from stereocal.ui.texts import escape_markdown, escaped_table


@pytest.mark.parametrize(
    ("text", "safe"),
    [
        ("left 07.png", "left 07.png"),
        ("a*b_c", r"a\*b\_c"),
        ("www.x.org.csv: line 3", "`www.x.org.csv:` line 3"),
        ("(HTTP://x.org) and me@x.org!", "`(HTTP://x.org)` and `me@x.org!`"),
        ("`www.x.org``y", "``` `www.x.org``y ```"),
    ],
)
def test_words_that_would_be_links_are_code(text: str, safe: str) -> None:
    assert escape_markdown(text) == safe


def test_tables() -> None:
    table = escaped_table(pd.DataFrame({"a@x.org": ["www.x.org", 3]}, index=["*", "b"]))
    assert list(table.columns) == ["`a@x.org`"]
    assert list(table.index) == [r"\*", "b"]
    assert list(table["`a@x.org`"]) == ["`www.x.org`", 3]
