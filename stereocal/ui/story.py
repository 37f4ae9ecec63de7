"""The story that Start tells on the real recording: one set, two sets, one refined set."""

from __future__ import annotations

import streamlit as st

from stereocal.figures.story import (
    Story,
    describe_story_lengths,
    describe_story_lines,
    describe_two_rays,
    plot_story_lengths,
    plot_story_lines,
    plot_two_rays,
    read_story,
)
from stereocal.system.resources import ROOT

STORY = ROOT / "assets" / "story.json"


def show_story() -> None:
    """Three figures side by side, and what they say in words."""
    story = _story()
    lengths, rays, lines = st.columns([5, 4, 4], gap="medium")
    with lengths:
        bars = len(next(iter(story.sets.values())).length_errors)
        st.markdown(f"**Length errors of the same {bars} real bars**")
        st.plotly_chart(plot_story_lengths(story), key="story_lengths")
    with rays:
        st.markdown("**Why: two rays miss each other**")
        st.plotly_chart(plot_two_rays(story), key="two_rays")
    with lines:
        st.markdown("**A point and its epipolar lines**")
        st.plotly_chart(plot_story_lines(story), key="story_lines")
    with st.expander("In words"):
        for words in (
            describe_story_lengths(story),
            describe_two_rays(story),
            describe_story_lines(story),
        ):
            st.caption(words)


@st.cache_resource(show_spinner=False)
def _story() -> Story:
    return read_story(STORY)
