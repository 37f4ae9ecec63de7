"""Messages that are shown once, at the top of the page.

Streamlit runs callbacks before the page: an error in one would replace the page by a traceback.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Literal, NoReturn, ParamSpec, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.scriptrunner import StopException

from stereocal.errors import StereocalError
from stereocal.ui.texts import escape_markdown

P = ParamSpec("P")
T = TypeVar("T")
Kind = Literal["error", "info"]
Message = tuple[Kind, str]
_MESSAGES = "messages"


def end_here() -> NoReturn:
    """End a page early; its state in the menu and its messages are still drawn.

    `st.stop` would end the run at the next element, so that they would not be.
    """
    raise StopException


def tell(sentence: str, kind: Kind = "error") -> None:
    """Queue a message for the top of this or the next page; duplicates are dropped."""
    messages: list[Message] = st.session_state.setdefault(_MESSAGES, [])
    if (kind, sentence) not in messages:
        messages.append((kind, sentence))


def show_messages(place: DeltaGenerator, but: Sequence[Message] = ()) -> list[Message]:
    """Draw the queued messages except `but`; they stay queued until forgotten."""
    messages = [one for one in st.session_state.get(_MESSAGES, []) if one not in but]
    for kind, sentence in messages:
        (place.error if kind == "error" else place.info)(escape_markdown(sentence))
    return messages


def forget_messages(messages: Sequence[Message]) -> None:
    """Remove messages from the queue."""
    st.session_state[_MESSAGES] = [
        one for one in st.session_state.get(_MESSAGES, []) if one not in messages
    ]


def attempt(call: Callable[[], T]) -> T | None:
    """The result of a call; None after an error, which is queued as a message."""
    try:
        return call()
    except StereocalError as error:
        tell(str(error))
    except OSError as error:
        tell(f"The project's folder cannot be used: {error.strerror or error}.")
    return None


def callback(function: Callable[P, object]) -> Callable[P, None]:
    """Wrap a callback so that its errors become messages."""

    @wraps(function)
    def run(*arguments: P.args, **named: P.kwargs) -> None:
        attempt(lambda: function(*arguments, **named))

    return run


@dataclass(frozen=True)
class ErrorsShown:
    """Shows a StereocalError of what is inside; after it, `end` ends the page."""

    show: Callable[[str], object] = st.error
    end: bool = False

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: object, _trace: object) -> bool:
        if not isinstance(error, StereocalError):
            return False
        self.show(escape_markdown(str(error)))
        if self.end:
            end_here()
        return True


def fragment(function: Callable[P, object], run_every: float | None = None) -> Callable[P, None]:
    """A part of a page that its controls redraw alone; its errors become messages.

    Errors of a fragment do not reach the page that calls it.

    Args:
        run_every: seconds after which it is redrawn.
    """

    @wraps(function)
    def draw(*arguments: P.args, **named: P.kwargs) -> None:
        with ErrorsShown():
            function(*arguments, **named)

    return st.fragment(draw, run_every=run_every)


def readable(read: Callable[[], T], told: bool = True) -> T | None:
    """The result of a read; after an error None, and a warning on the page if it is to be told."""
    try:
        return read()
    except StereocalError as error:
        if told:
            st.warning(escape_markdown(str(error)))
        return None
