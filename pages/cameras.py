"""Lenses: the lens of each camera, from photographs of a board or from a camera file."""

from stereocal.ui.menu import page_head

page_head("Lenses", "How does each camera's lens see, and how well is that known?")

from stereocal.ui.lens import show_cameras_of_rig, show_lenses
from stereocal.ui.project import current_project

project = current_project()
of_rig = project is not None and show_cameras_of_rig(project)
if not of_rig:
    show_lenses(project)
