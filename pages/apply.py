"""Apply: match points and reconstruct them in 3D."""

from stereocal.ui.menu import page_head

page_head("Apply", "Which points belong together, and where are they?")

from stereocal.projects.application import ProjectApplication
from stereocal.ui.apply import choose_apply_inputs, update_application
from stereocal.ui.apply_results import show_application
from stereocal.ui.messages import ErrorsShown
from stereocal.ui.prerequisites import project_or_begin

project = project_or_begin("points of both cameras and parameter files", "apply_begin")
store = ProjectApplication(project)
chosen = None
with ErrorsShown():
    chosen = choose_apply_inputs(project, store)
    if chosen is not None and chosen.work is not None:
        update_application(project, store, chosen.work, chosen.is_clicked)
show_application(project, store, chosen)
