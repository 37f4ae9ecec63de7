"""The documentation of this version, from its own files: nothing is fetched."""

import re
from collections.abc import Iterator
from pathlib import Path

import streamlit as st

from stereocal.system.resources import ROOT

DOCS = ROOT / "docs"
FIRST = "tutorial"
FIRST_PAGES, REFERENCE, RECIPES = "index", "reference", "howto/index"
"""Pages that list others."""
TOPIC = "topic"
_TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```\n?", re.M | re.S)
_INCLUDE = re.compile(r"^```\{include\} (\S+)\n(?::[^\n]*\n)*```\n?", re.M)
_PICTURE = re.compile(r"^!\[(?P<alt>[^\]]*)\]\((?P<file>[^)]+)\)$", re.M)
_LINK = re.compile(r"\[([^\]]+)\]\((?!https?:|#)([\w./-]+)(#[\w-]+)?\)")


def topics(*lists: str) -> dict[str, str]:
    """Titles of the pages in these lists by their name in the documentation; of all if none."""
    titles = {}
    for name in [
        name for listing in lists or (FIRST_PAGES, REFERENCE, RECIPES) for name in _listed(listing)
    ]:
        first = _text(name).partition("\n")[0]
        if first.startswith("# ") and name != REFERENCE:
            titles[name] = first.removeprefix("# ").replace("`", "")
    return titles


def show_help() -> None:
    """One page of the documentation: of the first ones, or of the reference, which is folded."""
    titles = topics()
    if not titles:
        st.info(f"The documentation is not in this installation: {DOCS} is missing.")
        return
    topic = st.query_params.get(TOPIC, FIRST)
    topic = topic if topic in titles else FIRST
    _choose("Begin with", topics(FIRST_PAGES, RECIPES), topic)
    reference = topics(REFERENCE)
    with st.expander("Reference", expanded=topic in reference):
        _choose("About", reference, topic)
    for text, picture in parts(topic):
        st.markdown(text)
        if picture is not None and picture[1].is_file():
            st.image(str(picture[1]), caption=picture[0], alt=picture[0])


def _choose(label: str, titles: dict[str, str], topic: str) -> None:
    """A menu of pages; empty if the page shown is none of them."""
    index = [*titles].index(topic) if topic in titles else None
    name = st.selectbox(
        label, titles, index, titles.__getitem__, key=f"help_{label}_{topic}", placeholder="Choose"
    )
    if name is not None and name != topic:
        st.query_params[TOPIC] = name
        st.rerun()


def parts(name: str) -> Iterator[tuple[str, tuple[str, Path] | None]]:
    """A page without its title: each text with the picture that follows it, as (words, file)."""
    folder, known = DOCS / Path(name).parent, topics()
    text, end = _TOCTREE.sub("", _text(name).partition("\n")[2]), 0

    def to_topic(link: re.Match[str]) -> str:
        """A link to another page of the help; its words alone where that page is not here."""
        page = (folder / link[2]).with_suffix("").resolve()
        root = DOCS.resolve()
        other = page.relative_to(root).as_posix() if page.is_relative_to(root) else ""
        return f"[{link[1]}](?{TOPIC}={other}{link[3] or ''})" if other in known else link[1]

    for match in _PICTURE.finditer(text):
        picture = match["alt"], folder / match["file"]
        yield _LINK.sub(to_topic, text[end : match.start()]), picture
        end = match.end()
    yield _LINK.sub(to_topic, text[end:]), None


def _text(name: str) -> str:
    """A page with what it includes; empty where it is not installed."""
    path = DOCS / f"{name}.md"

    def included(match: re.Match[str]) -> str:
        return _read(path.parent / match[1])

    return _INCLUDE.sub(included, _read(path))


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _listed(name: str) -> list[str]:
    lines = [line for block in _TOCTREE.findall(_text(name)) for line in block.splitlines()]
    folder = name.rpartition("/")[0]
    return [str(Path(folder, line)) for line in lines if line and not line.startswith(":")]
