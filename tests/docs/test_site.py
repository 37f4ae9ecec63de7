"""The site is built without a warning and loads nothing from elsewhere; no link is dead."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import stereocal
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


def test_it_loads_nothing_from_elsewhere(site: Path) -> None:
    for page in (*site.glob("**/*.html"), *site.glob("**/*.css")):
        assert not LOADED.search(page.read_text(encoding="utf-8")), page


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
