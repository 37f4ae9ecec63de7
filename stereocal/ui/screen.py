"""Whether the screen is narrow, as the browser tells: figures for other screens are not drawn."""

from typing import Any

import streamlit as st

NAME, KEY = "stereocal_screen", "screen"
JS = """export default function ({ data, setStateValue }) {
  const narrow = matchMedia("(max-width: 640px)")
  const tell = () => { if (narrow.matches !== data.narrow) setStateValue("narrow", narrow.matches) }
  narrow.addEventListener("change", tell)
  tell()
  return () => narrow.removeEventListener("change", tell)
}"""
NARROW = "screen_is_narrow"
"""Where the session keeps whether this tab is on a narrow screen; nothing until it has told, just
after its first draw."""


def tell_screen() -> None:
    """Have the browser tell whether the screen is narrow, and again when that changes."""

    def note() -> None:
        told: Any = st.session_state.get(KEY)
        if told is not None and isinstance(told.get("narrow"), bool):
            st.session_state[NARROW] = told["narrow"]

    component = st.components.v2.component(NAME, js=JS)
    with st.container(key="arrival_screen"):
        data = {"narrow": st.session_state.get(NARROW)}
        component(key=KEY, data=data, on_narrow_change=note)
