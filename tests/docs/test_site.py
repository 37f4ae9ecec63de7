"""The site is built without a warning, no link is dead, and pictures are those of make pictures."""

import importlib.util
import io
import re
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageColor

import stereocal
from docs.drawings.__main__ import DRAWINGS, FOLDER, draw
from docs.screenshots import PAGES as SCREENS
from docs.screenshots import PICTURES, STORY, THEMES, WIDTHS, keep
from docs.tables import PAGE, written
from stereocal.figures.story import ROWS, read_story
from stereocal.figures.style import METHOD_COLOURS
from tests.docs.pages import PAGES, name_of
from tests.terminal import ROOT

LINK = re.compile(r"(?<!!)\[[^]]*\]\(([^)\s#]+)[^)]*\)")
LOADED = re.compile(
    r"""(?:<script[^>]*src|<link[^>]*href|<img[^>]*src|url\()\s*=?\s*["']?(https?:)"""
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, as `make docs` builds it."""
    if importlib.util.find_spec("sphinx") is None:
        pytest.fail("Sphinx is missing: pip install -r requirements-docs.txt")
    out = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(out)],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    return out


@pytest.mark.soak
def test_it_loads_nothing_from_elsewhere(site: Path) -> None:
    for page in (*site.glob("**/*.html"), *site.glob("**/*.css")):
        assert not LOADED.search(page.read_text(encoding="utf-8")), page


@pytest.mark.soak
def test_the_reference_has_every_public_name(site: Path) -> None:
    page = (site / "api.html").read_text(encoding="utf-8")
    for name in stereocal.__all__:
        assert f'id="stereocal.{name}"' in page or f".{name}" in page, name


def test_no_link_to_a_file_is_dead() -> None:
    """Sphinx checks those between its pages; this also those of README, and to other files."""
    links = 0
    for page in PAGES:
        for target in LINK.findall(page.read_text(encoding="utf-8")):
            if not target.startswith(("http:", "https:", "mailto:")):
                assert (page.parent / target).exists(), (name_of(page), target)
                links += 1
    assert links > 100


MORE = ("photographs", "review", "clicks")
STORY_FILE = ROOT / "assets" / "story.json"
SHOWN = re.compile(r"!\[([^]]*)\]\(([^)]+)\)")


def test_every_picture_is_made_by_the_command() -> None:
    screens = {
        f"{page}_{width}_{theme}.png"
        for page, width, theme in product((*SCREENS, *MORE), WIDTHS, THEMES)
    }
    story = {f"{name}.png" for name in STORY}
    assert {path.name for path in PICTURES.glob("*.*")} == screens | story
    assert {path.name for path in FOLDER.glob("*")} == {f"{name}.svg" for name in DRAWINGS}


def test_a_picture_tells_the_sets_apart(tmp_path: Path) -> None:
    """However few the points of one are, and however many shades the page has."""
    rare, *others = (
        np.array(ImageColor.getrgb(METHOD_COLOURS[m])) for m in ("3d", "2d", "refined")
    )
    shade = np.linspace(0, 1, 600)[:, None, None]
    page = np.concatenate(
        [(1 - shade) * 255 + shade * own + np.zeros((1, 300, 1)) for own in others], 1
    )
    page[100:104, 100:104] = rare
    packed = io.BytesIO()
    Image.fromarray(page.astype(np.uint8)).save(packed, "PNG")
    keep(packed.getvalue(), tmp_path / "page.png")
    kept = np.asarray(Image.open(tmp_path / "page.png").convert("RGB"), int)
    assert np.abs(kept[102, 102] - rare).max() <= 20


def test_every_picture_that_is_shown_is_there_and_has_words() -> None:
    shown = set()
    for text in PAGES:
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


def test_the_tables_are_those_of_the_program() -> None:
    """`python -m docs.tables` writes them."""
    page = PAGE.read_text()
    assert written(page) == page
    assert "`mrcal`" in page
