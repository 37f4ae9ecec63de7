"""One place for files of any kind, and what was found in them."""

from collections.abc import Callable, Sequence

import streamlit as st

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
    take: Callable[[Dropped[StoredFile]], Sequence[str] | None],
    *,
    text: str | None = None,
) -> None:
    """The uploader of files of any kind, one of a folder, and what they made of the last ones.

    Args:
        keep: stores a photograph.
        take: uses what was given, and returns further sentences on it, if there are any.
    """

    def used(uploads: Sequence[Upload]) -> None:
        with st.spinner("Reading the files."):
            given = sort_files(((each.name, each.getvalue()) for each in uploads), keep)
        sentences = take(given) or ()
        st.session_state[_SAID] = key, given.in_words, [*sentences], given.problems

    emptied_uploader(label, None, key, used, text=text)
    with st.popover("Give a whole folder"):
        own = "A folder, with all folders in it"
        emptied_uploader(own, None, f"{key}_folder", used, many="directory")
    _show_last(key)


def _show_last(key: str) -> None:
    """What the last files were, and those that cannot be used."""
    of, taken, sentences, problems = st.session_state.get(_SAID, ("", "", [], []))
    if of != key:
        return
    if taken:
        words = " ".join([f"Taken: {taken}.", *sentences])
        st.success(escape_markdown(words))
    elif sentences:
        st.info(escape_markdown(" ".join(sentences)))
    if problems:
        first = "\n".join(f"- {escape_markdown(each)}" for each in problems[:SHOWN])
        st.warning(first)
        if len(problems) > SHOWN:
            with st.expander(f"And {len(problems) - SHOWN} more"):
                rest = problems[SHOWN:]
                st.markdown("\n".join(f"- {escape_markdown(each)}" for each in rest))
