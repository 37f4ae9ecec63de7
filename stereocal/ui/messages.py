"""What a person is told once, at the top of the page.

Streamlit runs callbacks before the page: an error there would be shown as a traceback, and the page
would not be drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Literal, ParamSpec, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.ui.texts import escape_markdown

P = ParamSpec("P")
T = TypeVar("T")
Kind = Literal["error", "info"]
Message = tuple[Kind, str]
_MESSAGES = "told"


def tell(sentence: str, kind: Kind = "error") -> None:
    """Say this once, at the top of the page that is drawn now or next; the same not twice."""
    told: list[Message] = st.session_state.setdefault(_MESSAGES, [])
    if (kind, sentence) not in told:
        told.append((kind, sentence))


def show_messages(place: DeltaGenerator, but: Sequence[Message] = ()) -> list[Message]:
    """Draw what is to be told, but for what was drawn already; it is told until forgotten."""
    told = [one for one in st.session_state.get(_MESSAGES, []) if one not in but]
    for kind, sentence in told:
        (place.error if kind == "error" else place.info)(escape_markdown(sentence))
    return told


def forget_messages(told: Sequence[Message]) -> None:
    """What has been told is not told again."""
    st.session_state[_MESSAGES] = [
        one for one in st.session_state.get(_MESSAGES, []) if one not in told
    ]


def attempt(act: Callable[[], T]) -> T | None:
    """What an act returns; None where it is refused, which is told."""
    try:
        return act()
    except StereocalError as error:
        tell(str(error))
    except OSError as error:
        tell(f"The project's folder cannot be used: {error.strerror or error}.")
    return None


def callback(act: Callable[P, object]) -> Callable[P, None]:
    """A callback whose refusal is told."""

    @wraps(act)
    def run(*arguments: P.args, **named: P.kwargs) -> None:
        attempt(lambda: act(*arguments, **named))

    return run


def readable(read: Callable[[], T]) -> T | None:
    """What is read, or None and a sentence on the page where it is damaged: the rest goes on."""
    try:
        return read()
    except StereocalError as error:
        st.warning(escape_markdown(str(error)))
        return None
