"""One place for files of any kind, and what was found in them."""

from collections.abc import Callable, Sequence

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.formats.dropped import Dropped, sort_files
from stereocal.projects.files import StoredFile
from stereocal.ui.intake import Upload, emptied_uploader
from stereocal.ui.texts import escape_markdown

Keep = Callable[[str, bytes], StoredFile]
"""Stores a photograph, by name and content."""
SHOWN = 8
_SAID = "dropped"


def drop_zone(
    label: str,
    key: str,
    keep: Keep,
    take: Callable[[Dropped[StoredFile]], None],
    *,
    row: DeltaGenerator | None = None,
    below: DeltaGenerator | None = None,
    tables: tuple[str, ...] = (),
) -> None:
    """The uploader of files of any kind, one of a folder, and what the last files were.

    Args:
        keep: stores a photograph.
        take: uses what was given; it may add to its `problems`.
        row, below: where the uploader of a folder, and what the last files were, stand; None: here.
        tables: as of `sort_files`.
    """

    def used(uploads: Sequence[Upload]) -> None:
        st.session_state.pop(_SAID, None)
        with st.spinner("Reading the files."):
            given = sort_files(((each.name, each.getvalue()) for each in uploads), keep, tables)
        take(given)
        st.session_state[_SAID] = key, given.in_words, given.problems

    emptied_uploader(label, None, key, used)
    with (row or st).popover("Give a whole folder"):
        own = "A folder, with all folders in it"
        emptied_uploader(own, None, f"{key}_folder", used, many="directory")
    with below or st.container():
        _show_last(key)


def _show_last(key: str) -> None:
    """What the last files were, and those that cannot be used."""
    of, taken, problems = st.session_state.get(_SAID, ("", "", []))
    if of != key:
        return
    if taken:
        (st.info if problems else st.success)(f"Recognised: {taken}.")
    if problems:
        first = "\n".join(f"- {escape_markdown(each)}" for each in problems[:SHOWN])
        st.warning(first)
        if len(problems) > SHOWN:
            with st.expander(f"And {len(problems) - SHOWN} more"):
                rest = problems[SHOWN:]
                st.markdown("\n".join(f"- {escape_markdown(each)}" for each in rest))
