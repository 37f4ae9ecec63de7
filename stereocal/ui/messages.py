"""Messages that are shown once, at the top of the page, and the last refused upload.

Streamlit runs callbacks before the page: an error in one would replace the page by a traceback.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any, Literal, NoReturn, ParamSpec, TypeVar

import pandas as pd
import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.scriptrunner import StopException

from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import FourCoefficientsError, ImageSizeError
from stereocal.formats.exchange.options import ImageSize
from stereocal.rig.camera import LensModel
from stereocal.ui.texts import escape_markdown

P = ParamSpec("P")
T = TypeVar("T")
Ways = Mapping[str, Callable[[], None]]
"""Ways to continue after a refusal: callbacks by the label of their button; two at most."""
_MESSAGES, _REFUSED = "messages", "refused"
_SIZE = {"width": "refused_width", "height": "refused_height"}
"""The fields of an image size that is asked for."""


def end_here() -> NoReturn:
    """End a page early; its state in the menu and its messages are still drawn.

    `st.stop` would end the run at the next element, so that they would not be.
    """
    raise StopException


def tell(sentence: str, kind: Literal["error", "info"] = "error") -> None:
    """Queue a message for the top of this or the next page; duplicates are dropped."""
    st.session_state.setdefault(_MESSAGES, {})[sentence] = kind


def show_messages(place: DeltaGenerator, but: Sequence[str] = ()) -> list[str]:
    """Draw the queued messages except `but`; they stay queued until forgotten."""
    queued = st.session_state.get(_MESSAGES, {})
    messages = [message for message in queued if message not in but]
    for sentence in messages:
        getattr(place, queued[sentence])(escape_markdown(sentence))
    return messages


def forget_messages(messages: Sequence[str]) -> None:
    """Remove messages from the queue."""
    for sentence in messages:
        st.session_state[_MESSAGES].pop(sentence, None)


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


def button(
    label: str,
    key: str,
    act: Callable[..., object],
    *arguments: object,
    place: DeltaGenerator | None = None,
    first: bool = False,
    icon: str | None = None,
    **options: Any,
) -> bool:
    """A button; errors of what it does become messages. Returns whether it was pressed.

    Args:
        act: called with the `arguments`.
        place: where it stands; None: here.
        first: it stands out, as the one thing to do next.
        icon: its name among Material's.
        options: passed on to `st.button`.
    """
    shown = {"type": "primary" if first else "secondary", **options}
    shown["icon"] = icon and f":material/{icon}:"
    draw: Any = place or st
    return bool(draw.button(label, key, on_click=callback(act), args=arguments, **shown))


def show_with_button(
    kind: Literal["markdown", "info", "warning"], words: str, *pressed: Any, **more: Any
) -> None:
    """Words, shown as this kind of message, and beside them the `button` that acts on them."""
    text, place = st.columns([6, 2], vertical_alignment="center")
    getattr(text, kind)(escape_markdown(words))
    button(*pressed, place=place, **more)


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


def show_stale(changed: str) -> None:
    """Say that a result is out of date, beside the button that renews it.

    Args:
        changed: what has changed since, as a list in words; if empty, nothing is shown.
    """
    if changed:
        changed = escape_markdown(changed)
        st.warning(f"Changed since this result: {changed}. It is shown as it was before.")


def readable(read: Callable[[], T], warn: bool = True) -> T | None:
    """The result of a read; after an error None, and with `warn` a warning on the page."""
    try:
        return read()
    except StereocalError as error:
        if warn:
            st.warning(escape_markdown(str(error)))
        return None


def show_each(show: Callable[[str], object], sentences: Iterable[str]) -> None:
    """Show each sentence by itself, such as by `st.warning`."""
    for sentence in sentences:
        show(escape_markdown(sentence))


def show_refusal() -> None:
    """Show the last refusal, until something is accepted."""
    refused: tuple[StereocalError, Ways] | None = st.session_state.get(_REFUSED)
    if refused is None:
        return
    error, ways = refused
    text, asks_size = str(error), False
    if isinstance(error, ImageSizeError) and ways:
        text, asks_size = f"{error.question} What is it?", True
    st.error(f"{escape_markdown(text)}\n\nWhat was loaded before is unchanged.")
    if asks_size:
        for place, (side, key) in zip(st.columns(2), _SIZE.items(), strict=True):
            place.number_input(f"Image {side} (px)", 1, value=None, step=1, key=key)
    if isinstance(error, RefusedRowsError):
        rows = [(problem.line, problem.reason) for problem in error.problems]
        table = pd.DataFrame(rows, columns=["Line", "Refused because"])
        st.dataframe(table, hide_index=True, height=min(38 + 35 * len(rows), 250))
    for key, (label, use) in zip(("use_rest", "use_other"), ways.items(), strict=False):
        st.button(label, on_click=use, key=key)


def set_refusal(error: StereocalError, ways: Ways | None = None) -> None:
    """Show a refusal on the page, with other ways to continue."""
    st.session_state[_REFUSED] = error, ways or {}


def clear_refusal() -> None:
    """Remove the refusal, because something else is given."""
    st.session_state.pop(_REFUSED, None)


@contextmanager
def refusing(ways: Ways | None = None) -> Iterator[None]:
    """Show a StereocalError of what is inside as the refusal, in place of the last."""
    clear_refusal()
    try:
        yield
    except StereocalError as error:
        set_refusal(error, ways)


def ask_if_fisheye(
    take: Callable[[LensModel | None], object], model: LensModel | None = None
) -> None:
    """Take an upload; if a camera in it may be a fisheye's, ask, and take it as what it is."""
    clear_refusal()
    again = callback(refusing()(ask_if_fisheye))
    try:
        take(model)
    except FourCoefficientsError as error:
        set_refusal(
            StereocalError(f"{error.question} Which are they?"),
            {
                "k1 k2 p1 p2: the usual lens": partial(again, take, "brown"),
                "k1 k2 k3 k4: a fisheye": partial(again, take, "fisheye"),
            },
        )


def ask_about_lens(
    take: Callable[[LensModel | None, ImageSize | None], object], size: ImageSize | None = None
) -> None:
    """Take an upload as `ask_if_fisheye`; if a camera in it has no image size, ask for that too."""
    try:
        ask_if_fisheye(lambda model: take(model, size))
    except ImageSizeError as error:
        again = callback(refusing()(ask_about_lens))
        set_refusal(error, {"Use this size": lambda: again(take, _entered_size())})


def _entered_size() -> ImageSize | None:
    width, height = (st.session_state.get(key) for key in _SIZE.values())
    return None if width is None or height is None else (int(width), int(height))
