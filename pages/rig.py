"""Rig: three cameras and more, calibrated together."""

from stereocal.ui.menu import page_head

page_head("Rig", "Do all cameras agree?")

from stereocal.ui.rig import show_page

show_page()
