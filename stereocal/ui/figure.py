"""A figure on a page."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go
import streamlit as st

from stereocal.ui.texts import escape_markdown

WIDE_OR_NARROW = """<style>
.st-key-narrow { display: none; }
@media (max-width: 640px) { .st-key-wide { display: none; } .st-key-narrow { display: flex; } }
</style>"""
"""Of what stands in the containers `wide` and `narrow` of a page, the one for this screen."""


def show_figure(
    figure: go.Figure,
    sentence: str,
    key: str,
    fold: bool = True,
    narrow: go.Figure | None = None,
    **chart: Any,
) -> None:
    """A figure with its description in words.

    Args:
        fold: the words are folded away; not where they say what is not in the figure.
        narrow: the same figure for a narrow screen.
        chart: passed on to `st.plotly_chart`.
    """
    for each in (figure, narrow):
        if each and each.layout.scene.xaxis.title.text:  # its texts follow no style sheet
            each.layout.font.color = st.get_option(
                f"theme.{st.context.theme.type or 'light'}.textColor"
            )
    if narrow is None:
        st.plotly_chart(figure, key=key, **chart)
    else:
        st.html(WIDE_OR_NARROW)
        st.container(key="wide").plotly_chart(figure, key=key, **chart)
        st.container(key="narrow").plotly_chart(narrow, key=f"{key}_narrow", **chart)
    with st.expander("In words") if fold else st.container():
        st.caption(escape_markdown(sentence))
