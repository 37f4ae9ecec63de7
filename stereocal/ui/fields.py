"""Fields of forms: one interface for every value that the user sets on a page.

A value is stored in one place, the project: it is read before its widget is drawn, and written only
by the widget's own change. So drawing never writes, and every page shows the stored value.

Streamlit 1.67 identifies a widget by its page and key: a session value written on one page is lost
on the next, where the widget starts at its minimum. So the value is written to the key in each run.

What a run has written does not reach the browser if another run begins at once. A widget that comes
without a value then shows, and tells, its default, which was stored: lengths were lost so in 18 of
40 pages that were drawn anew a few times within seconds. So the default is the stored value; but a
number that the user may remove has none: it is written until the page has rested, and what is told
of it is looked at (`_is_echo`).
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.ui.messages import callback

Fit = Callable[[Any], Any]
"""Converts a stored value for display; ValueError or TypeError if the field cannot show it."""
_SHOWN, _DRAWN, _BEFORE = "fields_shown", "fields_drawn", "fields_drawn_before"
_REMOVABLE, _ECHOES = "fields_removable", "fields_echoes"
"""The keys of numbers that may be removed; when each was last told to be there no more."""
_ENDED, _RESTED, UNTIL_THERE_S = "fields_ended", "fields_rested", 3.0
"""When the last run of a page ended, and whether this one began so long after it that all of it had
reached the browser."""
RESTS_S, AGAIN_S = 1.0, 10.0
"""A user who has removed a number again does so in a page that rests, and not much later."""
_GIVEN = "fields_given"
"""The value that each widget was given or has told since, by the widget's key."""


class Values(Protocol):
    """Storage of values by name: a project."""

    @property
    def settings(self) -> dict[str, Any]:
        """All stored values."""

    def keep_settings(self, values: dict[str, Any]) -> None:
        """Store values; others stay."""


class AsRead:
    """The values as they are stored now, read once for many fields."""

    def __init__(self, values: Values) -> None:
        self.settings = values.settings
        self.keep_settings = values.keep_settings


@dataclass(frozen=True)
class Field:
    """A widget's value, and where it is stored."""

    key: str
    """Identifies the widget."""
    name: str
    """Identifies the value: the same widget may show several values in turn."""
    read: Callable[[], Any]
    """Returns the stored value, or the default."""
    write: Callable[[Any], object]
    """Stores a value; may raise StereocalError."""
    tabs_own: bool = False
    """Whether each tab has its own value, for choices that change no result."""
    fit: Fit = lambda value: value
    """Checks a value: other data may have come since this tab showed it."""

    def value(self) -> Any:
        """The current value."""
        shown: dict[str, Any] = st.session_state.setdefault(_SHOWN, {})
        if self.tabs_own and self.name in shown:
            with suppress(TypeError, ValueError):
                return self.fit(shown[self.name])
        return self.read()

    def widget(self, default: str = "value") -> dict[str, Any]:
        """`key`, `on_change` and default of the widget, which will show the value.

        Args:
            default: the name of that argument.
        """
        value = self.value()
        shown: dict[str, Any] = st.session_state[_SHOWN]
        removable = isinstance(self.fit, Number) and self.fit.or_none
        # Whether the browser still has the widget from the last run of the page.
        _, before = st.session_state.get(_BEFORE, ("", set()))
        is_drawn = self.key in before or self.key in st.session_state.get(_DRAWN, set())
        new = not is_drawn or (removable and not st.session_state.get(_RESTED))
        # Only then: writing would discard what the user is typing.
        if new or st.session_state.get(self.key) != value:
            st.session_state[self.key] = value
        shown[self.name] = value
        st.session_state.setdefault(_GIVEN, {})[self.key] = value
        st.session_state.setdefault(_DRAWN, set()).add(self.key)
        if removable:
            st.session_state.setdefault(_REMOVABLE, set()).add(self.key)
        return {"key": self.key, "on_change": self.changed, default: None if removable else value}

    def shown(self) -> Any:
        """The value that this tab showed last; None before."""
        return st.session_state.get(_SHOWN, {}).get(self.name)

    def set(self, value: Any) -> None:
        """Store a value; the widget shows it when it is drawn next."""
        shown: dict[str, Any] = st.session_state.setdefault(_SHOWN, {})
        with suppress(*([StereocalError] if self.tabs_own else [])):
            self.write(value)
        shown[self.name] = value if self.tabs_own else self.read()

    def show(self, value: Any) -> None:
        """Show a value in this tab without storing it."""
        st.session_state.setdefault(_SHOWN, {})[self.name] = value

    def number_input(self, title: str, place: DeltaGenerator | None = None, **widget: Any) -> Any:
        """Draw the field of a number, within the bounds of `fit`; its value.

        Args:
            place: where it stands; None: here.
            widget: passed on to Streamlit.
        """
        assert isinstance(self.fit, Number)
        low, high = (end if math.isfinite(end) else None for end in (self.fit.low, self.fit.high))
        options = {"format": None if isinstance(low, int) else "%.4g", **widget, **self.widget()}
        draw: Any = place or st
        return draw.number_input(title, low, high, **options)

    def slider(self, title: str, place: DeltaGenerator | None = None, **widget: Any) -> Any:
        """Draw a slider between ends that depend on the data; its value.

        To Streamlit, a slider with other ends is another widget, which would begin at its lowest,
        and store that: so it has another key.
        """
        assert isinstance(self.fit, Number)
        low, high = self.fit.low, self.fit.high
        field = replace(self, key=f"{self.key}_{low}_{high}")
        return (place or st).slider(title, low, high, **widget, **field.widget())

    def menu(self, title: str, place: DeltaGenerator | None = None, **widget: Any) -> Any:
        """Draw a menu of the options of `fit`; its value."""
        assert isinstance(self.fit, Options)
        options = self.fit.options
        widget |= self.widget("index")
        widget["index"] = options.index(widget["index"]) if widget["index"] in options else 0
        return (place or st).selectbox(title, options, **widget)

    def buttons(self, title: str, place: DeltaGenerator | None = None, **widget: Any) -> Any:
        """Draw the options of `fit` as buttons, of which one is always pressed; its value."""
        assert isinstance(self.fit, Options)
        widget |= {"required": True, **self.widget("default")}
        return (place or st).segmented_control(title, self.fit.options, **widget)

    @property
    def changed(self) -> Callable[[], None]:
        """The callback of the widget: stores its value."""

        @callback
        def keep() -> None:
            # Another callback of the same click may have emptied the session, for another project.
            # Streamlit also calls when a browser first tells what it was given to show, which may
            # be the default in place of a stored value that does not fit these data.
            given: dict[str, Any] = st.session_state.setdefault(_GIVEN, {})
            if self.key in st.session_state:
                value = st.session_state[self.key]
                if self.key not in given or given[self.key] != value:
                    if value is None and self._is_echo(given):
                        return  # the field shows the stored value again
                    given[self.key] = value
                    self.set(value)

        return keep

    def _is_echo(self, given: Mapping[str, Any]) -> bool:
        """Whether a number that is there no more was not removed, but did not reach the browser.

        A user removes one at a time: others that are there show it. The only one goes the second
        time, from a page that rests.
        """
        removable: set[str] = st.session_state.get(_REMOVABLE, set())
        if self.key not in removable:  # a choice of nothing
            return False
        others = [key for key in removable - {self.key} if given.get(key) is not None]
        if others:
            return all(st.session_state.get(key) is None for key in others)
        echoes, now = st.session_state.setdefault(_ECHOES, {}), time.monotonic()
        before_s, echoes[self.key] = echoes.get(self.key, -math.inf), now
        rests_s = now - max(before_s, st.session_state.get(_ENDED, now))
        return not (rests_s > RESTS_S and now - before_s < AGAIN_S)


