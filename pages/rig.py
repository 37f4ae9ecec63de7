"""Rig: three cameras and more, calibrated together."""

from stereocal.ui.menu import page_head

page_head("Rig", "Do all cameras agree?")

from stereocal.ui.data_read import show_in_step
from stereocal.ui.project import current_project
from stereocal.ui.rig import show_page

show_page()
if (project := current_project()) is not None:
    show_in_step(project)
