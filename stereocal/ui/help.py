"""The documentation of this version, from its own files: nothing is fetched."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
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
        if picture is not None:
            alt, path = picture
            if path.is_file():
                st.image(str(path), caption=alt, alt=alt)


def parts(name: str) -> Iterator[tuple[str, tuple[str, Path] | None]]:
    """A page without its title: each text with the picture that follows it, as (words, file)."""
    folder, known = DOCS / Path(name).parent, topics()
    text, end = _TOCTREE.sub("", _text(name).partition("\n")[2]), 0

    def linked(part: str) -> str:
        return _LINK.sub(lambda link: _to_topic(folder, link, known), part)

    for found in _PICTURE.finditer(text):
        yield linked(text[end : found.start()]), (found["alt"], folder / found["file"])
        end = found.end()
    yield linked(text[end:]), None


def _to_topic(folder: Path, link: re.Match[str], known: Collection[str]) -> str:
    """A link to another page of the help; its words alone where that page is not here."""
    page = (folder / link[2]).with_suffix("").resolve()
    if page.is_relative_to(DOCS.resolve()):
        name = page.relative_to(DOCS.resolve()).as_posix()
        if name in known:
            return f"[{link[1]}](?{TOPIC}={name}{link[3] or ''})"
    return link[1]


def _text(name: str) -> str:
    """A page with what it includes; empty where it is not installed."""
    path = DOCS / f"{name}.md"
    if not path.is_file():
        return ""

    def included(found: re.Match[str]) -> str:
        other = path.parent / found[1]
        return other.read_text(encoding="utf-8") if other.is_file() else ""

    return _INCLUDE.sub(included, path.read_text(encoding="utf-8"))


def _listed(name: str) -> list[str]:
    """The pages that a table of contents names."""
    lines = [line for block in _TOCTREE.findall(_text(name)) for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith(":")]
