"""Fields of forms: one interface for every value that a person sets on a page.

A value has one place, and that is not Streamlit's session: it is read from there before its widget
is drawn, and written there by the widget's own change alone. So a draw never writes, and the page
shows what is kept, whichever way it was come to.

Streamlit 1.67 knows a widget by its page as well as by its key. A key that was written while one
page was shown is therefore no value on the next: the widget there began at its own minimum, and the
search of the calibration with it. It takes the value that is written to its key in the same run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui.messages import callback, tell

Fit = Callable[[Any], Any]
"""What a kept value is shown as; ValueError or TypeError if the field cannot show it."""
_SHOWN, _DRAWN, _BEFORE = "fields_shown", "fields_drawn", "fields_drawn_before"


class Values(Protocol):
    """Where values are kept by name, however that is done: a project."""

    @property
    def settings(self) -> dict[str, Any]:
        """All values that were kept."""

    def keep_settings(self, values: dict[str, Any]) -> None:
        """Keep values, beside the others."""


@dataclass(frozen=True)
class Field:
    """A widget's value, and where it is kept."""

    key: str
    """Of the widget."""
    name: str
    """Of what it holds: a widget may hold one thing after another."""
    read: Callable[[], Any]
    """The value as it is kept, or the usual one."""
    write: Callable[[Any], object]
    """Keeps a value; StereocalError if that cannot be."""
    tabs_own: bool = False
    """Whether each tab goes by its own: what is looked at, which changes no result."""
    tells: bool = True
    """Whether to say that another tab has changed it."""

    def value(self) -> Any:
        """What the page goes by, and the widget shows."""
        shown: dict[str, Any] = st.session_state.setdefault(_SHOWN, {})
        return shown[self.name] if self.tabs_own and self.name in shown else self.read()

    def widget(self) -> dict[str, Any]:
        """`key` and `on_change` for the widget that is drawn next, which will show the value."""
        value = self.value()
        shown: dict[str, Any] = st.session_state[_SHOWN]
        if self.tells and shown.get(self.name, value) != value:
            tell("Settings were changed in another tab; they are shown as they are now.", "info")
        # Not otherwise: it would take away what is being typed while the page is drawn.
        if not _is_drawn(self.key) or st.session_state.get(self.key) != value:
            st.session_state[self.key] = value
        shown[self.name] = value
        st.session_state.setdefault(_DRAWN, set()).add(self.key)
        return {"key": self.key, "on_change": self.changed}

    def shown(self) -> Any:
        """What this tab showed last; None before."""
        return st.session_state.get(_SHOWN, {}).get(self.name)

    def set(self, value: Any) -> None:
        """Keep a value; the widget shows it when it is drawn next.

        Raises:
            StereocalError: it cannot be kept. What is looked at changes all the same.
        """
        shown: dict[str, Any] = st.session_state.setdefault(_SHOWN, {})
        with suppress(*([StereocalError] if self.tabs_own else [])):
            self.write(value)
        shown[self.name] = value if self.tabs_own else self.read()

    @property
    def changed(self) -> Callable[[], None]:
        """The callback of the widget: keeps what a person has made of it."""

        @callback
        def keep() -> None:
            self.set(st.session_state[self.key])

        return keep


def setting(
    values: Values | None,
    key: str,
    usual: Any,
    fit: Fit,
    *,
    name: str | None = None,
    tabs_own: bool = False,
) -> Field:
    """A field whose value is kept among the settings.

    Args:
        values: None while there is no project: the value lasts as long as the tab.
        usual: the value until somebody sets another one.
        fit: what of a kept value can be shown; older versions may have kept another kind.
        name: of the setting, if it is not the widget's key.
    """
    name = name or key

    def read() -> Any:
        try:
            return fit(values.settings[name]) if values is not None else usual
        except (KeyError, TypeError, ValueError):
            return usual

    def write(value: Any) -> None:
        if values is not None:
            values.keep_settings({name: value})

    return Field(key, name, read, write, tabs_own or values is None)


def number(lowest: float, highest: float = math.inf, or_none: bool = False) -> Fit:
    """A number of the kind of `lowest`, within bounds."""

    def fit(value: Any) -> Any:
        if value is None and or_none:
            return None
        if isinstance(value, bool) or not lowest <= value <= highest:
            raise ValueError(value)
        if isinstance(lowest, int) and not isinstance(value, int):
            raise TypeError(value)
        return type(lowest)(value)

    return fit


def one_of(options: Sequence[Any]) -> Fit:
    """One of some options."""

    def fit(value: Any) -> Any:
        return options[options.index(value)]

    return fit


def some_of(options: Sequence[Any]) -> Fit:
    """A list of some of the options; what is no option any more is left out."""

    def fit(value: Any) -> list[Any]:
        return [each for each in value if each in options]

    return fit


def yes_or_no(value: Any) -> bool:
    """True or False."""
    return bool(one_of((False, True))(value))


def begin_page(page: str) -> None:
    """Note that a page begins to be drawn: on another one, no widget is there yet."""
    of_page, before = st.session_state.get(_BEFORE, ("", set()))
    drawn: set[str] = st.session_state.get(_DRAWN, set())
    # A run that a click has ended leaves the widgets of the one before in place.
    st.session_state[_BEFORE] = (page, before | drawn if of_page == page else set())
    st.session_state[_DRAWN] = set()


def end_page() -> None:
    """Note that the page is drawn whole: Streamlit forgets the widgets that were not."""
    of_page, _ = st.session_state.get(_BEFORE, ("", set()))
    st.session_state[_BEFORE] = (of_page, set())


def _is_drawn(key: str) -> bool:
    """Whether the browser has the widget since the last time that the page was drawn."""
    _, before = st.session_state.get(_BEFORE, ("", set()))
    return key in before or key in st.session_state.get(_DRAWN, set())
