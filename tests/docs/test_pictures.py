"""Pictures of README and docs are those that `make pictures` makes."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

from docs.drawings.__main__ import DRAWINGS, FOLDER, draw
from docs.screenshots import PAGES, PICTURES, STORY, THEMES, WIDTHS
from stereocal.figures.story import ROWS, read_story
from tests.docs.pages import PAGES as TEXTS
from tests.docs.pages import name_of
from tests.terminal import ROOT

STORY_FILE = ROOT / "assets" / "story.json"
SHOWN = re.compile(r"!\[([^]]*)\]\(([^)]+)\)")


def test_every_picture_is_made_by_the_command() -> None:
    screens = {
        f"{page}_{width}_{theme}.png"
        for page, width, theme in product((*PAGES, "photographs", "review"), WIDTHS, THEMES)
    }
    story = {f"{name}.png" for name in STORY}
    assert {path.name for path in PICTURES.glob("*.*")} == screens | story
    assert {path.name for path in FOLDER.glob("*")} == {f"{name}.svg" for name in DRAWINGS}


def test_every_picture_that_is_shown_is_there_and_has_words() -> None:
    shown = set()
    for text in TEXTS:
        for words, target in SHOWN.findall(text.read_text(encoding="utf-8")):
            path = (text.parent / target).resolve()
            assert path.is_file() and path.parent in (PICTURES, FOLDER), (name_of(text), target)
            assert len(words) > 10, (name_of(text), target)
            shown.add(path)
    made = {PICTURES / f"{name}.png" for name in STORY} | set(FOLDER.glob("*"))
    assert made <= shown


def test_the_words_beside_the_story_are_its_own() -> None:
    story = read_story(STORY_FILE)
    said = {f"{100 * story.sets[method].length_error:.2g} %" for method in ROWS}
    bars = len(story.sets["refined"].length_errors)
    for text in (ROOT / "README.md", ROOT / "docs" / "index.md"):
        (words,) = [words for words, at in SHOWN.findall(text.read_text()) if "lengths" in at]
        assert f"{bars} real bars" in words
        assert said == set(re.findall(r"[\d.]+ %", words))


def test_the_drawings_are_those_of_the_program(tmp_path: Path) -> None:
    draw(tmp_path)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (FOLDER / path.name).read_bytes(), f"make pictures: {path.name}"
