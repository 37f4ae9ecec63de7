"""Pictures of README and docs are those that `make pictures` makes."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

from tests.browser.pictures import PAGES, PICTURES, THEMES, WIDTHS

ROOT = Path(__file__).parents[1]


def test_every_picture_that_is_shown_is_made_by_the_command() -> None:
    names = {
        f"{page}_{width}_{theme}.png"
        for page, width, theme in product((*PAGES, "photographs", "review"), WIDTHS, THEMES)
    }
    assert {path.name for path in PICTURES.glob("*")} == names
    shown = 0
    for text in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"!\[[^]]*\]\(([^)]+\.png)\)", text.read_text()):
            path = (text.parent / target).resolve()
            assert path.is_file() and path.parent == PICTURES, target
            shown += 1
    assert shown >= 3
