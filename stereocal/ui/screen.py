"""Whether the screen is narrow, as the browser tells: figures for other screens are not drawn."""

from typing import Any

import streamlit as st

NAME, KEY, NARROW = "stereocal_screen", "screen", "screen_is_narrow"
JS = """export default function ({ data, setStateValue }) {
  const narrow = matchMedia("(max-width: 640px)")
  const tell = () => { if (narrow.matches !== data.narrow) setStateValue("narrow", narrow.matches) }
  narrow.addEventListener("change", tell)
  tell()
  return () => narrow.removeEventListener("change", tell)
}"""


def is_narrow() -> bool:
    """Whether this tab is on a narrow screen; before it has told, it is taken for a wide one."""
    return bool(st.session_state.get(NARROW, False))


def tell_screen() -> None:
    """Have the browser tell whether the screen is narrow, and again when that changes."""

    def note() -> None:
        told: Any = st.session_state.get(KEY)
        if told is not None and isinstance(told.get("narrow"), bool):
            st.session_state[NARROW] = told["narrow"]

    component = st.components.v2.component(NAME, js=JS)
    with st.container(key="arrival_screen"):
        component(key=KEY, data={"narrow": is_narrow()}, on_narrow_change=note)
