"""The last refused upload: the reason, and ways to continue."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd
import streamlit as st

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.formats.lens_model import FourCoefficientsError
from stereocal.rig.camera import LensModel
from stereocal.ui.texts import escape_markdown

_REFUSED = "refused"


def show_refusal() -> None:
    """Show the last refusal, until something is accepted."""
    refused: _Refusal | None = st.session_state.get(_REFUSED)
    if refused is None:
        return
    st.error(f"{escape_markdown(refused.sentence)}\n\nWhat was loaded before is unchanged.")
    if refused.problems:
        rows = [(problem.line, problem.reason) for problem in refused.problems]
        st.dataframe(
            pd.DataFrame(rows, columns=["Line", "Refused because"]),
            hide_index=True,
            height=min(38 + 35 * len(rows), 250),
        )
    for key, (label, use) in zip(("use_rest", "use_other"), refused.ways.items(), strict=False):
        st.button(label, on_click=use, key=key)


@dataclass(frozen=True)
class _Refusal:
    sentence: str
    problems: Sequence[RowProblem]
    ways: Mapping[str, Callable[[], None]]
    """Callbacks by the label of their button; two at most."""


def refuse(
    error: StereocalError,
    left: int = 0,
    retry: Callable[[], None] | None = None,
    ways: Mapping[str, Callable[[], None]] | None = None,
) -> None:
    """Show a refusal on the page.

    Args:
        left: number of valid rows.
        retry: uses only these.
        ways: other ways to continue, by the label of their button.
    """
    problems = error.problems if isinstance(error, RefusedRowsError) else ()
    label = f"Leave these rows out and use the other {left}"
    rest = {label: retry} if retry is not None and left else {}
    st.session_state[_REFUSED] = _Refusal(str(error), problems, {**rest, **(ways or {})})


def clear_refusal() -> None:
    """Remove the refusal, because something was accepted."""
    st.session_state.pop(_REFUSED, None)


def ask_lens(error: FourCoefficientsError, use: Callable[[LensModel], None]) -> None:
    """Ask for the model of four distortion coefficients; nothing is stored before the answer."""
    st.session_state[_REFUSED] = _Refusal(
        f"{error.question} Which are they?",
        (),
        {
            "k1 k2 p1 p2: the usual lens": lambda: use("brown"),
            "k1 k2 k3 k4: a fisheye": lambda: use("fisheye"),
        },
    )
