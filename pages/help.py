"""Help: the documentation of this version."""

from stereocal.ui.menu import ensure_navigation

ensure_navigation()


import streamlit as st

from stereocal.ui.help import show_help

st.title("Help")
show_help()
