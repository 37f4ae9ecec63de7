"""A figure on a page."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go
import streamlit as st

from stereocal.ui.texts import escape_markdown


def show_figure(
    figure: go.Figure, sentence: str, key: str, fold: bool = True, **chart: Any
) -> None:
    """A figure with its description in words.

    Args:
        fold: the words are folded away; not where they say what is not in the figure.
        chart: passed on to `st.plotly_chart`.
    """
    if figure.layout.scene.xaxis.title.text:  # a scene, whose texts follow no style sheet
        figure.layout.font.color = st.get_option(
            f"theme.{st.context.theme.type or 'light'}.textColor"
        )
    st.plotly_chart(figure, key=key, **chart)
    with st.expander("In words") if fold else st.container():
        st.caption(escape_markdown(sentence))
