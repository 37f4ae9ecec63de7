"""A figure on a page, for the screen there is; and how to scroll to what a press has opened, which
may stand far below."""

import time
from typing import Any

import numpy as np
import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.ui.texts import escape_markdown

NAME, KEY, NARROW = "stereocal_screen", "screen", "screen_is_narrow"
JS = """export default function ({ data, setStateValue }) {
  const narrow = matchMedia("(max-width: 640px)")
  const tell = () => { if (narrow.matches !== data.narrow) setStateValue("narrow", narrow.matches) }
  narrow.addEventListener("change", tell)
  tell()
  return () => narrow.removeEventListener("change", tell)
}"""

_TARGET = "scroll_to"
SCRIPT = """<script>/* {now} */
(() => {{
  const start = Date.now()
  const stop = () => clearInterval(timer)
  const timer = setInterval(() => {{
    const target = document.querySelector(".st-key-{key}")
    if (target) {{
      target.style.scrollMarginTop = "4rem" // of the header
      target.scrollIntoView()
    }}
    if (Date.now() - start > {ms}) stop()
  }}, 100)
  for (const act of ["wheel", "touchstart", "keydown", "pointerdown"])
    window.addEventListener(act, stop, {{ once: true, capture: true }})
}})()
</script>"""
"""Repeated, because figures and photographs above it come later; the user's own acts end it."""
FOLLOWS_MS = 1500


def show_figure(
    figure: go.Figure, words: str, key: str, *, caption: bool = False, **chart: Any
) -> None:
    """A figure.

    Args:
        words: the same for screen readers.
        caption: the words stand below it too, where they say what is not in the figure.
        chart: passed on to `st.plotly_chart`.
    """
    if figure.layout.scene.xaxis.title.text:  # its texts follow no style sheet
        theme = st.context.theme.type or "light"
        figure.layout.font.color = st.get_option(f"theme.{theme}.textColor")
    st.plotly_chart(figure, key=key, alt=words, **chart)
    if caption:
        st.caption(escape_markdown(words))


def clicked_in(chart: str) -> Any:
    """What the first point is of that was clicked in a figure: a frame, or a name; None if none
    was."""
    state = st.session_state.get(chart)
    points = state["selection"]["points"] if state else ()
    values = [np.ravel(point["customdata"])[0] for point in points if "customdata" in point]
    return values[0].item() if values else None


def is_narrow() -> bool:
    """Whether this tab is on a narrow screen; before it has told, phones are taken for it.

    Their browsers all name themselves "Mobi". Else a phone's first page would be drawn twice, and
    what a finger has begun to point at would move away below it.
    """
    agent = st.context.headers.get("User-Agent", "")
    return bool(st.session_state.get(NARROW, "Mobi" in agent))


def tell_screen() -> None:
    """Have the browser tell whether the screen is narrow, and again when that changes."""

    def note() -> None:
        state: Any = st.session_state.get(KEY)
        if state is not None and isinstance(state.get("narrow"), bool):
            st.session_state[NARROW] = state["narrow"]

    component = st.components.v2.component(NAME, js=JS)
    with st.container(key="arrival_screen"):
        component(key=KEY, data={"narrow": is_narrow()}, on_narrow_change=note)


def scroll_to(key: str) -> None:
    """Have the next run of a page scroll to the part of this key (for callbacks)."""
    st.session_state[_TARGET] = key


def scrolled_part(key: str) -> DeltaGenerator:
    """A container that `scroll_to` can scroll to."""
    part = st.container(key=key)
    with part.container():  # always there, so that nothing below is built again
        if st.session_state.get(_TARGET) == key:
            del st.session_state[_TARGET]
            script = SCRIPT.format(now=time.monotonic(), key=key, ms=FOLLOWS_MS)
            st.html(script, unsafe_allow_javascript=True)
    return part
