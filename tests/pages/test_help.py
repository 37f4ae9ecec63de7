"""The page Help: the documentation in the package, its links, and what is not installed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.ui.help import DOCS, parts, topics
from tests.terminal import ROOT

LINK = re.compile(r"\]\((\?topic=[\w/]+)?([^)\s]*)\)")


def test_every_page_of_the_documentation_can_be_read() -> None:
    titles = topics()
    assert {"tutorial", "howto/table", "field_guide", "comparison", "sample_data"} <= set(titles)
    there = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.glob("**/*.md")}
    assert there - set(titles) == {"index"}


def test_links_lead_to_pages_of_the_help() -> None:
    titles, topic_links = topics(), 0
    for name in titles:
        for text, _ in parts(name):
            assert "```{" not in text
            for topic, other in LINK.findall(text):
                topic_links += bool(topic)
                if topic:
                    assert topic.removeprefix("?topic=") in titles
                else:
                    assert other.startswith(("http", "#")), f"{name}: {other}"
    assert topic_links > 80


def test_the_page_shows_what_the_address_asks_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=60).run()
    app.switch_page("pages/help.py").run()
    assert not app.exception
    assert app.selectbox[0].value == "tutorial"
    app.selectbox[0].set_value("world").run()
    assert app.query_params["topic"] in ("world", ["world"])
    assert any("World frame" in item.value or "world frame" in item.value for item in app.markdown)
