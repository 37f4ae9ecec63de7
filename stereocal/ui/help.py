"""The documentation of this version, from its own files: nothing is fetched."""

import re
from collections.abc import Iterator
from pathlib import Path

import streamlit as st

from stereocal.system.resources import ROOT

DOCS = ROOT / "docs"
FIRST = "tutorial"
TOPIC = "topic"
_TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```\n?", re.M | re.S)
_INCLUDE = re.compile(r"^```\{include\} (\S+)\n(?::[^\n]*\n)*```\n?", re.M)
_PICTURE = re.compile(r"^!\[(?P<alt>[^\]]*)\]\((?P<file>[^)]+)\)$", re.M)
_LINK = re.compile(r"\[([^\]]+)\]\((?!https?:|#)([\w./-]+)(#[\w-]+)?\)")


def topics() -> dict[str, str]:
    """Titles of the pages by their name in the documentation, in its order."""
    found = {}
    for name in [*_listed("index"), *(f"howto/{name}" for name in _listed("howto/index"))]:
        first = _text(name).partition("\n")[0]
        if first.startswith("# "):
            found[name] = first.removeprefix("# ").replace("`", "")
    return found


def show_help() -> None:
    """One page of the documentation, and the choice of another."""
    titles = topics()
    if not titles:
        st.info(f"The documentation is not in this installation: {DOCS} is missing.")
        return
    asked = st.query_params.get(TOPIC, FIRST)
    names = list(titles)
    at = names.index(asked) if asked in titles else names.index(FIRST)
    name = st.selectbox("About", names, at, titles.__getitem__, key=f"help_{asked}")
    if name != asked:
        st.query_params[TOPIC] = name
        st.rerun()
    for text, picture in parts(name):
        st.markdown(text)
        if picture is not None and picture[1].is_file():
            st.image(str(picture[1]), caption=picture[0], alt=picture[0])


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

    for found in _PICTURE.finditer(text):
        picture = found["alt"], folder / found["file"]
        yield _LINK.sub(to_topic, text[end : found.start()]), picture
        end = found.end()
    yield _LINK.sub(to_topic, text[end:]), None


def _text(name: str) -> str:
    """A page with what it includes; empty where it is not installed."""
    path = DOCS / f"{name}.md"

    def included(found: re.Match[str]) -> str:
        return _read(path.parent / found[1])

    return _INCLUDE.sub(included, _read(path))


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _listed(name: str) -> list[str]:
    lines = [line for block in _TOCTREE.findall(_text(name)) for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith(":")]
