"""Whether cameras were in step or started by hand: what the points say, and what may be pressed."""

import json
from functools import partial

import streamlit as st

from stereocal.fit.timing.to_calibrate import what_frames_tell
from stereocal.formats.exchange.options import Frames
from stereocal.rig.recording import Recording
from stereocal.system.latest import once
from stereocal.ui.texts import escape_markdown

QUESTION = (
    "**Were the cameras in step, or started by hand?** In step, frame 12 of each is the same "
    "moment. Started by hand, each counts its own frames, and the motion tells by how many they "
    "differ."
)
BY_HAND, IN_STEP = "They were started by hand", "They were in step"


def ask_if_in_step(counted: Recording | None, states_own: bool) -> dict[str, Frames]:
    """Show what is open about the frames; the answers that may be pressed, the likeliest first. One
    that is empty needs no words.

    Args:
        counted: all points of each camera, as their frames are numbered; None: the lenses, which
            tell, are not there yet.
        states_own: whether the table says that each camera counts its own frames.
    """
    if counted is None:
        st.markdown(QUESTION)
        st.info(f"If {BY_HAND.lower()}, drop the camera files first: the lenses help to find that.")
        return {} if states_own else {IN_STEP: "common"}
    if states_own:
        return {"": "own"}
    lenses = [camera.to_json() for camera in counted.cameras.values()]
    key = json.dumps([counted.points_digest, lenses])
    with st.spinner("Looking at how the frames of the cameras fit together ..."):
        in_step, why = once("frames told", key, partial(what_frames_tell, counted))
    if in_step:
        return {"": "common"}
    st.warning(escape_markdown(why))
    st.markdown(QUESTION)
    return {BY_HAND: "own", IN_STEP: "common"}
