"""The last refused upload: the reason, and ways to continue."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial

import pandas as pd
import streamlit as st

from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.camera_file import FourCoefficientsError
from stereocal.rig.camera import LensModel
from stereocal.ui.texts import escape_markdown

Ways = Mapping[str, Callable[[], None]]
"""Callbacks by the label of their button; two at most."""
_REFUSED = "refused"


def show_refusal() -> None:
    """Show the last refusal, until something is accepted."""
    refused: tuple[StereocalError, Ways] | None = st.session_state.get(_REFUSED)
    if refused is None:
        return
    error, ways = refused
    st.error(f"{escape_markdown(str(error))}\n\nWhat was loaded before is unchanged.")
    if isinstance(error, RefusedRowsError):
        rows = [(problem.line, problem.reason) for problem in error.problems]
        table = pd.DataFrame(rows, columns=["Line", "Refused because"])
        st.dataframe(table, hide_index=True, height=min(38 + 35 * len(rows), 250))
    for key, (label, use) in zip(("use_rest", "use_other"), ways.items(), strict=False):
        st.button(label, on_click=use, key=key)


def refuse(error: StereocalError, ways: Ways | None = None) -> None:
    """Show a refusal on the page, with other ways to continue."""
    st.session_state[_REFUSED] = error, ways or {}


def clear_refusal() -> None:
    """Remove the refusal, because something was accepted."""
    st.session_state.pop(_REFUSED, None)


@contextmanager
def refusing() -> Iterator[None]:
    """Show a StereocalError as the refusal; without one, remove the last."""
    try:
        yield
        clear_refusal()
    except StereocalError as error:
        refuse(error)


def ask_lens(error: FourCoefficientsError, use: Callable[[LensModel], None]) -> None:
    """Ask for the model of four distortion coefficients; nothing is stored before the answer."""
    refuse(
        StereocalError(f"{error.question} Which are they?"),
        {
            "k1 k2 p1 p2: the usual lens": partial(use, "brown"),
            "k1 k2 k3 k4: a fisheye": partial(use, "fisheye"),
        },
    )