def setting(
    values: Values | None,
    key: str,
    usual: Any,
    fit: Fit,
    *,
    name: str | None = None,
    tabs_own: bool = False,
) -> Field:
    """A field whose value is stored among the settings.

    Args:
        values: None while there is no project: the value lasts as long as the tab.
        usual: the default.
        fit: checks a stored value, which an older version may have written.
        name: of the setting, if not the widget's key.
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

    return Field(key, name, read, write, tabs_own or values is None, fit=fit)


@dataclass(frozen=True)
class Number:
    """A number of the type of `low`, within bounds."""

    low: float
    high: float = math.inf
    or_none: bool = False

    def __call__(self, value: Any) -> Any:
        """The number, or None; raises as `Fit`."""
        if value is None and self.or_none:
            return None
        if isinstance(value, bool) or not self.low <= value <= self.high:
            raise ValueError(value)
        if isinstance(self.low, int) and not isinstance(value, int):
            raise TypeError(value)
        return type(self.low)(value)


@dataclass(frozen=True)
class Options:
    """One of some options."""

    options: tuple[Any, ...]

    def __call__(self, value: Any) -> Any:
        """The option that is equal; raises as `Fit`."""
        return self.options[self.options.index(value)]


def one_of(options: Iterable[Any]) -> Options:
    """One of some options."""
    return Options(tuple(options))


def some_of(options: Sequence[Any]) -> Fit:
    """A list of some of the options; others are dropped."""

    return lambda value: [option for option in value if option in options]


def yes_or_no(value: Any) -> bool:
    """True or False."""
    return bool(one_of((False, True))(value))


def choose(
    values: Values | None,
    key: str,
    title: str,
    options: Iterable[Any],
    usual: Any = None,
    *,
    place: DeltaGenerator | None = None,
    tabs_own: bool = True,
    as_menu: bool = False,
    **widget: Any,
) -> Any:
    """One of some options, by buttons or from a menu; its value.

    Args:
        usual: the default; None: the first option.
        place: where it stands; None: here.
        widget: passed on to Streamlit.
    """
    fit = one_of(options)
    default = fit.options[0] if usual is None else usual
    field = setting(values, key, default, fit, tabs_own=tabs_own)
    return (field.menu if as_menu else field.buttons)(title, place, **widget)


choose_from_menu = partial(choose, as_menu=True, tabs_own=False)
"""A choice that changes a result, from a menu."""


def begin_page(page: str) -> None:
    """Note the start of a page: on another page than before, no widget exists yet."""
    of_page, before = st.session_state.get(_BEFORE, ("", set()))
    drawn: set[str] = st.session_state.get(_DRAWN, set())
    ended_s = st.session_state.get(_ENDED, math.inf)
    st.session_state[_RESTED] = time.monotonic() - ended_s > UNTIL_THERE_S
    # If a click ended the last run, the widgets of the run before it are still there.
    st.session_state[_BEFORE] = (page, before | drawn if of_page == page else set())
    st.session_state[_DRAWN] = set()


def end_page() -> None:
    """Note that the page is complete: Streamlit forgets widgets that were not drawn."""
    of_page, _ = st.session_state.get(_BEFORE, ("", set()))
    st.session_state[_BEFORE] = (of_page, set())
    st.session_state[_ENDED] = time.monotonic()


def page_shown() -> str:
    """The page that is drawn, or was when something on it was pressed."""
    return str(st.session_state.get(_BEFORE, ("", set()))[0])
