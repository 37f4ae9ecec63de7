"""Help: the documentation of this version."""

import streamlit as st

from stereocal.ui.help import show_help

st.title("Help")
show_help()
